"""Every section of the configuration, and the presets."""

from __future__ import annotations

from typing import Any

from rotortrack.cameras.options import CameraOptions
from rotortrack.corrections.options import DensityOptions, DriftOptions, QualityOptions
from rotortrack.errors import ConfigurationError
from rotortrack.localise.options import LocaliseOptions
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.screen_options import ScreenOptions
from rotortrack.movies.options import MovieOptions
from rotortrack.rotors.options import CircleOptions, ClusterOptions
from rotortrack.settings import Layer, Options

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
}
"""Option class of each section, in the order of the workflow."""

PRESETS: dict[str, dict[str, dict[str, Any]]] = {
    # What the publication leaves open is chosen here in the open: the fit method (weighted least
    # squares), the threshold (the plugin's default), the uncertainty formula (the 2016 builds),
    # the density radius (50 nm is the plugin's radius field), and the lags of the MSD fit.
    "paper": {
        "localise": {
            "wavelet_order": 3,
            "wavelet_scale": 2.0,
            "threshold": "std(Wave.F1)",
            "connectivity": 8,
            "fit_radius_px": 3,
            "initial_sigma_px": 1.6,
            "method": "wlsq",
            "uncertainty": "thunderstorm-2016",
            "shift_negative_frames": True,
        },
        "quality": {"max_uncertainty_nm": 50.0},
        "drift": {"method": "cross-correlation"},
        "density": {"radius_nm": 50.0, "min_neighbours": 15},
        "motion": {"gap_mode": "drop"},
    },
}


def preset_layer(name: str) -> Layer:
    """Give the values of a preset.

    Raises
    ------
    ConfigurationError
        There is no such preset.
    """
    if name not in PRESETS:
        raise ConfigurationError(f"--preset {name} is not known: known are {', '.join(PRESETS)}")
    return Layer(f"preset {name}", PRESETS[name])
