"""From tracks to the motion columns of the rotors table."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.errors import AngleWarning, ConfigurationError, ExposureWarning, TableError
from rotortrack.motion.angles import GapMode, consecutive_steps, fitted_radius
from rotortrack.motion.behaviour import Behaviour, classify
from rotortrack.motion.blur import radius_factor
from rotortrack.motion.diffusion import UNKNOWN, Diffusion, estimate_diffusion
from rotortrack.motion.increments import StepSizes, increments, step_sizes
from rotortrack.motion.msd import MSDFit, fit_msd, msd
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.speed import Speed, estimate_speed
from rotortrack.tables import ROTORS, conform
from rotortrack.units import DEGREES_PER_RADIAN, TURN_RAD

Floats = NDArray[np.float64]

_NAN = float("nan")
_NAMED_IN_WARNING = 10


@dataclass(frozen=True)
class Motion:
    """Everything that the motion of one rotor is reported by."""

    speed: Speed
    diffusion: Diffusion
    steps: StepSizes
    msd_fit: MSDFit
    behaviour: Behaviour

    def row(self) -> dict[str, object]:
        """Motion columns of `tables.ROTORS`."""
        low, high = self.speed.interval()
        return {
            "behaviour": self.behaviour,
            "omega_rad_s": self.speed.omega_rad_s,
            "omega_sd_rad_s": self.speed.omega_sd_rad_s,
            "speed_deg_s": self.speed.omega_rad_s * DEGREES_PER_RADIAN,
            "speed_ci_low_deg_s": low * DEGREES_PER_RADIAN,
            "speed_ci_high_deg_s": high * DEGREES_PER_RADIAN,
            "rev_per_s": self.speed.omega_rad_s / TURN_RAD,
            "diffusion_rad2_s": self.diffusion.diffusion_rad2_s,
            "diffusion_sd_rad2_s": self.diffusion.diffusion_sd_rad2_s,
            "msd_speed_deg_s": self.msd_fit.speed_rad_s * DEGREES_PER_RADIAN,
            "msd_diffusion_rad2_s": self.msd_fit.diffusion_rad2_s,
            "msd_lag_min_s": self.msd_fit.lag_min_s,
            "msd_lag_max_s": self.msd_fit.lag_max_s,
            "msd_at_bound": self.msd_fit.at_bound,
            "n_steps": self.steps.n_steps,
            "step_sd_rad": self.steps.sd_rad,
        }


NOT_MEASURED = Motion(
    speed=Speed(_NAN, _NAN, _NAN, _NAN),
    diffusion=UNKNOWN,
    steps=StepSizes(_NAN, _NAN, 0),
    msd_fit=MSDFit(_NAN, _NAN, _NAN, _NAN, _NAN, at_bound=False),
    behaviour="unclassified",
)


def measure_motion(
    tracks: pd.DataFrame,
    rotors: pd.DataFrame,
    options: MotionOptions,
    *,
    frame_interval_s: float,
    exposure_s: float | None,
) -> pd.DataFrame:
    """Return the rotors table with speed, diffusion, MSD fit, steps and behaviour filled in.

    The radius is corrected for motion during the exposure; `radius_fit_nm` keeps the fitted one.

    Parameters
    ----------
    tracks
        Table of `angles.build_tracks`; rows with `used` false or without an angle are left out.
    rotors
        Rotors table. Where it has a verdict, only kept rotors are measured; all others, and
        rotors without a track, get nan and the behaviour `unclassified`.
    options
        How to measure.
    frame_interval_s
        Time between frame starts, s.
    exposure_s
        Exposure of a frame, s; not given, it is taken to fill the frame interval.

    Raises
    ------
    ConfigurationError
        The exposure exceeds the frame interval.
    TableError
        The tracks have no angles.

    Warns
    -----
    ExposureWarning
        The exposure is not given.
    AngleWarning
        Steps of a measured rotor are so wide that the 180-degree rule shortens its speed.
    """
    if exposure_s is None:
        warnings.warn(
            "exposure_s is not given, so exposures are taken to fill the frame interval of "
            f"{frame_interval_s:g} s; diffusion coefficients depend on it: give exposure_s",
            ExposureWarning,
            stacklevel=2,
        )
        exposure_s = frame_interval_s
    if exposure_s > frame_interval_s:
        raise ConfigurationError(
            f"exposure_s is {exposure_s:g}, longer than frame_interval_s {frame_interval_s:g}: "
            "correct one of them"
        )
    if "theta_rad" not in tracks.columns:
        raise TableError("the tracks lack the column theta_rad: build them from localisations")
    kept = rotors["verdict"] == "kept" if "verdict" in rotors.columns else rotors["rotor"] >= 0
    wanted = set(rotors.loc[kept, "rotor"])
    measurable = tracks["rotor"].isin(wanted) & tracks["theta_rad"].notna()
    if "used" in tracks.columns:
        measurable &= tracks["used"]
    used = tracks.loc[measurable, ["rotor", "frame", "theta_rad"]]
    found = {
        number: measure_rotor(
            track["frame"].to_numpy("int64"),
            track["theta_rad"].to_numpy("float64"),
            options,
            frame_interval_s=frame_interval_s,
            exposure_s=exposure_s,
        )
        for number, track in used.sort_values(["rotor", "frame"]).groupby("rotor")
    }
    folded = [str(number) for number, motion in found.items() if motion.steps.folded]
    if folded:
        names = ", ".join(folded[:_NAMED_IN_WARNING])
        more = ", ..." if len(folded) > _NAMED_IN_WARNING else ""
        warnings.warn(
            f"{len(folded)} rotor(s) take steps wider than the 180-degree rule can tell apart "
            f"(standard deviation over 55 or mean over 90 degrees), so their speeds are too low "
            f"and their behaviour stays unclassified: {names}{more}; use a shorter "
            "frame interval or more photons, and do not bridge gaps",
            AngleWarning,
            stacklevel=2,
        )
    measured = [found.get(number, NOT_MEASURED) for number in rotors["rotor"]]
    rows = [motion.row() for motion in measured]
    motion = pd.DataFrame(rows, columns=list(NOT_MEASURED.row()), index=rotors.index)
    others = rotors.drop(columns=motion.columns, errors="ignore")
    fitted = fitted_radius(rotors)
    factors = [
        # Where the motion is not understood, neither is its blur.
        1.0
        if one.behaviour == "unclassified"
        else radius_factor(one.speed.omega_rad_s, one.diffusion.diffusion_rad2_s, exposure_s)
        for one in measured
    ]
    others = others.assign(radius_fit_nm=fitted, radius_nm=fitted / np.array(factors))
    return conform(pd.concat([others, motion], axis=1), ROTORS, "rotors")


def measure_rotor(
    frame: NDArray[np.int64],
    theta_rad: Floats,
    options: MotionOptions,
    *,
    frame_interval_s: float,
    exposure_s: float,
) -> Motion:
    """Measure the motion of one rotor.

    Parameters
    ----------
    frame
        Frames with a localisation, ascending without repeats, shape (n,).
    theta_rad
        Angles in them, rad.
    options, frame_interval_s, exposure_s
        As for `measure_motion`.
    """
    if frame.size < 2:
        return NOT_MEASURED
    moves = increments(frame, theta_rad, options.gap_mode)
    diffusion = estimate_diffusion(moves, frame_interval_s=frame_interval_s, exposure_s=exposure_s)
    speed = estimate_speed(
        moves, diffusion, frame_interval_s=frame_interval_s, exposure_s=exposure_s
    )
    steps = step_sizes(moves)
    span = int(frame[-1] - frame[0])
    lags = options.msd_lags or max(span // 4, 2)
    curve = msd(unbroken_angle(frame, theta_rad, options.gap_mode), lags)
    duration_s = span * frame_interval_s
    # Time averages of exp(2 i theta) scatter by 1 / sqrt(2 D T) for a rotor that only diffuses.
    spread = np.sqrt(2.0 * max(diffusion.diffusion_rad2_s, 0.0) * duration_s)
    poles = float(abs(np.exp(2j * theta_rad).mean()) * spread)
    return Motion(
        speed=speed,
        diffusion=diffusion,
        steps=steps,
        msd_fit=fit_msd(curve, frame_interval_s, lags=lags, noise=options.msd_noise),
        behaviour=classify(
            speed,
            diffusion,
            steps,
            duration_s,
            options,
            pole_strength=0.0 if np.isnan(poles) else poles,
        ),
    )


def unbroken_angle(
    frame: NDArray[np.int64], theta_rad: Floats, gap_mode: GapMode = "drop"
) -> Floats:
    """Cumulative angle in every frame from the first to the last, nan where there is none.

    Gaps are crossed as in `angles.consecutive_steps`.
    """
    cumulative = np.full(int(frame[-1] - frame[0]) + 1, np.nan)
    turned = np.cumsum(consecutive_steps(theta_rad, frame, gap_mode))
    cumulative[frame - frame[0]] = np.concatenate(([0.0], turned))
    return cumulative
