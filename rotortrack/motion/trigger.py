"""When each frame was exposed, on the clock of a recorded trace: the edges of the camera's trigger.

The camera raises its output at the start of each exposure. Edges that are missing, too many or cut
off must not shift the frames that follow, so each edge is held against the pace of the others.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_LOWER, _UPPER = 0.3, 0.7
"""Parts of the way from low to high that an edge must cross: what lies between is ringing."""

_SPIKE_SHARE = 5e-4
_LEAST_CONTRAST = 6.0
_OFF_PACE = 0.2
"""Part of a period by which an edge may come early or late and still be that of a frame."""

_FEWEST_EDGES = 3


@dataclass(frozen=True)
class Edges:
    """Rising edges of a trigger.

    Attributes
    ----------
    time_s
        When the signal crossed half its height, s on the trace's clock.
    starts_high
        Whether the trace begins within a pulse, whose edge is cut off.
    """

    time_s: Floats
    starts_high: bool


@dataclass(frozen=True)
class FrameClock:
    """Start of each exposure on the trace's clock.

    Attributes
    ----------
    time_s
        For each frame from the first edge on, s; where an edge is missing, from its neighbours.
    period_s
        Time between frames on the trace's clock, s.
    missed, extra, pauses
        How many edges are missing between others, came between frames, or after a pause, which is
        no whole number of frames long.
    starts_high
        Whether the first edge is cut off; the frame that it began is then frame 0, and its time
        one period before the next.
    """

    time_s: Floats
    period_s: float
    missed: int
    extra: int
    pauses: int
    starts_high: bool

    def ppm_off(self, frame_interval_s: float) -> float:
        """By how much the trace's clock runs faster than that of the frame interval, in 1e-6."""
        return 1e6 * (self.period_s / frame_interval_s - 1.0)

    def frame_at(self, time_s: Floats) -> Floats:
        """Give the frame, with its fraction, at a time of the trace; extrapolated at both ends."""
        number = np.arange(self.time_s.size, dtype=np.float64)
        inside = np.interp(time_s, self.time_s, number)
        early = (time_s - self.time_s[0]) / self.period_s
        late = number[-1] + (time_s - self.time_s[-1]) / self.period_s
        found: Floats = np.where(
            time_s < self.time_s[0], early, np.where(time_s > self.time_s[-1], late, inside)
        )
        return found


def rising_edges(time_s: Floats, trigger_v: Floats) -> Edges:
    """Find rising edges with hysteresis.

    Low and high are the means of what lies below and above the middle between them; rare spikes
    beyond both do not move them. An edge counts when the signal has come from below 30 % of the way
    and reaches 70 %; its time is where it crossed 50 %, between two samples.

    Parameters
    ----------
    time_s, trigger_v
        Samples, ascending in time, shape (n,).

    Raises
    ------
    InputError
        The signal does not have two levels.
    """
    if not trigger_v.size:
        raise InputError("the trigger's trace has no sample: give the one recorded with the movie")
    low_v, high_v = _levels(trigger_v)
    part = (trigger_v - low_v) / (high_v - low_v)
    # The last clear state at each sample: 1 high, 0 low, -1 not known yet.
    state = np.where(part >= _UPPER, 1, np.where(part <= _LOWER, 0, -1))
    clear = np.flatnonzero(state >= 0)
    risen = (state[clear[1:]] == 1) & (state[clear[:-1]] == 0)
    below, above = clear[:-1][risen], clear[1:][risen]
    # Ringing may cross the middle several times: the first crossing after the low state counts.
    at = np.array(
        [
            first + int(np.argmax(part[first : last + 1] >= 0.5))
            for first, last in zip(below.tolist(), above.tolist(), strict=True)
        ],
        np.int64,
    )
    share = (0.5 - part[at - 1]) / (part[at] - part[at - 1]) if at.size else np.empty(0)
    crossed = time_s[at - 1] + share * (time_s[at] - time_s[at - 1]) if at.size else np.empty(0)
    return Edges(crossed, bool(clear.size and state[clear[0]] == 1))


