"""Plans from what the user gives, and what the movie of an existing run can resolve."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rotortrack.errors import ConfigurationError, InputError
from rotortrack.localise.precision import bound_nm
from rotortrack.motion.plan import (
    FIVE_PERCENT,
    Setting,
    frames_needed,
    smallest_speed,
    speed_sd,
)
from rotortrack.motion.plan_movie import MoviePlan, plan_movie
from rotortrack.motion.plan_options import PlanOptions
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import Record
from rotortrack.pipeline.store import RunFolder
from rotortrack.settings import Layer, Settings, resolve

if TYPE_CHECKING:
    import pandas as pd

_MOVIE = ("movie.frame_interval_s", "plan.diffusion_rad2_s", "plan.radius_nm")


@dataclass(frozen=True)
class RunPlan:
    """What each kept rotor of a run resolves.

    Attributes
    ----------
    rotors
        rotor, behaviour, duration_s, detection, radius_nm, diffusion_rad2_s, noise_deg,
        speed_deg_s and speed_sd_deg_s as measured, expected_sd_deg_s, smallest_5_deg_s,
        smallest_deg_s, needed_s for its own speed.
    driven_z
        Errors by which the speed of a driven rotor differs from zero.
    unmeasured
        Kept rotors without a diffusion coefficient, which are left out.
    """

    rotors: pd.DataFrame
    driven_z: float
    unmeasured: int


def plan_from_options(layers: list[Layer]) -> MoviePlan:
    """Plan a movie by the options of [plan] and [movie].

    Raises
    ------
    ConfigurationError
        What the plan needs is not given, all listed at once; or values contradict each other.
    """
    settings = resolve(SECTIONS, layers)
    options: PlanOptions = settings["plan"]
    mistakes = _missing(settings, options)
    if mistakes:
        raise ConfigurationError(*mistakes)
    interval_s, exposure_s = _timing(settings)
    precision = _precision(settings, options)
    sd_nm = options.localisation_sd_nm
    if sd_nm is None:
        assert precision is not None
        assert options.photons is not None
        sd_nm = precision(options.photons)
    assert options.diffusion_rad2_s is not None
    assert options.radius_nm is not None
    frames = options.frames or round((options.duration_s or 0.0) / interval_s)
    if frames < 3:
        raise ConfigurationError(
            f"duration_s {options.duration_s:g} holds {frames} frames of {interval_s:g} s: give a "
            "longer one"
        )
    setting = Setting(
        diffusion_rad2_s=options.diffusion_rad2_s,
        radius_nm=options.radius_nm,
        localisation_sd_nm=sd_nm,
        frame_interval_s=interval_s,
        exposure_s=exposure_s,
        frames=frames,
        detection=options.detection,
    )
    wanted = options.speed_deg_s
    return plan_movie(
        setting,
        omega_rad_s=None if wanted is None else math.radians(wanted),
        driven_z=settings["motion"].driven_z,
        precision=precision,
    )


def plan_of_run(path: Path, layers: list[Layer]) -> RunPlan:
    """Say what the movie of a run resolves, rotor by rotor; nothing is written.

    Given `plan.frames` or `plan.duration_s` it is for a movie of that length of the same rotors.

    Raises
    ------
    InputError
        The folder holds no finished run, or its motion was not measured.
    """
    import pandas as pd

    folder = RunFolder.open(path)
    settings = resolve(SECTIONS, [*Record("plan").continue_from(folder.read_manifest()), *layers])
    settings.require("movie.frame_interval_s")
    interval_s, exposure_s = _timing(settings)
    options: PlanOptions = settings["plan"]
    if options.frames is not None and options.duration_s is not None:
        raise ConfigurationError("frames and duration_s are both given: give one of them")
    rotors, tracks = folder.read("rotors"), folder.read("tracks")
    if "diffusion_rad2_s" not in rotors:
        raise InputError(f"{path} has no speeds yet: run `rotortrack motion {path}` first")
    kept = rotors[rotors["verdict"] == "kept"] if "verdict" in rotors else rotors
    frames = {cast(int, number): part["frame"] for number, part in tracks.groupby("rotor")}
    seen = {number: (int(f.min()), int(f.max()), len(f)) for number, f in frames.items()}
    z = settings["motion"].driven_z
    rows = []
    for row in kept.to_dict("records"):
        setting = _setting_of(row, seen, options, interval_s, exposure_s)
        if setting is not None:
            rows.append(_plan_row(row, setting, z))
    table = pd.DataFrame(rows, columns=_COLUMNS)
    return RunPlan(table, z, len(kept) - len(table))


_COLUMNS = [
    *("rotor", "behaviour", "duration_s", "detection", "radius_nm", "diffusion_rad2_s"),
    *("noise_deg", "speed_deg_s", "speed_sd_deg_s", "expected_sd_deg_s"),
    *("smallest_5_deg_s", "smallest_deg_s", "needed_s"),
]


def _setting_of(
    row: Mapping[Any, Any],
    seen: Mapping[int, tuple[int, int, int]],
    options: PlanOptions,
    interval_s: float,
    exposure_s: float,
) -> Setting | None:
    """Rotor and movie as they were, None where the rotor was not measured."""
    number = row["rotor"]
    diffusion = row["diffusion_rad2_s"] or row.get("diffusion_sd_rad2_s", math.nan)
    radius = row["radius_nm"]
    sd_nm = row.get("theta_noise_rad", math.nan) * row.get("radius_fit_nm", radius)
    if not math.isfinite(sd_nm):
        sd_nm = row.get("localisation_sd_nm", math.nan)
    if number not in seen or not np.isfinite([diffusion, radius, sd_nm]).all():
        return None
    first, last, rows = seen[number]
    span = last - first + 1
    if row.get("resampled"):
        # Uneven turning spreads further than single steps tell: as far as the speed's own error.
        duration_s = span * interval_s
        diffusion = max(diffusion, 0.5 * row["omega_sd_rad_s"] ** 2 * duration_s)
    asked = options.frames or (options.duration_s or 0.0) / interval_s
    return Setting(
        diffusion_rad2_s=float(diffusion),
        radius_nm=float(radius),
        localisation_sd_nm=float(sd_nm),
        frame_interval_s=interval_s,
        exposure_s=exposure_s,
        frames=float(asked or span),
        detection=rows / span,
    )


def _plan_row(row: Mapping[Any, Any], setting: Setting, z: float) -> dict[str, Any]:
    omega = row["omega_rad_s"]
    needed = math.nan
    if math.isfinite(omega) and omega != 0.0:
        needed = frames_needed(setting, omega, z) * setting.frame_interval_s
    return {
        "rotor": row["rotor"],
        "behaviour": row.get("behaviour", ""),
        "duration_s": setting.duration_s,
        "detection": setting.detection,
        "radius_nm": setting.radius_nm,
        "diffusion_rad2_s": setting.diffusion_rad2_s,
        "noise_deg": math.degrees(setting.noise_rad()),
        "speed_deg_s": math.degrees(omega),
        "speed_sd_deg_s": math.degrees(row["omega_sd_rad_s"]),
        "expected_sd_deg_s": math.degrees(speed_sd(setting, omega if omega == omega else 0.0)),
        "smallest_5_deg_s": math.degrees(smallest_speed(setting, FIVE_PERCENT)),
        "smallest_deg_s": math.degrees(smallest_speed(setting, z)),
        "needed_s": needed,
    }


def _missing(settings: Settings, options: PlanOptions) -> list[str]:
    """Sentences on what is not given, or given twice."""
    mistakes: list[str] = []
    try:
        settings.require(*_MOVIE)
    except ConfigurationError as error:
        mistakes += error.mistakes
    if options.frames is None and options.duration_s is None:
        mistakes.append("the length of the movie is not known: give --frames or --duration-s")
    if options.frames is not None and options.duration_s is not None:
        mistakes.append("frames and duration_s are both given: give one of them")
    light = {
        "photons": options.photons,
        "background": options.background,
        "sigma_nm": options.sigma_nm,
        "pixel_size_nm": settings["movie"].pixel_size_nm,
    }
    absent = [f"--{name.replace('_', '-')}" for name, value in light.items() if value is None]
    if options.localisation_sd_nm is None and absent:
        mistakes.append(
            f"the localisation error is not known: give {', '.join(absent)}, or "
            "--localisation-sd-nm"
        )
    return mistakes


def _timing(settings: Settings) -> tuple[float, float]:
    """Frame interval and exposure, which fills the interval where it is not given."""
    interval_s = settings["movie"].frame_interval_s
    exposure_s = settings["movie"].exposure_s or interval_s
    if exposure_s > interval_s:
        raise ConfigurationError(
            f"exposure_s is {exposure_s:g}, longer than frame_interval_s {interval_s:g}: correct "
            "one of them"
        )
    return interval_s, exposure_s


def _precision(settings: Settings, options: PlanOptions) -> functools.partial[float] | None:
    """Localisation error by photons, None where background, width or pixel are not known."""
    pixel_size_nm = settings["movie"].pixel_size_nm
    if options.background is None or options.sigma_nm is None or pixel_size_nm is None:
        return None
    return functools.partial(
        bound_nm,
        background=options.background,
        sigma_nm=options.sigma_nm,
        pixel_size_nm=pixel_size_nm,
        read_noise_e=settings["camera"].read_noise_e or 0.0,
    )
