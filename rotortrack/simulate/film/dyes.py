"""The dyes of a labelled end: which there are, how bright, and when each of them is dark.

An end is one point of light, in the middle of its lit dyes. That dyes cover 20 or 40 nm of the rod
widens a spot of 130 nm by 0.4 % at most, which is left out.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.options import BleachingOptions, BlinkingOptions, DyesOptions
from rotortrack.simulate.film.streams import Effect, stream

Floats = NDArray[np.float64]


class Dyes:
    """Light and middle of one end's dyes, given frame after frame.

    Parameters
    ----------
    rotor, end
        Numbers of the rotor and of its end; they name the random streams.
    photons
        Of a fully labelled end a frame, every dye lit; with spread, on average over ends.
    clock
        When frames are exposed.
    seed
        Of the film.
    dyes
        Docking places; None for one dye that is the whole end.
    bleaching, blinking
        How dyes go dark; None where they do not.
    lit_from_s
        When the end comes into the light.
    delay_s
        How much later than the first row it is exposed.
    """

    def __init__(
        self,
        rotor: int,
        end: int,
        photons: float,
        clock: Clock,
        seed: int,
        *,
        dyes: DyesOptions | None = None,
        bleaching: BleachingOptions | None = None,
        blinking: BlinkingOptions | None = None,
        lit_from_s: float = 0.0,
        delay_s: float = 0.0,
    ) -> None:
        count = 1 if dyes is None else dyes.counts[end]
        self._clock = clock
        self._delay_s = delay_s
        self._frame = 0
        self._light = np.full(count, photons / count)
        self._along_nm: Floats | None = None
        if dyes is not None:
            self._light *= _brightness(dyes, count, seed, rotor, end)
            self._along_nm = dyes.lengths_nm[end] * ((np.arange(count) + 0.5) / count - 0.5)
        self._bleached_s = np.full(count, math.inf)
        if bleaching is not None:
            rng = stream(seed, Effect.BLEACHING, rotor, end)
            self._bleached_s = lit_from_s + rng.exponential(bleaching.lifetime_s, count)
        self._blinks: dict[int, _Blinks] = {}
        if blinking is not None:
            self._blinks = {
                dye: _Blinks(blinking, stream(seed, Effect.BLINKING, rotor, end, dye))
                for dye in np.flatnonzero(self._light).tolist()
            }
        self._steady = bleaching is None and blinking is None

    def advance(self, n: int) -> tuple[Floats, Floats | None]:
        """Give the light of the next n frames.

        Returns
        -------
        photons
            Expected photons, a dye that is dark for half of an exposure giving half: shape (n,), or
            (1,) where nothing goes dark.
        offset_nm
            How far towards the rod's tip the lit dyes' middle is from that of all places, of the
            same shape; None without places.
        """
        light = self._light[:, np.newaxis]
        if not self._steady:
            light = light * self._shares(n)
        self._frame += n
        photons = _sum(light)
        if self._along_nm is None:
            return photons, None
        moments = _sum(light * self._along_nm[:, np.newaxis])
        return photons, np.divide(moments, photons, out=np.zeros_like(photons), where=photons > 0.0)

    def _shares(self, n: int) -> Floats:
        """Part of each exposure for which each dye is lit, shape (dyes, n)."""
        period_s = self._clock.frame_interval_s
        begin_s = np.arange(self._frame, self._frame + n) * period_s + self._delay_s
        shares = np.ones((self._light.size, n))
        dark = self._dark_times(begin_s[0], begin_s[-1] + period_s)
        if not dark:
            return shares
        dyes, from_s, to_s = (np.array(column) for column in zip(*dark, strict=True))
        # Only the frames that a dark time meets are looked at, and one more at either end.
        first = np.clip(np.floor((from_s - begin_s[0]) / period_s) - 1.0, 0, n).astype(np.int64)
        last = np.clip(np.floor((to_s - begin_s[0]) / period_s) + 2.0, 0, n).astype(np.int64)
        counts = last - first
        time = np.repeat(np.arange(counts.size), counts)
        frame = np.arange(time.size) - np.repeat(np.cumsum(counts) - counts - first, counts)
        lost = _overlap(begin_s[frame], self._clock.exposure_s, from_s[time], to_s[time])
        np.subtract.at(shares, (dyes[time], frame), lost)
        return np.maximum(shares, 0.0)

    def _dark_times(self, since_s: float, until_s: float) -> list[tuple[int, float, float]]:
        """List dye, beginning and end of dark times between two times, apart from one another."""
        found = []
        for dye, bleached_s in enumerate(self._bleached_s.tolist()):
            if dye in self._blinks and bleached_s > since_s:
                found += [
                    (dye, dark_s, min(lit_s, bleached_s))
                    for dark_s, lit_s in self._blinks[dye].until(until_s)
                    if dark_s < bleached_s
                ]
            if bleached_s < until_s:
                found.append((dye, bleached_s, math.inf))
        return found


class _Blinks:
    """Dark times of one dye, one after the other; the film begins at any moment of its blinking."""

    def __init__(self, options: BlinkingOptions, rng: np.random.Generator) -> None:
        self._options = options
        self._rng = rng
        begins_dark = rng.random() < options.off_s / (options.on_s + options.off_s)
        self._dark_s = 0.0 if begins_dark else float(rng.exponential(options.on_s))
        self._lit_s = self._dark_s + float(rng.exponential(options.off_s))

    def until(self, time_s: float) -> list[tuple[float, float]]:
        """List the dark times that begin before a time, those already over left out."""
        found = []
        while self._dark_s < time_s:
            found.append((self._dark_s, self._lit_s))
            if self._lit_s >= time_s:
                break
            self._dark_s = self._lit_s + float(self._rng.exponential(self._options.on_s))
            self._lit_s = self._dark_s + float(self._rng.exponential(self._options.off_s))
        return found


def _brightness(dyes: DyesOptions, count: int, seed: int, rotor: int, end: int) -> Floats:
    """Draw how bright the dye of each place is, 0 where there is none and 1 on average."""
    bright = np.ones(count)
    if dyes.labelled < 1.0 or dyes.spread:
        rng = stream(seed, Effect.LABELS, rotor, end)
        present = rng.random(count) < dyes.labelled
        if dyes.spread:
            bright = rng.gamma(1.0 / dyes.spread**2, dyes.spread**2, count)
        bright *= present
    return bright


def _sum(values: Floats) -> Floats:
    """Add up over the first axis, in an order that does not depend on how many frames there are."""
    total: Floats = np.cumsum(values, axis=0)[-1]
    return total


def _overlap(begin_s: Floats, exposure_s: float, from_s: Floats, to_s: Floats) -> Floats:
    """Part of each exposure that lies between two times; exactly 1 where all of it does."""
    if exposure_s == 0.0:
        return np.where((begin_s >= from_s) & (begin_s < to_s), 1.0, 0.0)
    share: Floats = (
        np.clip(to_s - begin_s, 0.0, exposure_s) - np.clip(from_s - begin_s, 0.0, exposure_s)
    ) / exposure_s
    return share
