"""The sample data: films of simulated rods, each with its scene, configuration and truth."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Final

from rotortrack.files import make_folder
from rotortrack.settings import Layer
from rotortrack.simulate.film.filming import film_scene
from rotortrack.simulate.scene import Scene, make_scene

_CAMERA: Final = {"offset_adu": 100.0, "gain_e_per_adu": 1.5, "read_noise_e": 1.4}
"""Noise does not compress: at 1.5 electrons a count 1600 frames take 6 MB, at 0.4545 over 8."""

_TURNING: Final = {
    "field": {"voltage_v": 0.1},
    "rod": {},
    "stepping": {"duration_us": 800.0, "stop_when_settled": True},
    "scan": {
        "lambda_eff": [0.2, 0.26, 0.35],
        "flow_ratio": [122.0, 130.0],
        "offset_x_nm": [0.0, 40.0],
        "offset_y_nm": [3.0, 8.0],
    },
}
"""Rods of the phase diagram about the middle of its rotating ones, docked in two ways."""

_LIGHT: Final = {"photons": [600.0, 1000.0], "shape": "rod"}
_SPLIT: Final = {
    "shift_nm": [90.0, -60.0],
    "scale": 1.002,
    "rotation_deg": 0.25,
    "radial_nm": 40.0,
    "keystone_nm": 15.0,
}

SAMPLES: Final[dict[str, tuple[str, dict[str, Any]]]] = {
    "rotors": (
        "eight rods; the voltage rises from 50 to 100 mV after 1.6 of 3.2 s",
        {
            "film": {"width_px": 96, "height_px": 64, "n_frames": 1600, "exposure_s": 0.002},
            "lattice": {"pitch_nm": 2400.0, "rotation_deg": 2.0, "jitter_nm": 20.0},
            "voltage": {"times_s": [0.0, 1.6], "voltages_mv": [50.0, 100.0], "sample_hz": 2500.0},
            "rotors": [
                {**_LIGHT, "count": 3, "direction": "ccw", "omega_rad_s": [25.0, 60.0]},
                {**_LIGHT, "count": 2, "direction": "cw", "omega_rad_s": [25.0, 60.0]},
                {**_LIGHT, "motion": "brownian"},
                {**_LIGHT, "motion": "stuck"},
                {
                    **_LIGHT,
                    "motion": "two_position",
                    "switch_rate_per_s": 6.0,
                    # Poses of a rod may be so far apart that they are two rotors to the eye, too.
                    "shape": "circle",
                    "radius_nm": 90.0,
                },
            ],
            "background": {"photons": 5.0},
            "camera": _CAMERA,
            **_TURNING,
        },
    ),
    "salt": (
        "four rods in the flow that a salt gradient of 50 to 550 mM drives without current",
        {
            "film": {"width_px": 64, "height_px": 64, "n_frames": 700, "exposure_s": 0.002},
            "lattice": {"pitch_nm": 2400.0, "rotation_deg": 5.0, "jitter_nm": 20.0},
            "rotors": [
                {**_LIGHT, "count": 3, "omega_rad_s": [8.0, 20.0], "diffusion_rad2_s": [1.0, 10.0]},
                {**_LIGHT, "motion": "brownian", "diffusion_rad2_s": [1.0, 10.0]},
            ],
            "background": {"photons": 5.0},
            "camera": _CAMERA,
            "field": {
                "voltage_v": 0.0,
                "cis_mm": 50.0,
                "trans_mm": 550.0,
                "electrical": "zero_current",
            },
            "rod": {"lambda_eff": 0.5, "flow_ratio": 60.0},
            "stepping": {"duration_us": 800.0, "stop_when_settled": True},
        },
    ),
    "two_colours": (
        "four rods with both ends labelled, the colours side by side",
        {
            "film": {"width_px": 128, "height_px": 64, "n_frames": 500, "exposure_s": 0.002},
            "lattice": {"pitch_nm": 2400.0, "rotation_deg": 5.0, "jitter_nm": 20.0},
            "rotors": [{**_LIGHT, "count": 4, "ends": 2, "omega_rad_s": [25.0, 60.0]}],
            "dyes": {"labelled": 0.9},
            "background": {"photons": 5.0},
            "camera": _CAMERA,
            "split": _SPLIT,
            **_TURNING,
        },
    ),
    "fiducials": (
        "a grid of points that shine in both colours, for the registration of two_colours",
        {
            "film": {"width_px": 128, "height_px": 64, "n_frames": 20, "exposure_s": 0.002},
            "fiducials": {"pitch_nm": 700.0, "missing": 0.1},
            "background": {"photons": 5.0},
            "camera": _CAMERA,
            "split": _SPLIT,
        },
    ),
}
"""What each sample shows, and its scene."""

_MOVED_UP: Final = ("config.toml", "scene.toml", "daq.csv")
"""Of what lies beside a movie, that which an experimenter has, too."""


def sample_scene(name: str = "rotors") -> Scene:
    """Give the scene of a sample of `SAMPLES`."""
    return make_scene([Layer(f"sample {name}", SAMPLES[name][1])], origin=f"sample {name}")


def make_sample(folder: Path, name: str = "rotors") -> None:
    """Write `movie.tif`, `config.toml`, `scene.toml`, `truth/` and, with a voltage, `daq.csv`.

    Parameters
    ----------
    folder
        Where to write; made when missing. Files of those names are replaced.
    name
        One of `SAMPLES`.

    Raises
    ------
    ResourceError
        The folder cannot be written.
    """
    make_folder(folder)
    truth = folder / "truth"
    film_scene(sample_scene(name), folder / "movie.tif", truth_in=truth, compress=True)
    for file in _MOVED_UP:
        if (truth / file).exists():
            (truth / file).replace(folder / file)


def manifest(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file under a folder, by its path from there."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
