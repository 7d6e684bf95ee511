"""From tracks to the motion columns of the rotors table."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack import parallel
from rotortrack.errors import AngleWarning, ConfigurationError, ExposureWarning, TableError
from rotortrack.motion.angle_profile import AngleProfile, angle_profile
from rotortrack.motion.angles import fitted_radius, unbroken_angle
from rotortrack.motion.behaviour import NOT_CLASSIFIED, Behaviour, classify
from rotortrack.motion.blur import radius_factor
from rotortrack.motion.changepoints import Switches, find_switches
from rotortrack.motion.energetics import UNKNOWN_ENERGETICS, Energetics, energetics
from rotortrack.motion.estimate import NOT_ESTIMATED, MotionEstimate, Reason, estimate_motion
from rotortrack.motion.increments import StepSizes, increments, step_sizes
from rotortrack.motion.msd import MSDFit, fit_msd, msd
from rotortrack.motion.msd_fit import NOT_FITTED, WeightedFit, fit_msd_weighted
from rotortrack.motion.msd_table import RotorMSD, common_lags, msd_table, rotor_msd
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.population import false_discovery_rate, paper_class
from rotortrack.motion.switch_table import switch_table
from rotortrack.motion.tables import POSTERIOR, PROFILES
from rotortrack.motion.tilted_potential import NO_POTENTIAL
from rotortrack.motion.tracks import Track, used_tracks
from rotortrack.tables import ROTORS, conform, empty
from rotortrack.units import DEGREES_PER_RADIAN, TURN_RAD

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_NAN = float("nan")
_NAMED_IN_WARNING = 10
_TURNING_FREELY = ("driven_ccw", "driven_cw", "brownian")
"""Behaviours whose D is that of free diffusion about one speed, as torque and friction need."""


@dataclass(frozen=True)
class Measured:
    """Rotors with their motion, and what belongs to single switches, frames and angles.

    Attributes
    ----------
    rotors, switches, posterior, profiles, msd
        Columns of ROTORS (`rotortrack.tables`), SWITCHES, POSTERIOR, PROFILES and MSDS
        (`rotortrack.motion.tables`).
    """

    rotors: pd.DataFrame
    switches: pd.DataFrame
    posterior: pd.DataFrame
    profiles: pd.DataFrame
    msd: pd.DataFrame


@dataclass(frozen=True)
class Motion:
    """Everything that the motion of one rotor is reported by."""

    estimate: MotionEstimate
    steps: StepSizes
    msd_fit: MSDFit
    weighted_fit: WeightedFit
    msd: RotorMSD | None
    switches: Switches | None
    behaviour: Behaviour
    energetics: Energetics
    profile: AngleProfile | None

    def row(self, estimator: str = "auto") -> dict[str, object]:
        """Motion columns of `tables.ROTORS`."""
        fit = self.estimate.fit
        low, high = fit.diffusion_interval_rad2_s
        told = {
            "omega_sd_rad_s": fit.omega_sd_rad_s,
            "speed_ci_low_deg_s": fit.omega_interval_rad_s[0] * DEGREES_PER_RADIAN,
            "speed_ci_high_deg_s": fit.omega_interval_rad_s[1] * DEGREES_PER_RADIAN,
            "diffusion_sd_rad2_s": fit.diffusion_sd_rad2_s,
            "diffusion_ci_low_rad2_s": low,
            "diffusion_ci_high_rad2_s": high,
        }
        omega, diffusion = fit.omega_rad_s, fit.diffusion_rad2_s
        method: str = self.estimate.method
        reason = self.estimate.reason.value
        if estimator == "paper":
            omega, diffusion = self.msd_fit.speed_rad_s, self.msd_fit.diffusion_rad2_s
            method, reason = "paper", "asked_for"
            told = dict.fromkeys(told, _NAN)
        return {
            "behaviour": self.behaviour.name,
            "behaviour_evidence": self.behaviour.evidence,
            "behaviour_margin": self.behaviour.margin,
            "paper_class": paper_class(self.msd_fit.speed_rad_s * DEGREES_PER_RADIAN),
            "omega_rad_s": omega,
            "speed_deg_s": omega * DEGREES_PER_RADIAN,
            "rev_per_s": omega / TURN_RAD,
            "diffusion_rad2_s": diffusion,
            **told,
            "drift_p": fit.drift_p,
            "theta_noise_rad": self.estimate.noise_sd_rad,
            "speed_method": method,
            "speed_reason": reason,
            "residuals_p": self.estimate.white.p,
            "resampled": self.estimate.resampled,
            "n_switches": 0 if self.switches is None else len(self.switches),
            **self.energetics.row(),
            **(NO_POTENTIAL if self.profile is None else self.profile.potential).row(),
            "msd_speed_deg_s": self.msd_fit.speed_rad_s * DEGREES_PER_RADIAN,
            "msd_diffusion_rad2_s": self.msd_fit.diffusion_rad2_s,
            "msd_lag_min_s": self.msd_fit.lag_min_s,
            "msd_lag_max_s": self.msd_fit.lag_max_s,
            "msd_at_bound": self.msd_fit.at_bound,
            **self.weighted_fit.row(),
            "n_steps": self.steps.n_steps,
            "step_sd_rad": self.steps.sd_rad,
            "wrapped_step_rad": self.steps.wrapped_mean_rad,
            "wrapped_step_sd_rad": self.steps.wrapped_sd_rad,
        }


NOT_MEASURED = Motion(
    estimate=replace(NOT_ESTIMATED, reason=Reason.NOT_MEASURED),
    steps=StepSizes(_NAN, _NAN, 0),
    msd_fit=MSDFit(_NAN, _NAN, _NAN, _NAN, _NAN, at_bound=False),
    weighted_fit=NOT_FITTED,
    msd=None,
    switches=None,
    behaviour=NOT_CLASSIFIED,
    energetics=UNKNOWN_ENERGETICS,
    profile=None,
)


def measure_motion(
    tracks: pd.DataFrame,
    rotors: pd.DataFrame,
    options: MotionOptions,
    *,
    frame_interval_s: float,
    exposure_s: float | None,
    workers: int = 1,
) -> Measured:
    """Fill the rotors table with speed, diffusion, MSD fit, steps and behaviour.

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
    workers
        Threads that share the rotors; results do not depend on it.

    Raises
    ------
    ConfigurationError
        The exposure exceeds the frame interval.
    TableError
        The tracks have no angles or positions.

    Warns
    -----
    ExposureWarning
        The exposure is not given.
    AngleWarning
        Steps of a measured rotor are so wide that the 180-degree rule shortens its cumulative
        angle.

    Examples
    --------
    >>> import numpy as np, pandas as pd, rotortrack as rt
    >>> turn, noise = 0.08 * np.arange(200), np.random.default_rng(1).normal(0.0, 8.0, (2, 200))
    >>> x, y = 500.0 + 120.0 * np.array([np.cos(turn), -np.sin(turn)]) + noise
    >>> spots = pd.DataFrame({"frame": np.arange(200), "x_nm": x, "y_nm": y})
    >>> spots = spots.assign(uncertainty_nm=8.0, x_sd_nm=8.0, y_sd_nm=8.0, photons=500.0)
    >>> found = rt.find_rotors(spots)
    >>> judged = rt.screen(found.localisations, found.rotors, n_frames=200)
    >>> tracks = rt.build_tracks(
    ...     found.localisations, judged.rotors, frame_interval_s=0.002, gap_mode="drop"
    ... )
    >>> measured = rt.measure_motion(
    ...     tracks, judged.rotors, rt.MotionOptions(), frame_interval_s=0.002, exposure_s=0.002
    ... )
    >>> round(measured.rotors["omega_rad_s"].iloc[0])
    40
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
    for name in ("theta_rad", "x_nm", "y_nm"):
        if name not in tracks.columns:
            raise TableError(f"the tracks lack the column {name}: build them from localisations")
    seen = used_tracks(tracks, rotors)
    shutter_s = exposure_s
    lags = common_lags(seen.values())
    motions = parallel.map_ordered(
        lambda track: measure_rotor(
            track,
            options,
            frame_interval_s=frame_interval_s,
            exposure_s=shutter_s,
            table_lags=lags,
        ),
        seen.values(),
        workers=workers,
    )
    found = dict(zip(seen, motions, strict=True))
    _warn_of_wide_steps(found)
    measured = [found.get(number, NOT_MEASURED) for number in rotors["rotor"]]
    motion = pd.DataFrame(
        [one.row(options.estimator) for one in measured],
        columns=list(NOT_MEASURED.row()),
        index=rotors.index,
    )
    motion["drift_q"] = false_discovery_rate(motion["drift_p"].to_numpy("float64"))
    others = rotors.drop(columns=motion.columns, errors="ignore")
    fitted = fitted_radius(rotors)
    factors = [
        # Where the motion is not understood, neither is its blur.
        1.0
        if one.behaviour.name == "unclassified"
        else radius_factor(
            one.estimate.fit.omega_rad_s, one.estimate.fit.diffusion_rad2_s, exposure_s
        )
        for one in measured
    ]
    others = others.assign(radius_fit_nm=fitted, radius_nm=fitted / np.array(factors))
    return Measured(
        rotors=conform(pd.concat([others, motion], axis=1), ROTORS, "rotors"),
        switches=switch_table(
            {number: one.switches for number, one in found.items() if one.switches is not None},
            frame_interval_s=frame_interval_s,
        ),
        posterior=_posterior_table(seen, found),
        profiles=_profiles_table(found),
        msd=msd_table(
            {number: one.msd for number, one in found.items() if one.msd is not None},
            frame_interval_s=frame_interval_s,
        ),
    )


