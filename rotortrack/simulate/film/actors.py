"""What shines in a film, block by block: rotors, rods that drift by, fiducial points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.film.angles import AngleWalk
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.dyes import Dyes
from rotortrack.simulate.film.legs import Drive
from rotortrack.simulate.film.rotor import End, Rotor
from rotortrack.simulate.film.wander import Breathing

if TYPE_CHECKING:
    from rotortrack.simulate.film.scene import FilmScene

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Light:
    """An emitter during n frames, in coordinates of the first colour's image, without the stage.

    Attributes
    ----------
    x_nm, y_nm
        Places during the parts of each exposure, shape (n, parts), or (1, parts) where every frame
        is the same.
    photons
        Expected photons a frame, shape (n,) or (1,), without the laser's profile.
    channel
        Colour.
    rotor, end
        Of a rotor, for the truth; -1 for what is none.
    theta_rad
        The rotor's angle averaged over the exposure, shape (n,) or (1,).
    """

    x_nm: Floats
    y_nm: Floats
    photons: Floats
    channel: int
    rotor: int = -1
    end: int = -1
    theta_rad: Floats | None = None


class RotorActor:
    """One rotor that moves by a law of its own."""

    def __init__(
        self,
        rotor: Rotor,
        scene: FilmScene,
        clock: Clock,
        drive: Drive | None,
        rows: tuple[float, ...],
    ) -> None:
        seed = scene.film.seed
        self.rotor = rotor
        self._clock = clock
        self._delays_s = tuple(row * clock.line_time_s for row in rows)
        self._walk = AngleWalk(rotor, clock, seed, drive, self._delays_s)
        self._breathing = Breathing(rotor, clock, seed) if rotor.breathing_sd_nm else None
        self._dyes = [
            Dyes(
                rotor.number,
                number,
                end.photons,
                clock,
                seed,
                dyes=scene.dyes,
                bleaching=scene.bleaching,
                blinking=scene.blinking,
                lit_from_s=rotor.arrive_s,
                delay_s=self._delays_s[number],
            )
            for number, end in enumerate(rotor.ends)
        ]

    @property
    def realised_rad_s(self) -> float:
        """Mean speed so far, which chance made of the rotor's own."""
        return self._walk.realised_rad_s()

    def advance(self, first: int, n: int) -> Iterator[Light]:
        """Give the light of each end in the frames from `first` on."""
        angles = self._walk.advance(n)
        out_nm = None if self._breathing is None else self._breathing.advance(n)
        for number, (end, theta) in enumerate(zip(self.rotor.ends, angles, strict=True)):
            photons, offset_nm = self._dyes[number].advance(n)
            there = self._presence(first, n, self._delays_s[number])
            x_nm, y_nm = _places(self.rotor, end, theta, out_nm, offset_nm, self._walk.inward)
            yield Light(
                x_nm=x_nm,
                y_nm=y_nm,
                photons=photons if there is None else photons * there,
                channel=end.channel,
                rotor=self.rotor.number,
                end=number,
                theta_rad=theta.mean(axis=1),
            )

    def _presence(self, first: int, n: int, delay_s: float) -> Floats | None:
        """Part of each exposure for which the rotor is docked; None where it is always."""
        clock, rotor = self._clock, self.rotor
        if rotor.arrive_s <= 0.0 and rotor.leave_s >= clock.duration_s + delay_s:
            return None
        begin = np.arange(first, first + n) * clock.frame_interval_s + delay_s
        if clock.exposure_s == 0.0:
            inside: Floats = ((begin >= rotor.arrive_s) & (begin < rotor.leave_s)).astype(float)
            return inside
        lit = np.minimum(begin + clock.exposure_s, rotor.leave_s) - np.maximum(
            begin, rotor.arrive_s
        )
        share: Floats = np.clip(lit / clock.exposure_s, 0.0, 1.0)
        return share


def _places(
    rotor: Rotor,
    end: End,
    theta: Floats,
    out_nm: Floats | None,
    offset_nm: Floats | None,
    inward: float,
) -> tuple[Floats, Floats]:
    radius = inward * (end.radius_nm if out_nm is None else end.radius_nm + out_nm[:, np.newaxis])
    place = theta + end.phase_rad
    x_nm = rotor.x_nm + radius * np.cos(place)
    y_nm = rotor.y_nm - radius * np.sin(place)
    if offset_nm is not None:
        along = theta + end.tangent_rad
        x_nm = x_nm + offset_nm[:, np.newaxis] * np.cos(along)
        y_nm = y_nm - offset_nm[:, np.newaxis] * np.sin(along)
    return x_nm, y_nm
