"""Rods that drift by without docking: what localisation has to tell from rotors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.options import FreeRodsOptions
from rotortrack.simulate.film.scene import within
from rotortrack.simulate.film.segments import Segments
from rotortrack.simulate.film.streams import Effect, stream
from rotortrack.simulate.film.wander import Brownian, Streams

Floats = NDArray[np.float64]

_PART_NM = 60.0
"""Rms way along an axis within a part of an exposure: half a spot's width."""

_MOST_PARTS = 50
_AROUND_NM = 2000.0
"""How far outside the field a rod leaves on one side and comes in on the other."""


class FreeRods:
    """Some rods in Brownian motion with a flow, in a field whose opposite edges are one.

    Parameters
    ----------
    options
        How many, how bright and how fast.
    clock
        When frames are exposed.
    shape_px, pixel_size_nm
        Field of the first colour.
    seed
        Of the film.
    """

    def __init__(
        self,
        options: FreeRodsOptions,
        clock: Clock,
        shape_px: tuple[int, int],
        pixel_size_nm: float,
        seed: int,
    ) -> None:
        self._size_nm = tuple(side * pixel_size_nm + 2.0 * _AROUND_NM for side in shape_px[::-1])
        self._flow_nm_s = tuple(1e3 * speed for speed in options.flow_um_s)
        diffusion = 1e6 * options.diffusion_um2_s
        way_nm = math.hypot(*self._flow_nm_s) * clock.exposure_s
        parts = _parts(way_nm, 2.0 * diffusion * clock.exposure_s)
        self._segments = Segments(clock, parts, (0.0,))
        self._frame = 0
        self._rods = []
        for rod in range(options.count):
            rng = stream(seed, Effect.FREE_RODS, rod)
            place = rng.random(2) * self._size_nm
            photons = within(options.photons, float(rng.random()))
            walks = [
                Brownian(
                    diffusion,
                    self._segments.length_s,
                    Streams.of(seed, Effect.FREE_RODS, rod, axis),
                )
                for axis in range(2)
            ]
            self._rods.append((place, photons, walks))

    def advance(self, n: int) -> list[tuple[Floats, Floats, Floats]]:
        """Give x_nm and y_nm, (n, parts), and photons, (1,), of each rod in the next n frames."""
        begin_s = self._segments.begin_s(self._frame, n)
        middle_s = begin_s + 0.5 * self._segments.length_s
        self._frame += n
        rods = []
        for place, photons, walks in self._rods:
            where = []
            for axis, walk in enumerate(walks):
                path = place[axis] + self._flow_nm_s[axis] * middle_s + walk.advance(n)
                path = self._segments.exposed(path, 0.0)
                # The whole exposure goes round at once, so that no spot is torn.
                turns = np.floor(path.mean(axis=1, keepdims=True) / self._size_nm[axis])
                where.append(path - turns * self._size_nm[axis] - _AROUND_NM)
            rods.append((where[0], where[1], np.array([photons])))
        return rods


def _parts(way_nm: float, spread_nm2: float) -> int:
    """Return the least n with (way / n)^2 + spread / n <= `_PART_NM` squared, if not too many."""
    half = 0.5 * spread_nm2
    parts = math.ceil((half + math.hypot(half, _PART_NM * way_nm)) / _PART_NM**2)
    return min(max(parts, 1), _MOST_PARTS)
