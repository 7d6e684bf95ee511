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
        Of a fully labelled end a frame, on average.
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
            rng = stream(seed, Effect.LABELS, rotor, end)
            present = rng.random(count) < dyes.labelled
            bright = np.ones(count)
            if dyes.spread:
                bright = rng.gamma(1.0 / dyes.spread**2, dyes.spread**2, count)
            self._light *= present * bright
            self._along_nm = dyes.lengths_nm[end] * ((np.arange(count) + 0.5) / count - 0.5)
        self._dark_from_s = np.full(count, math.inf)
        if bleaching is not None:
            rng = stream(seed, Effect.BLEACHING, rotor, end)
            self._dark_from_s = lit_from_s + rng.exponential(bleaching.lifetime_s, count)
        self._blinks: list[_Blinks] = []
        if blinking is not None:
            self._blinks = [
                _Blinks(blinking, stream(seed, Effect.BLINKING, rotor, end, dye))
                for dye in range(count)
            ]
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
        light = self._light[np.newaxis] if self._steady else self._light * self._shares(n).T
        self._frame += n
        photons: Floats = light.sum(axis=1)
        if self._along_nm is None:
            return photons, None
        moments = (light * self._along_nm).sum(axis=1)
        return photons, np.divide(moments, photons, out=np.zeros_like(photons), where=photons > 0.0)

    def _shares(self, n: int) -> Floats:
        """Part of each exposure for which each dye is lit, shape (dyes, n)."""
        clock = self._clock
        frames = np.arange(self._frame, self._frame + n)
        begin_s = frames.astype(np.float64) * clock.frame_interval_s + self._delay_s
        shares = np.ones((self._light.size, n))
        over_s = begin_s[-1] + clock.frame_interval_s
        for dye, blinks in enumerate(self._blinks):
            for dark_s, lit_s in blinks.until(over_s):
                shares[dye] -= _overlap(begin_s, clock.exposure_s, dark_s, lit_s)
        for dye, dark_s in enumerate(self._dark_from_s.tolist()):
            if dark_s >= over_s:
                continue
            before = 1.0 - _overlap(begin_s, clock.exposure_s, dark_s, math.inf)
            # Which part of an exposure was lit by chance does not matter to its mean.
            shares[dye] *= before
        return np.clip(shares, 0.0, 1.0)


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


def _overlap(begin_s: Floats, exposure_s: float, from_s: float, to_s: float) -> Floats:
    """Part of each exposure that lies between two times."""
    if exposure_s == 0.0:
        return np.where((begin_s >= from_s) & (begin_s < to_s), 1.0, 0.0)
    lasts = np.minimum(begin_s + exposure_s, to_s) - np.maximum(begin_s, from_s)
    # Late in a film an exposure is not quite the difference of its ends.
    whole = (begin_s >= from_s) & (begin_s + exposure_s <= to_s)
    return np.where(whole, 1.0, np.maximum(lasts, 0.0) / exposure_s)
