"""Frame numbers from the times at which frames were received: dropped frames become gaps.

A computer's clock tells when a frame was received, which is never early but may be late, often for
many frames in a row that then arrive together. A dropped frame delays all later ones for good. So a
lag behind a uniform clock that some later frame has made good is no drop, and what is left rises by
whole frame intervals.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import MetadataWarning

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FEWEST_TIMED_FRAMES = 10
"""Fewer frames do not average out the jitter of the computer's clock."""

_SPANS = (1, 4, 16, 64, 256)
_BLOCK, _TONE_BLOCK = 64, 16
_BLOCKS_PER_GROUP = 256
_FASTEST_WANDER = 0.25
# Phases spread evenly lie at a mean distance of 0.25 from any level, less where they are few.
_INCOHERENT, _FEW_PHASES = 0.18, 1.6
_LATE = 0.5
_MIRROR = 0.5
_LONGEST_STEP = 8
_FRACTION_BINS = 40
_SCALE_FLOOR, _EQUAL_COST = 0.02, 0.01
_TICK_S = 1e-3
_FEWEST_TICKS = 1.5
_MOST_DROPPED = 10_000_000


@dataclass(frozen=True)
class FrameTimes:
    """What the times of the frames say.

    Attributes
    ----------
    interval_s
        Time from frame to frame where none is dropped (s); the mean interval where `irregular`.
    numbers
        Number of each frame, the first 0, strictly increasing; those of dropped frames are absent.
    jitter_s
        Lateness behind a uniform clock that 95 % of the frames keep (s), nan where `irregular`.
    irregular
        Whether the frames follow no common interval; no gaps are told then.
    low_s, high_s
        Intervals between recorded frames (s): 5 % are shorter than `low_s`, 5 % longer than
        `high_s`.
    """

    interval_s: float
    numbers: Integers
    jitter_s: float
    irregular: bool
    low_s: float
    high_s: float

    @property
    def dropped(self) -> int:
        """How many frames are missing between the first and the last."""
        return int(self.numbers[-1]) + 1 - len(self.numbers)

    @property
    def places(self) -> int:
        """At how many places frames are missing."""
        return int(np.count_nonzero(np.diff(self.numbers) > 1))


def number_frames(times_s: Floats) -> FrameTimes:
    """Find the common interval of recorded times and number the frames by it.

    Several intervals are tried: slopes of the earliest frames over spans of several lengths,
    sharpened by the phase of these frames modulo the interval, which drops do not change. Of those
    that the earliest frames keep, the one that explains the times in the fewest words is taken,
    and among equals the one with the fewest drops.

    Parameters
    ----------
    times_s
        Times in s, finite, at least FEWEST_TIMED_FRAMES, the last after the first.

    Notes
    -----
    As simulated, with frames 0.1 to 1 interval late on average, 20 stalls of up to 50 intervals
    that are made good, and a clock that is off by 30 ppm: of 100 000 frames every drop is found and
    none is invented, also where times are whole ms at 2 ms a frame; up to 0.1 % of the frames,
    those late next to a drop, are numbered as if before or after it. Up to 30 % of the frames may
    be dropped at random.

    Limits: every third frame dropped, with times in ticks of half an interval, passes for a longer
    interval; frames faster than 1.5 ticks show no drops; frames that are two intervals late on
    average, or stalls over much of the movie, pass for irregular ones; frames early by more than
    0.4 intervals move drops; a clock whose rate wanders by 1 ppm over 1e6 frames is followed, but
    not where ticks are exactly half an interval. A lateness that lasts to the last frame is taken
    for a drop only where it lasts longer than any that was made good. Of irregular movies (steps
    spread by +-20 %) of 300 frames, 3 % pass for regular, of 3000 frames none.
    """
    count = np.arange(len(times_s))
    low_s, high_s = (float(value) for value in np.quantile(np.diff(times_s), (0.05, 0.95)))
    tick_s = _tick(times_s)
    fits = [
        fit
        for interval_s in _intervals(times_s)
        if (fit := _fit(times_s, interval_s)).spread < _coherent(len(times_s))
        # In coarse ticks every interval of one tick seems to be kept.
        and (interval_s >= _FEWEST_TICKS * tick_s or not fit.dropped[-1])
    ]
    if not fits:
        mean_s = float(times_s[-1] - times_s[0]) / (len(times_s) - 1)
        return FrameTimes(mean_s, count, math.nan, True, low_s, high_s)
    floor_s = max(tick_s / 4.0, _SCALE_FLOOR * max(fit.interval_s for fit in fits))
    costs = [fit.cost(floor_s) for fit in fits]
    limit = min(costs) + max(_EQUAL_COST, 1.0 / math.sqrt(len(times_s)))
    best = min(
        (fit for fit, cost in zip(fits, costs, strict=True) if cost <= limit),
        key=lambda fit: (fit.dropped[-1], fit.spread),
    )
    numbers = count + best.dropped
    interval_s = _straightened(times_s, numbers, best.interval_s)
    late_s = times_s - interval_s * numbers
    _, earliest_s = _earliest(late_s, _block_frames(len(times_s)))
    jitter_s = max(0.0, float(np.quantile(late_s, 0.95) - np.median(earliest_s)))
    return FrameTimes(interval_s, numbers, jitter_s, False, low_s, high_s)