def frame_clock(edges: Edges) -> FrameClock:
    """Give each edge the number of the frame that it began.

    Starting from edges that keep the common pace, each next edge must come a whole number of
    periods after the last one, within a fifth of a period. If it does not, it is an extra one and
    is left out, unless those after it keep the pace again: then the camera paused. The pace is
    followed, so that clocks may drift against each other.

    Parameters
    ----------
    edges
        Rising edges.

    Raises
    ------
    InputError
        There are too few edges, or no common pace.
    """
    time_s = edges.time_s
    if time_s.size < _FEWEST_EDGES:
        raise InputError(
            f"the trigger has {time_s.size} rising edge(s): record the camera's exposure output "
            "for the whole movie"
        )
    apart = np.diff(time_s)
    period = float(np.median(apart))
    on_pace = np.abs(apart / period - 1.0) < _OFF_PACE
    anchors = np.flatnonzero(on_pace[:-1] & on_pace[1:])
    if anchors.size == 0 or np.mean(on_pace) < 0.5:
        raise InputError(
            "the trigger's edges have no common pace: record the camera's exposure output, one "
            "edge a frame"
        )
    anchor = int(anchors[0])
    after, pauses = _followed(time_s[anchor:], period)
    before, earlier_pauses = _followed(-time_s[anchor::-1], period)
    chosen = np.concatenate([anchor - before[:0:-1, 0], anchor + after[:, 0]])
    number = np.concatenate([-before[:0:-1, 1], after[:, 1]])
    number -= number[0]
    kept_s = time_s[chosen]
    whole = np.diff(number)
    went_s = np.diff(kept_s)
    steady = np.abs(went_s / whole / period - 1.0) < _OFF_PACE
    # Pauses taken out, the line through all edges averages the sampling of the trace away.
    running_s = np.cumsum(np.where(steady, went_s, whole * period))
    mean_period = float(np.polyfit(number[1:], running_s, 1)[0])
    every = np.interp(np.arange(number[-1] + 1), number, kept_s)
    if edges.starts_high:
        every = np.concatenate([[every[0] - mean_period], every])
    return FrameClock(
        time_s=every,
        period_s=mean_period,
        missed=int(number[-1] + 1 - number.size),
        extra=int(time_s.size - number.size),
        pauses=pauses + earlier_pauses,
        starts_high=edges.starts_high,
    )


def _levels(trigger_v: Floats) -> tuple[float, float]:
    """Find the low and the high level of a signal."""
    low, high = np.quantile(trigger_v, [_SPIKE_SHARE, 1.0 - _SPIKE_SHARE])
    if not high > low:
        # Pulses may be so short that they look like spikes.
        low, high = float(trigger_v.min()), float(trigger_v.max())
    upper = trigger_v > 0.5 * (low + high)
    for _ in range(20):
        if upper.all() or not upper.any():
            break
        low, high = float(np.median(trigger_v[~upper])), float(np.median(trigger_v[upper]))
        again = trigger_v > 0.5 * (low + high)
        if np.array_equal(again, upper):
            break
        upper = again
    spread = 1.4826 * np.median(np.abs(trigger_v - np.where(upper, high, low)))
    if not high - low > _LEAST_CONTRAST * max(float(spread), 1e-12):
        raise InputError(
            "trigger_v does not switch between two levels: record the camera's exposure output in "
            "this column"
        )
    return low, high


def _followed(time_s: Floats, period_s: float) -> tuple[Integers, int]:
    """Follow the pace from the first edge on: indices and frames of those that keep it, pauses."""
    kept = [(0, 0)]
    pauses = 0
    last_s, number, pace = float(time_s[0]), 0, period_s
    times = time_s.tolist()
    for index in range(1, len(times)):
        turns = (times[index] - last_s) / pace
        whole = max(round(turns), 1)
        late = abs(turns - whole) > _OFF_PACE
        if late:
            next_ = times[index : index + 3]
            gaps = [(b - a) / pace for a, b in itertools.pairwise(next_)]
            if turns < 1.0 or len(gaps) < 2 or any(abs(gap - 1.0) > _OFF_PACE for gap in gaps):
                continue
            # No frame was exposed meanwhile.
            whole, pauses = 1, pauses + 1
        elif whole <= 2:
            pace += 0.02 * ((times[index] - last_s) / whole - pace)
        number += whole
        last_s = times[index]
        kept.append((index, number))
    return np.array(kept, np.int64), pauses
