"""Speeds of rotors at each voltage, and how they change with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.motion.diffusion import Diffusion
from rotortrack.motion.line_fit import LineFit, fit_line
from rotortrack.motion.tables import VOLTAGE_SPEEDS
from rotortrack.motion.timed_steps import (
    SegmentSpeeds,
    fit_speeds,
    mean_pace,
    noise_of,
    steady,
    switching,
    timed_steps,
)
from rotortrack.motion.tracks import used_tracks
from rotortrack.motion.trigger import FrameClock
from rotortrack.motion.voltage import VoltageSteps
from rotortrack.tables import conform
from rotortrack.units import DEGREES_PER_RADIAN

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_ROUNDS = 3
_FEWEST_STEPS = 20


@dataclass(frozen=True)
class StepChange:
    """Speeds before and after one change of voltage.

    Attributes
    ----------
    step
        Number of the voltage step before it; the one after it has the next number.
    before_v, after_v
        The voltages.
    line
        Speeds after against speeds before, tested against the ratio of the voltages.
    """

    step: int
    before_v: float
    after_v: float
    line: LineFit

    @property
    def sentence(self) -> str:
        """Say it in words."""
        line = self.line
        factor = f"{line.slope:.3g} +- {line.slope_sd:.2g}"
        if not np.isfinite(line.slope):
            factor = "unknown size, too few turn fast enough"
        return (
            f"from {self.before_v:.3g} V to {self.after_v:.3g} V the speeds of {line.n} rotor(s) "
            f"change by a factor of {factor} (expected {line.ratio:.3g}: p = {line.p_slope:.2g}; "
            f"with an intercept: p = {line.p_line:.2g})"
        )


def step_edges_s(
    steps: VoltageSteps,
    clock: FrameClock,
    *,
    first_edge: int,
    frame_interval_s: float,
    exposure_s: float,
) -> Floats:
    """Give start and stop of each voltage step on the clock of the frames, shape (k, 2), s.

    An angle belongs to the middle of its exposure but is listed at the frame's start.
    """
    ends = np.stack([steps.start_s, steps.stop_s], axis=1) - 0.5 * exposure_s
    found: Floats = (clock.frame_at(ends) - first_edge) * frame_interval_s
    return found


def speeds_at_steps(
    frame: Integers,
    theta_rad: Floats,
    ends_s: Floats,
    *,
    frame_interval_s: float,
    exposure_s: float,
) -> tuple[SegmentSpeeds, Diffusion]:
    """Measure the speed of one rotor within given stretches of time, D and sigma^2 shared.

    Parameters
    ----------
    frame, theta_rad
        Frames, ascending without repeats, and angles (rad).
    ends_s
        Start and stop of each stretch, ascending, shape (k, 2), s since frame 0. What lies between
        gets a speed of its own that nobody asks for.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.

    Returns
    -------
    Speeds of the k stretches, nan where one has no steps or the noise is not known; and that noise.
    """
    times = {"frame_interval_s": frame_interval_s, "exposure_s": exposure_s}
    edges = np.concatenate([[-np.inf], ends_s.ravel(), [np.inf]])
    chosen = np.arange(1, edges.size - 1, 2)
    unknown = SegmentSpeeds(
        np.full(chosen.size, np.nan), np.full((chosen.size, chosen.size), np.nan), 0.0
    )
    drift = steady(mean_pace(frame, theta_rad, frame_interval_s))
    for _ in range(_ROUNDS):
        noise = noise_of(frame, theta_rad, drift, **times)
        if not np.isfinite(noise.cautious_rad2_s):
            return unknown, noise
        steps = timed_steps(frame, theta_rad, noise, drift, **times)
        found = fit_speeds(steps, edges)
        drift = switching(edges, found.omega_rad_s)
    speeds = SegmentSpeeds(
        found.omega_rad_s[chosen], found.covariance[np.ix_(chosen, chosen)], found.explained
    )
    return speeds, noise


def voltage_speeds(
    tracks: pd.DataFrame,
    rotors: pd.DataFrame,
    steps: VoltageSteps,
    ends_s: Floats,
    *,
    frame_interval_s: float,
    exposure_s: float,
) -> pd.DataFrame:
    """Build one row a kept rotor and voltage step, with its speed there.

    Parameters
    ----------
    tracks, rotors
        Tables of `build_tracks` and `screen`.
    steps, ends_s
        Voltage steps, and where they lie on the frames' clock (`step_edges_s`).
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.

    Returns
    -------
    DataFrame
        Columns of `motion.tables.VOLTAGE_SPEEDS`.
    """
    rows = []
    for number, track in used_tracks(tracks, rotors).items():
        frame, theta = track.frame, track.theta_rad
        if frame.size <= _FEWEST_STEPS:
            continue
        speeds, _ = speeds_at_steps(
            frame, theta, ends_s, frame_interval_s=frame_interval_s, exposure_s=exposure_s
        )
        time_s = frame * frame_interval_s
        for k, (start, stop) in enumerate(ends_s.tolist()):
            omega, sd = float(speeds.omega_rad_s[k]), float(speeds.sd_rad_s[k])
            rows.append(
                {
                    "rotor": number,
                    "step": k,
                    "voltage_v": steps.voltage_v[k],
                    "voltage_sd_v": steps.voltage_sd_v[k],
                    "start_s": start,
                    "stop_s": stop,
                    "n_frames": int(np.count_nonzero((time_s >= start) & (time_s <= stop))),
                    "omega_rad_s": omega,
                    "omega_sd_rad_s": sd,
                    "speed_deg_s": omega * DEGREES_PER_RADIAN,
                    "speed_sd_deg_s": sd * DEGREES_PER_RADIAN,
                }
            )
    table = pd.DataFrame(rows, columns=VOLTAGE_SPEEDS.names)
    return conform(table, VOLTAGE_SPEEDS, "voltage_speeds")


def step_changes(speeds: pd.DataFrame) -> list[StepChange]:
    """Compare the speeds before and after every change of voltage from other than 0 V."""
    found = []
    for step in range(int(speeds["step"].max()) if len(speeds) else 0):
        before, after = (
            speeds[speeds["step"] == number].set_index("rotor") for number in (step, step + 1)
        )
        before_v, after_v = (float(part["voltage_v"].iloc[0]) for part in (before, after))
        if abs(before_v) < 1e-3 * abs(after_v) or before_v == 0.0:
            continue
        after = after.loc[before.index]
        values = [
            part[name].to_numpy(np.float64)
            for part in (before, after)
            for name in ("omega_rad_s", "omega_sd_rad_s")
        ]
        line = fit_line(*values, ratio=after_v / before_v)
        found.append(StepChange(step, before_v, after_v, line))
    return found