def measure_rotor(
    track: Track,
    options: MotionOptions,
    *,
    frame_interval_s: float,
    exposure_s: float,
    table_lags: Integers | None = None,
) -> Motion:
    """Measure the motion of one rotor.

    Parameters
    ----------
    track
        What was seen of it.
    options, frame_interval_s, exposure_s
        As for `measure_motion`.
    table_lags
        Lags of the mean-square displacements to tell, frames; none when not given.
    """
    frame, theta_rad = track.frame, track.theta_rad
    if frame.size < 2:
        return NOT_MEASURED
    method: Literal["auto", "increments", "circular"] = (
        "auto" if options.estimator == "paper" else options.estimator
    )
    estimate = estimate_motion(
        frame,
        track.x_nm,
        track.y_nm,
        track.x_sd_nm,
        track.y_sd_nm,
        track.circle,
        frame_interval_s=frame_interval_s,
        exposure_s=exposure_s,
        method=method,
    )
    turn_rad = estimate.fit.omega_rad_s * frame_interval_s
    steps = step_sizes(increments(frame, theta_rad, options.gap_mode, turn_rad))
    span = int(frame[-1] - frame[0])
    lags = options.msd_lags or max(span // 4, 2)
    cumulative = unbroken_angle(frame, theta_rad, options.gap_mode, turn_rad)
    curve = msd(cumulative, max(lags, span // 2))
    weighted, rows = NOT_FITTED, None
    if options.msd_covariance:
        weighted = fit_msd_weighted(
            curve,
            np.isfinite(cumulative),
            lags=lags,
            frame_interval_s=frame_interval_s,
            exposure_s=exposure_s,
        )
    if table_lags is not None:
        rows = rotor_msd(
            track,
            curve,
            estimate,
            table_lags,
            frame_interval_s=frame_interval_s,
            exposure_s=exposure_s,
        )
    # What passes for a switch where steps outgrow the 180-degree rule may be a turn that was lost.
    switches = None
    if not steps.folded:
        switches = find_switches(
            frame,
            theta_rad,
            frame_interval_s=frame_interval_s,
            exposure_s=exposure_s,
            min_segment_s=options.switch_min_s,
            false_alarm=options.switch_false_alarm,
        )
    behaviour = classify(
        estimate,
        steps,
        frame,
        theta_rad,
        switches,
        frame_interval_s=frame_interval_s,
        options=options,
    )
    free = behaviour.name in _TURNING_FREELY
    return Motion(
        estimate=estimate,
        steps=steps,
        msd_fit=fit_msd(curve, frame_interval_s, lags=lags, noise=options.msd_noise),
        weighted_fit=weighted,
        msd=rows,
        switches=switches,
        behaviour=behaviour,
        energetics=(
            energetics(estimate.fit, options.temperature_k) if free else UNKNOWN_ENERGETICS
        ),
        profile=angle_profile(estimate, frame, theta_rad, frame_interval_s=frame_interval_s),
    )


def _warn_of_wide_steps(found: dict[int, Motion]) -> None:
    folded = [str(number) for number, motion in found.items() if motion.steps.folded]
    if not folded:
        return
    names = ", ".join(folded[:_NAMED_IN_WARNING])
    more = ", ..." if len(folded) > _NAMED_IN_WARNING else ""
    warnings.warn(
        f"{len(folded)} rotor(s) take steps wider than the 180-degree rule can tell apart "
        "(standard deviation over 55 or mean over 90 degrees), so their cumulative angles and "
        f"MSD fits turn too little: {names}{more}; go by speed_deg_s where there is one, or use "
        "a shorter frame interval or more photons",
        AngleWarning,
        stacklevel=3,
    )


def _posterior_table(seen: dict[int, Track], found: dict[int, Motion]) -> pd.DataFrame:
    parts = []
    for number, track in seen.items():
        told = found[number].estimate.posterior
        if told is None:
            continue
        rows = np.zeros(told.frame.size, np.bool_)
        rows[track.frame - told.frame[0]] = True
        parts.append({"rotor": np.full(rows.size, number), "seen": rows, **vars(told)})
    names = POSTERIOR.names
    joined = {
        name: np.concatenate([part[name] for part in parts]) if parts else np.empty(0)
        for name in names
    }
    return conform(pd.DataFrame(joined, columns=names), POSTERIOR, "posterior")


def _profiles_table(found: dict[int, Motion]) -> pd.DataFrame:
    parts = [one.profile.table(number) for number, one in found.items() if one.profile is not None]
    joined = pd.concat(parts, ignore_index=True) if parts else empty(PROFILES)
    return conform(joined, PROFILES, "profiles")
