"""Switches of a rotor's speed or direction: how many, when, and how surely.

Diffusion and the noise that neighbouring steps share decide how far the mean step wanders by
chance; the plain variance of a step, mostly localisation noise, says next to nothing of it. All
statistics here are those of the exact covariance of the steps (`timed_steps`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotortrack.motion.diffusion import UNKNOWN, Diffusion
from rotortrack.motion.residuals import UNTESTED, Whiteness, whiteness
from rotortrack.motion.switch_scan import Scan
from rotortrack.motion.switch_time import SwitchTime, place_switch
from rotortrack.motion.timed_steps import (
    SegmentSpeeds,
    TimedSteps,
    fit_speeds,
    mean_pace,
    noise_of,
    steady,
    switching,
    timed_steps,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_MOST_ROUNDS = 5
_FEWEST_STEPS = 20
_SURE_Z = 2.0


@dataclass(frozen=True)
class Switches:
    """Switches of one rotor in order of time, and the speeds between them.

    Attributes
    ----------
    times
        When the k switches were.
    statistic
        How much the weighted sum of squares falls by each of them, shape (k,).
    threshold
        Least statistic of a switch; nan where the track is too short to look for one.
    largest
        Statistic of the best single switch, found or not.
    speeds
        Signed speeds of the k + 1 segments; none where the threshold is nan.
    noise
        D and sigma^2 that all segments share.
    white
        Tests of what is left beside the switches: a rotor that sticks and slips seems to switch
        all the time, but its residuals stay uneven.
    """

    times: tuple[SwitchTime, ...]
    statistic: Floats
    threshold: float
    largest: float
    speeds: SegmentSpeeds
    noise: Diffusion
    white: Whiteness

    def __len__(self) -> int:
        return len(self.times)

    @property
    def edges_s(self) -> Floats:
        """Bounds of the segments, the outer ones infinite."""
        return np.array([-np.inf, *(switch.time_s for switch in self.times), np.inf])

    @property
    def reverses(self) -> NDArray[np.bool_]:
        """Whether each switch is one of direction: both speeds differ from zero by 2 sd."""
        z = self.speeds.omega_rad_s / self.speeds.sd_rad_s
        sure = np.abs(z) > _SURE_Z
        turned: NDArray[np.bool_] = (z[1:] * z[:-1] < 0.0) & sure[1:] & sure[:-1]
        return turned


def find_switches(
    frame: Integers,
    theta_rad: Floats,
    *,
    frame_interval_s: float,
    exposure_s: float,
    min_segment_s: float = 0.5,
    false_alarm: float = 0.01,
    seed: int = 0,
) -> Switches:
    """Find the times at which a rotor changes its speed.

    The best cut into segments of constant speed is that of least weighted squares plus a penalty a
    switch, found by optimal partitioning with pruning. The penalty is the value that the best
    single switch exceeds with probability `false_alarm` in rotors that never switch: steps with
    this rotor's D, sigma, frames and gaps are simulated to learn it. Each switch is then placed by
    the exact likelihood of all frames between its neighbours, and dropped where its statistic does
    not reach the penalty after all. With the speeds found, D and sigma^2 are estimated anew.

    Parameters
    ----------
    frame, theta_rad
        Frames, ascending without repeats, and angles (rad), shape (n,).
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.
    min_segment_s
        Least time between switches, and from the ends of the track.
    false_alarm
        Part of rotors without a switch in which one is found.
    seed
        Of the simulation; the same seed gives the same switches.

    Notes
    -----
    A gap is crossed by the step nearest to the expected one and left out where that is not known.
    Cost: see `tests/benchmarks/switches.py`; most of it is the simulation.
    Sources: Killick et al., JASA 107, 1590 (2012) for the pruning; Hinkley, Biometrika 57, 1 (1970)
    for the likelihood of the time.
    """
    times = {"frame_interval_s": frame_interval_s, "exposure_s": exposure_s}
    if frame.size <= _FEWEST_STEPS:
        return _nothing(UNKNOWN)
    drift = steady(mean_pace(frame, theta_rad, frame_interval_s))
    placed: tuple[SwitchTime, ...] = ()
    threshold = np.nan
    for _ in range(_MOST_ROUNDS):
        noise = noise_of(frame, theta_rad, drift, **times)
        if not np.isfinite(noise.cautious_rad2_s):
            return _nothing(noise)
        steps = timed_steps(frame, theta_rad, noise, drift, **times)
        if len(steps) <= _FEWEST_STEPS:
            return _nothing(noise)
        scan = Scan(steps, min_segment_s)
        if not scan.has_room:
            return _nothing(noise)
        if np.isnan(threshold):
            threshold = scan.threshold(false_alarm, _freedom(noise), seed)
        before, placed = placed, _placed(steps, scan.partition(threshold), min_segment_s)
        placed = _strong(steps, placed, min_segment_s, threshold)
        found = Switches(
            times=placed,
            statistic=_statistic(steps, placed),
            threshold=threshold,
            largest=scan.best_single(),
            speeds=fit_speeds(steps, _edges(placed)),
            noise=noise,
            white=UNTESTED,
        )
        if placed == before:
            break
        drift = switching(found.edges_s, found.speeds.omega_rad_s)
    return replace(
        found, white=_white(frame * np.float64(frame_interval_s), theta_rad, found, steps)
    )


def _nothing(noise: Diffusion) -> Switches:
    """Say that no switch could be looked for."""
    none = SegmentSpeeds(np.empty(0), np.empty((0, 0)), 0.0)
    return Switches((), np.empty(0), np.nan, np.nan, none, noise, UNTESTED)


def _white(time_s: Floats, theta_rad: Floats, found: Switches, steps: TimedSteps) -> Whiteness:
    drift = switching(found.edges_s, found.speeds.omega_rad_s)
    turn = drift(steps.start_s, steps.stop_s)
    # Each is the deviation from what all steps before tell, as is the direction it starts from.
    left = steps.whitened(steps.step_rad - turn)
    return whiteness(left, theta_rad[np.searchsorted(time_s, steps.start_s)])


def _freedom(noise: Diffusion) -> float:
    """Degrees of freedom of D, which is the variance of long displacements."""
    variance = noise.diffusion_sd_rad2_s**2
    return max(2.0 * noise.cautious_rad2_s**2 / variance, 1.0) if variance > 0.0 else np.inf


def _edges(placed: tuple[SwitchTime, ...]) -> Floats:
    return np.array([-np.inf, *(switch.time_s for switch in placed), np.inf])


def _placed(steps: TimedSteps, rough_s: Floats, min_segment_s: float) -> tuple[SwitchTime, ...]:
    """Place each switch between its neighbours, twice, since these move, too."""
    placed = tuple(SwitchTime(time, time, time) for time in rough_s.tolist())
    for _ in range(1 if len(placed) == 1 else 2):
        for k in range(len(placed)):
            low_s, _, high_s = _edges(placed)[k : k + 3]
            start, stop = np.searchsorted(steps.start_s, [low_s, high_s])
            between = place_switch(steps.part(int(start), int(stop)), min_segment_s)
            placed = (*placed[:k], between, *placed[k + 1 :])
    return placed


def _statistic(steps: TimedSteps, placed: tuple[SwitchTime, ...]) -> Floats:
    """Give how much less is explained without each switch, all others kept."""
    whole = fit_speeds(steps, _edges(placed)).explained
    without = [placed[:k] + placed[k + 1 :] for k in range(len(placed))]
    return np.array([whole - fit_speeds(steps, _edges(rest)).explained for rest in without])


def _strong(
    steps: TimedSteps, placed: tuple[SwitchTime, ...], min_segment_s: float, threshold: float
) -> tuple[SwitchTime, ...]:
    """Drop the weakest switch until all reach the threshold."""
    while placed:
        statistic = _statistic(steps, placed)
        weakest = int(np.argmin(statistic))
        if statistic[weakest] >= threshold:
            break
        left = np.array([s.time_s for s in placed[:weakest] + placed[weakest + 1 :]])
        placed = _placed(steps, left, min_segment_s)
    return placed
