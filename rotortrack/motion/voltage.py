"""The voltage during each frame and the stretches of constant voltage, from one recorded trace."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.motion.trigger import FrameClock

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_MOST_BINS_PER_STEP = 100
_CLEAR = 8.0
"""Robust standard deviations of level differences by which a change of voltage is told."""

_LEAST_CHANGE = 0.03
_MOST_WANDER = 0.1
"""Parts of the whole range that a change needs at least, and that a stretch may drift at most."""

_SETTLED = 0.05
"""Part of a change within which the voltage has settled."""


@dataclass(frozen=True)
class VoltageSteps:
    """Stretches of constant voltage, with what lies between them left out.

    Attributes
    ----------
    start_s, stop_s
        Ends on the trace's clock, s, shape (k,).
    voltage_v, voltage_sd_v
        Mean and standard deviation of the samples within, V.
    """

    start_s: Floats
    stop_s: Floats
    voltage_v: Floats
    voltage_sd_v: Floats

    def __len__(self) -> int:
        return self.start_s.size


@dataclass(frozen=True)
class FrameVoltages:
    """Voltage over the exposure of each frame, nan where the trace does not cover it.

    Attributes
    ----------
    start_s
        Start of the exposure on the trace's clock, s, shape (n,).
    mean_v, min_v, max_v
        Over the exposure alone, not the whole frame interval, V.
    step
        Number of the stretch of constant voltage that holds the whole exposure; -1 for none.
    """

    start_s: Floats
    mean_v: Floats
    min_v: Floats
    max_v: Floats
    step: Integers

    @property
    def transition(self) -> NDArray[np.bool_]:
        """Whether the voltage was not constant, or is not known, during the exposure."""
        return self.step < 0


def frame_voltages(
    time_s: Floats,
    voltage_v: Floats,
    clock: FrameClock,
    steps: VoltageSteps,
    *,
    n_frames: int,
    first_edge: int = 0,
    exposure_s: float,
) -> FrameVoltages:
    """Measure the voltage over each frame's own exposure.

    Between samples the voltage runs straight, so an exposure shorter than the sampling interval
    has a voltage, too.

    Parameters
    ----------
    time_s, voltage_v
        Samples, ascending in time.
    clock, steps
        Of the same trace.
    n_frames
        Frames of the movie, from frame 0.
    first_edge
        Edges before the one that began frame 0.
    exposure_s
        Exposure, s.
    """
    start_s = np.full(n_frames, np.nan)
    known = clock.time_s[first_edge : first_edge + n_frames]
    start_s[: known.size] = known
    stop_s = start_s + exposure_s
    covered = (start_s >= time_s[0]) & (stop_s <= time_s[-1])
    begin, end = start_s[covered], stop_s[covered]
    step = np.full(n_frames, -1, np.int64)
    within = np.searchsorted(steps.start_s, begin, side="right") - 1
    ended = np.append(steps.stop_s, -np.inf)[within]
    step[covered] = np.where((within >= 0) & (end <= ended), within, -1)
    mean, low, high = (np.full(n_frames, np.nan) for _ in range(3))
    middle_v = float(voltage_v.mean())
    swing = voltage_v - middle_v
    area = np.concatenate([[0.0], np.cumsum(0.5 * (swing[1:] + swing[:-1]) * np.diff(time_s))])
    mean[covered] = (
        middle_v
        + (_area_up_to(end, time_s, swing, area) - _area_up_to(begin, time_s, swing, area))
        / exposure_s
    )
    ends = np.stack([np.interp(begin, time_s, voltage_v), np.interp(end, time_s, voltage_v)])
    first, last = np.searchsorted(time_s, begin), np.searchsorted(time_s, end)
    low[covered] = np.minimum(ends.min(axis=0), _reduced(np.minimum, voltage_v, first, last))
    high[covered] = np.maximum(ends.max(axis=0), _reduced(np.maximum, voltage_v, first, last))
    return FrameVoltages(start_s, mean, low, high, step)


def voltage_steps(time_s: Floats, voltage_v: Floats, *, min_step_s: float) -> VoltageSteps:
    """Cut a trace into stretches of constant voltage.

    The level of half a `min_step_s` after each moment is compared with that before it; where the
    difference is largest, and clear of its usual size (8 robust standard deviations and 3 % of the
    whole range), the voltage changed. A change lasts from the last sample near the old level to the
    first one near the new level. What is shorter than `min_step_s`, or drifts by 10 % of the whole
    range, such as a ramp, is no stretch.

    Parameters
    ----------
    time_s, voltage_v
        Samples, ascending in time.
    min_step_s
        Shortest stretch, s. Pickup of the mains averages out when it is 0.2 s.
    """
    if not time_s.size:
        nothing = np.empty(0)
        return VoltageSteps(nothing, nothing, nothing, nothing)
    bins = max(int((time_s[-1] - time_s[0]) / min_step_s * _MOST_BINS_PER_STEP), 1)
    edges_s = np.linspace(time_s[0], time_s[-1], bins + 1)
    cut = np.unique(np.searchsorted(time_s, edges_s[:-1]))
    counts = np.diff(np.append(cut, time_s.size))
    level = np.add.reduceat(voltage_v, cut) / counts
    bin_s = time_s[cut]
    pace_s = (time_s[-1] - time_s[0]) / max(level.size, 1)
    half = max(round(0.5 * min_step_s / max(pace_s, 1e-300)), 1)
    rise = _rises(level, half)
    usual = 1.4826 * float(np.median(rise)) if rise.size else 0.0
    least = max(_CLEAR * usual, _LEAST_CHANGE * float(np.ptp(level)), 1e-12)
    changes = [int(cut[k]) for k in _changes(rise, least, half)]
    marks = [0, *changes, time_s.size]
    levels = [_level(voltage_v[a:b]) for a, b in itertools.pairwise(marks)]
    starts, stops = [float(time_s[0])], []
    reach = max(int(half * time_s.size / level.size), 1)
    for k, at in enumerate(changes):
        low, high = max(marks[k], at - reach), min(marks[k + 2], at + reach)
        left, right = _change_ends(voltage_v[low:high], levels[k], levels[k + 1])
        stops.append(float(time_s[low + left]))
        starts.append(float(time_s[min(low + right, time_s.size - 1)]))
    stops.append(float(time_s[-1]))
    start_s, stop_s = np.array(starts), np.array(stops)
    wandering = max(_MOST_WANDER * float(np.ptp(level)), 2.0 * _CLEAR * usual)
    kept, parts = [], []
    for k, (a, b) in enumerate(zip(start_s, stop_s, strict=True)):
        inside = slice(*np.searchsorted(bin_s, [a, b]))
        if b - a >= min_step_s and _wander(level[inside], half) <= wandering:
            kept.append(k)
            parts.append(voltage_v[slice(*np.searchsorted(time_s, [a, b]))])
    return VoltageSteps(
        start_s[kept],
        stop_s[kept],
        np.array([part.mean() for part in parts]),
        np.array([part.std() for part in parts]),
    )


def _rises(level: Floats, half: int) -> Floats:
    """Difference of the means of `half` bins after and before each edge between bins."""
    if level.size < 2 * half + 1:
        return np.empty(0)
    summed = np.concatenate([[0.0], np.cumsum(level - level[0])])
    at = np.arange(half, level.size - half + 1)
    rises: Floats = np.abs(summed[at + half] - 2.0 * summed[at] + summed[at - half]) / half
    return rises


def _changes(rise: Floats, least: float, half: int) -> list[int]:
    """Find the bins at which the level changes most within their surroundings, ascending."""
    found: list[int] = []
    open_ = rise > least
    while open_.any():
        best = int(np.argmax(np.where(open_, rise, -1.0)))
        found.append(best + half)
        open_[max(best - half, 0) : best + half + 1] = False
    return sorted(found)


def _wander(level: Floats, half: int) -> float:
    """How far the mean of `half` bins moves within a stretch."""
    if level.size <= half:
        return 0.0
    summed = np.concatenate([[0.0], np.cumsum(level - level[0])])
    return float(np.ptp(summed[half:] - summed[:-half])) / half


def _change_ends(
    voltage_v: Floats, before: tuple[float, float], after: tuple[float, float]
) -> tuple[int, int]:
    """Index of the last sample near the old level and of the first one near the new level."""
    (old, old_sd), (new, new_sd) = before, after
    middle = voltage_v > 0.5 * (old + new) if new > old else voltage_v < 0.5 * (old + new)
    # The split that puts most samples on their side of the middle stands noise and spikes.
    signed = np.cumsum(np.where(middle, -1.0, 1.0))
    crossing = int(np.argmax(signed)) + 1
    near_old = np.abs(voltage_v[:crossing] - old) <= max(4.0 * old_sd, _SETTLED * abs(new - old))
    near_new = np.abs(voltage_v[crossing:] - new) <= max(4.0 * new_sd, _SETTLED * abs(new - old))
    left = int(np.flatnonzero(near_old)[-1]) if near_old.any() else 0
    right = crossing + int(np.argmax(near_new)) if near_new.any() else voltage_v.size
    return left, right


def _level(voltage_v: Floats) -> tuple[float, float]:
    """Median of the inner half of samples, and their robust standard deviation."""
    quarter = voltage_v.size // 4
    inner = voltage_v[quarter : voltage_v.size - quarter]
    middle = float(np.median(inner))
    return middle, 1.4826 * float(np.median(np.abs(inner - middle)))


def _area_up_to(at_s: Floats, time_s: Floats, value: Floats, area: Floats) -> Floats:
    """Integrate a polygon from its first corner to some times."""
    left = np.clip(np.searchsorted(time_s, at_s, side="right") - 1, 0, time_s.size - 2)
    here = np.interp(at_s, time_s, value)
    found: Floats = area[left] + 0.5 * (at_s - time_s[left]) * (value[left] + here)
    return found


def _reduced(ufunc: np.ufunc, values: Floats, first: Integers, last: Integers) -> Floats:
    """Reduce values[first:last] of each pair; nan-free even where such a part is empty."""
    if first.size == 0:
        return np.empty(0)
    padded = np.append(values, values[-1])
    pairs = np.stack([first, np.maximum(last, first)], axis=1).ravel()
    reduced = ufunc.reduceat(padded, np.minimum(pairs, values.size))[::2]
    # reduceat gives the single sample at `first` where nothing lies between.
    neutral = -np.inf if ufunc is np.maximum else np.inf
    found: Floats = np.where(last > first, reduced, neutral)
    return found
