"""Every section of the configuration, and the presets."""

from __future__ import annotations

from typing import Any

from rotortrack.afm.options import ContourOptions
from rotortrack.cameras.options import CameraOptions
from rotortrack.corrections.options import DensityOptions, DriftOptions, QualityOptions
from rotortrack.errors import ConfigurationError
from rotortrack.localise.options import LocaliseOptions
from rotortrack.motion.link_options import LinkOptions
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.plan_options import PlanOptions
from rotortrack.motion.screen_options import ScreenOptions
from rotortrack.movies.options import MovieOptions
from rotortrack.rotors.options import CircleOptions, ClusterOptions
from rotortrack.settings import Layer, Options, Settings
from rotortrack.twocolour.channel_options import ChannelsOptions
from rotortrack.twocolour.ends_options import EndsOptions
from rotortrack.twocolour.options import RegisterOptions

_ORIGIN = "preset "

SECTIONS: dict[str, type[Options]] = {
    "movie": MovieOptions,
    "camera": CameraOptions,
    "localise": LocaliseOptions,
    "quality": QualityOptions,
    "drift": DriftOptions,
    "density": DensityOptions,
    "cluster": ClusterOptions,
    "circle": CircleOptions,
    "screen": ScreenOptions,
    "motion": MotionOptions,
    "link": LinkOptions,
    "plan": PlanOptions,
    "channels": ChannelsOptions,
    "ends": EndsOptions,
    "register": RegisterOptions,
    "contour": ContourOptions,
}
"""Option class of each section, in the order of the workflow; those beside it come last."""

_BESIDE = ("link", "plan", "channels", "ends", "register", "contour")
WORKFLOW = tuple(name for name in SECTIONS if name not in _BESIDE)
"""Sections that a run depends on; its record names no others."""

PRESETS: dict[str, dict[str, dict[str, Any]]] = {
    "paper": {
        "localise": {
            "wavelet_order": 3,
            "wavelet_scale": 2.0,
            "threshold": "std(Wave.F1)",
            "connectivity": 8,
            "fit_radius_px": 3,
            "clip_at_border": False,
            "initial_sigma_px": 1.6,
            "fit_sigma": True,
            "method": "wlsq",
            "correct_bias": False,
            "max_emitters": 1,
            "uncertainty": "thunderstorm-2016",
            "shift_negative_frames": True,
        },
        "quality": {"max_uncertainty_nm": 50.0},
        "drift": {"method": "cross-correlation", "min_significance": 0.0},
        "density": {"radius_nm": 50.0, "min_neighbours": 15},
        "motion": {"estimator": "paper", "gap_mode": "drop"},
    },
}


PRESET_NOTES: dict[str, tuple[str, ...]] = {
    "paper": (
        "the paper does not name its fit: weighted least squares with the plugin's threshold "
        "std(Wave.F1), radius 3 px and start width 1.6 px were chosen",
        "the paper does not name the plugin's release: the uncertainty formula of 2016 was chosen, "
        "with the plugin's read noise setting at its default of 0",
        "the paper's 50 nm may be a radius or a diameter: the plugin's field is a radius, so "
        "density.radius_nm = 50 was chosen (25 is the other reading)",
        "the paper does not say how its MSD crosses missing frames: by the step nearest to the "
        "mean step of adjacent frames",
        "the paper does not name its drift bins, clustering distance, circle fit or lags of the "
        "MSD fit: the defaults of those stages were used",
    )
}
"""What the publication leaves open, and what was chosen in its place."""


def preset_layer(name: str) -> Layer:
    """Give the values of a preset.

    Raises
    ------
    ConfigurationError
        There is no such preset.
    """
    if name not in PRESETS:
        raise ConfigurationError(f"--preset {name} is not known: known are {', '.join(PRESETS)}")
    return Layer(_ORIGIN + name, PRESETS[name])


def notes_on(settings: Settings) -> tuple[str, ...]:
    """Give the notes of the preset that settings were made with, if any."""
    for name, notes in PRESET_NOTES.items():
        if _ORIGIN + name in settings.origins.values():
            return notes
    return ()
