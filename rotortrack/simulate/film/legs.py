"""Angles that grow evenly between sudden changes: voltage steps and switches of direction."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.film.options import VoltageOptions

Floats = NDArray[np.float64]


class Drive:
    """How fast everything turns against its own speed: a factor that changes at certain times.

    Parameters
    ----------
    times_s, factors
        When each factor begins; the first one holds before, too.
    """

    def __init__(self, times_s: tuple[float, ...], factors: tuple[float, ...]) -> None:
        self.times_s = times_s
        self.factors = factors

    @classmethod
    def from_options(cls, options: VoltageOptions) -> Drive:
        """Make speeds proportional to a voltage."""
        factors = tuple(value / options.reference_mv for value in options.voltages_mv)
        return cls(options.times_s, factors)

    @property
    def largest(self) -> float:
        """Largest factor in magnitude."""
        return max(map(abs, self.factors))


class Flips:
    """Random moments, Poisson distributed, one after the other."""

    def __init__(self, rate_per_s: float, rng: np.random.Generator) -> None:
        self._rate = rate_per_s
        self._rng = rng
        self._next_s = float(rng.exponential(1.0 / rate_per_s))

    def until(self, time_s: float) -> Iterator[float]:
        """Yield those that come before a time and were not yielded before."""
        while self._next_s < time_s:
            yield self._next_s
            self._next_s += float(self._rng.exponential(1.0 / self._rate))


class Legs:
    """The integral over time of drive and direction, exact in every part of an exposure.

    Values depend on the changes alone and not on when they are asked for.

    Parameters
    ----------
    drive
        None for a factor of 1.
    flips
        When the direction changes; None for never.
    """

    def __init__(self, drive: Drive | None, flips: Flips | None) -> None:
        steps = [(0.0, 1.0)]
        if drive is not None:
            steps = list(zip(drive.times_s, drive.factors, strict=True))
        self._steps = steps[1:]
        self._flips = flips
        self._factor, self._sign = steps[0][1], 1.0
        self._start_s = [0.0]
        self._reached = [0.0]
        self._slope = [self._factor]

    def means(self, begin_s: Floats, length_s: Floats) -> Floats:
        """Give the mean of the integral over parts of time.

        Parameters
        ----------
        begin_s
            When the parts begin, ascending from call to call, shape (n, parts).
        length_s
            How long they are, shape (parts,).
        """
        self._go_to(float(begin_s[-1, -1] + length_s[-1]), float(begin_s[0, 0]))
        middle = begin_s + 0.5 * length_s
        starts = np.array(self._start_s)
        leg = np.maximum(np.searchsorted(starts, middle, side="right") - 1, 0)
        reached, slope = np.array(self._reached), np.array(self._slope)
        means: Floats = reached[leg] + slope[leg] * (middle - starts[leg])
        for start, change in zip(starts[1:], np.diff(slope), strict=True):
            end = begin_s + length_s
            within = (begin_s < start) & (start < end)
            if within.any():
                after = np.where(within, end - start, 0.0)
                late = np.where(within, np.maximum(middle - start, 0.0), 0.0)
                long_s = np.broadcast_to(length_s, after.shape)
                bent = np.divide(after**2, 2.0 * long_s, out=np.zeros_like(after), where=within)
                means += change * (bent - late)
        return means

    def _go_to(self, end_s: float, begin_s: float) -> None:
        """Learn all changes before one time, and forget legs that ended before another."""
        flips = [] if self._flips is None else [(t, -1.0, True) for t in self._flips.until(end_s)]
        steps = []
        while self._steps and self._steps[0][0] < end_s:
            time_s, factor = self._steps.pop(0)
            steps.append((time_s, factor, False))
        for time_s, value, is_flip in sorted([*flips, *steps]):
            if is_flip:
                self._sign *= value
            else:
                self._factor = value
            elapsed = time_s - self._start_s[-1]
            self._reached.append(self._reached[-1] + self._slope[-1] * elapsed)
            self._start_s.append(time_s)
            self._slope.append(self._factor * self._sign)
        over = max(int(np.searchsorted(self._start_s, begin_s, side="right")) - 1, 0)
        if over and math.isfinite(begin_s):
            for values in (self._start_s, self._reached, self._slope):
                del values[:over]


class Poses:
    """Half turns at random moments."""

    def __init__(self, flips: Flips) -> None:
        self._flips = flips
        self._times_s: list[float] = []
        self._before = 0

    def means(self, begin_s: Floats, length_s: Floats) -> Floats:
        """Give the pose, 0 or pi, in the middle of parts of time, as :meth:`Legs.means`."""
        self._times_s += self._flips.until(float(begin_s[-1, -1] + length_s[-1]))
        over = int(np.searchsorted(self._times_s, begin_s[0, 0], side="right"))
        self._before += over
        del self._times_s[:over]
        count = self._before + np.searchsorted(
            self._times_s, begin_s + 0.5 * length_s, side="right"
        )
        return np.where(count % 2, np.pi, 0.0)