def told(times: FrameTimes, name: str) -> str | None:
    """Say in one sentence which frames were dropped; None where none was.

    Parameters
    ----------
    times
        What the times of the movie say.
    name
        The movie, for the warning.

    Warns
    -----
    MetadataWarning
        The frames follow no common interval.
    """
    if times.irregular:
        warnings.warn(
            f"the frames of {name} follow no common interval by their recorded times "
            f"({1e3 * times.low_s:.4g} to {1e3 * times.high_s:.4g} ms between most of them), so "
            "dropped frames cannot be told and speeds assume a constant interval of "
            f"{1e3 * times.interval_s:.4g} ms: record by the camera's own clock",
            MetadataWarning,
            stacklevel=2,
        )
    if not times.dropped:
        return None
    frames = "1 frame was" if times.dropped == 1 else f"{times.dropped} frames were"
    place = "1 place" if times.places == 1 else f"{times.places} places"
    return (
        f"by the recorded times {frames} dropped at {place} between the "
        f"{len(times.numbers)} frames of {name}: they are treated as gaps"
    )


@dataclass(frozen=True)
class _Fit:
    """A uniform clock laid under the times.

    Attributes
    ----------
    interval_s
        Its interval.
    dropped
        Frames dropped before each frame, ascending from 0.
    lateness
        How late each frame is, in intervals.
    spread
        Mean distance of the earliest frames from the clock, in intervals.
    """

    interval_s: float
    dropped: Integers
    lateness: Floats
    spread: float

    def cost(self, floor_s: float) -> float:
        """Nats a frame that it takes to write the times down: their lateness and the drops.

        Lateness by more than an interval costs the same whatever the clock.
        """
        off = np.abs(self.lateness - np.median(self.lateness))
        off_s = float(np.minimum(off, 1.0).mean()) * self.interval_s
        rate = np.count_nonzero(np.diff(self.dropped)) / len(self.dropped)
        return math.log(off_s + floor_s) + (rate * (1.0 - math.log(rate)) if rate else 0.0)


def _tick(times_s: Floats) -> float:
    """Find the step of the clock (s) that wrote the times: 1 ms, or 0 where it is finer."""
    ticks = times_s / _TICK_S
    whole = np.abs(ticks - np.round(ticks)) < 1e-6 * np.maximum(1.0, np.abs(ticks))
    return _TICK_S if bool(whole.all()) else 0.0


