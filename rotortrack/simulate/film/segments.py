"""The segments of time into which each frame's period is cut."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.film.clock import Clock

Floats = NDArray[np.float64]

_SAME = 1e-9
"""Edges closer than this part of a period are one."""


class Segments:
    """A period is cut where a part of an exposure begins or ends.

    Parameters
    ----------
    clock, parts
        When frames are exposed; parts of an exposure.
    delays_s
        How much later than the first row each of several exposures begins.

    Attributes
    ----------
    period_s
        The frame interval.
    delays_s
        Delays against the least one.
    length_s
        Of the segments, shape (segments,); an instant has none.
    straddles
        Whether an exposure may reach into the next period.
    """

    def __init__(self, clock: Clock, parts: int, delays_s: tuple[float, ...]) -> None:
        self.period_s = clock.frame_interval_s
        self._base_s = min(delays_s)
        self.delays_s = tuple(delay - self._base_s for delay in delays_s)
        self._parts = parts
        self._part_s = clock.exposure_s / parts
        self.straddles = any(
            delay + clock.exposure_s > self.period_s * (1.0 + _SAME) for delay in self.delays_s
        )
        if clock.exposure_s == 0.0:
            self._start_s = np.repeat(np.unique([0.0, *self.delays_s]), 2)
            ends_s = np.append(self._start_s[1:], self.period_s)
        else:
            steps_s = self._part_s * np.arange(parts + 1)
            edges = np.concatenate([delay + steps_s for delay in self.delays_s])
            edges = np.concatenate([edges[edges <= self.period_s * (1.0 + _SAME)], [self.period_s]])
            if self.straddles:
                later = np.concatenate([delay + steps_s for delay in self.delays_s])
                edges = np.concatenate([edges, later[later > self.period_s] - self.period_s])
            edges = np.sort(edges)
            new = np.diff(edges, prepend=-np.inf) > _SAME * self.period_s
            edges = edges[new]
            self._start_s, ends_s = edges[:-1], edges[1:]
        self.length_s: Floats = ends_s - self._start_s

    def begin_s(self, frame: int, n: int) -> Floats:
        """Give the beginnings of the segments of n periods from a frame on, (n, segments)."""
        frames = np.arange(frame, frame + n)[:, np.newaxis]
        begin: Floats = frames * self.period_s + self._base_s + self._start_s
        return begin

    def exposed(self, path: Floats, delay_s: float) -> Floats:
        """Average over the parts of one exposure.

        Parameters
        ----------
        path
            Means over the segments of each period, and of the next one where exposures straddle:
            (n, segments) or (n, 2 segments).
        delay_s
            One of `delays_s`.

        Returns
        -------
        Means over the parts, shape (n, parts).
        """
        starts, lengths = self._start_s, self.length_s
        if self.straddles:
            starts = np.concatenate([starts, starts + self.period_s])
            lengths = np.concatenate([lengths, lengths])
        if self._part_s == 0.0:
            # Of the two segments that begin then, the first one is the instant.
            return path[:, [int(np.argmin(np.abs(starts - delay_s)))]]
        slack = _SAME * self.period_s
        edges = delay_s + self._part_s * np.arange(self._parts + 1) - slack
        firsts = np.searchsorted(starts, edges)
        chosen = slice(firsts[0], firsts[-1])
        if firsts[-1] - firsts[0] == self._parts:
            return path[:, chosen]
        offsets = firsts[:-1] - firsts[0]
        sums: Floats = np.add.reduceat(path[:, chosen] * lengths[chosen], offsets, axis=1)
        return sums / np.add.reduceat(lengths[chosen], offsets)