def _intervals(times_s: Floats) -> list[float]:
    """Propose distinct intervals, sharp enough to hold over the whole movie."""
    size = max(1, min(_TONE_BLOCK, len(times_s) // 16))
    sharp = {
        twice
        for rough in _slopes(times_s)
        for once in _sharpened(times_s, rough, size)
        for twice in _sharpened(times_s, once, size)
    }
    distinct: list[float] = []
    for interval_s in sorted(sharp):
        if not distinct or (interval_s - distinct[-1]) * len(times_s) > 0.1 * interval_s:
            distinct.append(interval_s)
    return distinct


def _slopes(times_s: Floats) -> list[float]:
    """Propose rough intervals: short steps, and slopes of the earliest frames over spans."""
    count = np.arange(len(times_s))
    slopes = [float(np.quantile(np.diff(times_s), 0.25))]
    for span in _SPANS:
        if 4 * span > len(times_s):
            break
        rough = float(np.median(times_s[span:] - times_s[:-span])) / span
        at, earliest = _earliest(times_s - rough * count, span)
        slopes.append(rough + float(np.median(np.diff(earliest) / np.diff(at))))
    least = float(times_s[-1] - times_s[0]) / (len(times_s) + _MOST_DROPPED)
    return [slope for slope in slopes if slope > least]


def _sharpened(times_s: Floats, interval_s: float, size: int) -> list[float]:
    """Correct an interval by the frequency at which the phase of the earliest frames turns.

    The phases are laid out over time, so that drops do not change the frequency, in bins of `size`
    intervals. Times in ticks of half an interval have several frequencies, all of which are given:
    they cannot tell a clock that gains from one that loses.
    """
    at, _ = _earliest(times_s - interval_s * np.arange(len(times_s)), size)
    since = (times_s[at] - times_s[0]) / interval_s
    # A pause is cut short: it would cost memory, and says nothing of the interval.
    steps = np.clip(np.diff(np.round(since / size)), 0, _LONGEST_STEP).astype(np.int64)
    bins = np.concatenate([[0], np.cumsum(steps)])
    phasors = np.zeros(int(bins[-1]) + 1, np.complex128)
    np.add.at(phasors, bins, np.exp(2j * np.pi * since))
    length = 8 * 2 ** math.ceil(math.log2(len(phasors)))
    power = np.abs(np.fft.fft(phasors, length))
    peak = int(power.argmax())
    corrected = []
    for place in {peak, -peak % length, 0}:
        before, top, after = power[place - 1], power[place], power[(place + 1) % length]
        if top < _MIRROR * power[peak]:
            continue
        curvature = before - 2.0 * top + after
        exact = place + (0.5 * (before - after) / curvature if curvature else 0.0)
        turns = (exact / length + 0.5) % 1.0 - 0.5
        corrected.append(float(interval_s / (1.0 - turns / size)))
    return corrected


def _fit(times_s: Floats, interval_s: float) -> _Fit:
    """Count the dropped frames by a clock of one interval, whose phase may wander slowly."""
    lag = times_s / interval_s - np.arange(len(times_s))
    at, earliest = _earliest(lag, _block_frames(len(times_s)))
    level = _level(at, earliest, len(times_s))
    spread = float(np.abs(_wrap(earliest - level[at])).mean())
    lag -= level
    lasting = np.minimum.accumulate(lag[::-1])[::-1]
    dropped = np.floor(lasting - _edge(lasting)).astype(np.int64)
    dropped -= dropped[0]
    phase = lasting - dropped
    start = float(np.median(phase))
    spread = max(spread, float(np.abs(phase - start).mean()))
    tail = _longest_run(lag - dropped - start > _LATE)
    dropped = np.minimum(dropped, dropped[max(0, len(dropped) - 1 - tail)])
    return _Fit(interval_s, dropped, lag - dropped - start, spread)


def _straightened(times_s: Floats, numbers: Integers, interval_s: float) -> float:
    """Fit a line through the earliest frames once all are numbered."""
    at, earliest = _earliest(times_s - interval_s * numbers, _block_frames(len(times_s)))
    on_time = np.abs(earliest - np.median(earliest)) < _LATE * interval_s
    if np.count_nonzero(on_time) < 2:
        return interval_s
    place = numbers[at[on_time]] - numbers[at[on_time]].mean()
    return interval_s + float(place @ earliest[on_time] / (place @ place))


def _coherent(frames: int) -> float:
    """Spread below which the earliest frames keep the clock: few phases seem to by chance."""
    blocks = frames // _block_frames(frames)
    return _INCOHERENT * (1.0 - _FEW_PHASES / math.sqrt(blocks))


def _block_frames(frames: int) -> int:
    return max(1, min(_BLOCK, frames // 16))


def _level(at: Integers, earliest: Floats, frames: int) -> Floats:
    """Phase of the clock in every frame, in intervals, from the phases of the blocks.

    Groups of many blocks give one phase each, to which a stall adds little; jumps are no wander.
    """
    members = np.array_split(np.arange(len(at)), max(1, len(at) // _BLOCKS_PER_GROUP))
    phasors = np.exp(2j * np.pi * earliest)
    phases = [float(np.angle(phasors[part].sum())) / (2.0 * np.pi) for part in members]
    level = phases[:1]
    for phase in phases[1:]:
        step = phase - level[-1] - round(phase - level[-1])
        level.append(level[-1] + (step if abs(step) < _FASTEST_WANDER else 0.0))
    return np.interp(np.arange(frames), [at[part].mean() for part in members], level)


def _edge(lasting: Floats) -> float:
    """Fraction at which n drops become n + 1: amid the emptiest part, with the fewest drops."""
    bins, _ = np.histogram(lasting % 1.0, _FRACTION_BINS, (0.0, 1.0))
    reach = _FRACTION_BINS // 5
    near = np.sum([np.roll(bins, shift) for shift in range(-reach, reach)], axis=0)
    edges = np.arange(_FRACTION_BINS) / _FRACTION_BINS
    drops = np.floor(lasting[-1] - edges) - np.floor(lasting[0] - edges)
    empty = near <= near.min() + 0.01 * len(lasting)
    best = np.flatnonzero(empty & (drops == drops[empty].min()))
    return float(edges[best[near[best].argmin()]])


def _earliest(lag: Floats, size: int) -> tuple[Integers, Floats]:
    """Place and lag of the earliest frame of each block of `size` frames."""
    blocks = lag[: len(lag) // size * size].reshape(-1, size)
    within = blocks.argmin(axis=1)
    rows = np.arange(len(blocks))
    return rows * size + within, blocks[rows, within]


def _wrap(turns: Floats) -> Floats:
    return turns - np.round(turns)


def _longest_run(true: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(np.int8)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
