"""The angle of a rotor during every exposure, in exact steps, frame after frame.

A frame's period is cut into segments: the parts of the exposure (see exposure.py) and the time
until the next one. Each segment is given the mean angle over it, drawn jointly with the angle at
its end. Draws and sums go on from segment to segment, so nothing depends on how many frames are
asked for at a time, and the path at the beginnings of frames not on how periods are cut.

Under a rolling shutter the two ends of a rotor may be exposed at different times. The period is
then cut at the parts of both ends, so that both see the same path.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.exposure import PARTS_OF_A_FLIP, inward, parts_of
from rotortrack.simulate.film.legs import Drive, Flips, Legs, Poses
from rotortrack.simulate.film.rotor import Rotor
from rotortrack.simulate.film.segments import Segments
from rotortrack.simulate.film.streams import Effect, stream
from rotortrack.simulate.film.wander import Brownian, Streams, Wander, Wobble

Floats = NDArray[np.float64]

_ARC_STEPS = 40
"""A path between walls is followed in steps of at most this part of their distance, rms."""

_FINEST_RAD = 0.01
"""Smaller steps than this are never needed: they are far below what a camera resolves."""


class AngleWalk:
    """The angle of one rotor, given frame after frame.

    ============  =============================================================================
    motion        angle
    ============  =============================================================================
    driven        start + omega t + Brownian motion with D
    brownian      start + Brownian motion with D
    switching     as driven; the direction flips at random moments
    stuck         start
    tethered      start + an Ornstein-Uhlenbeck process of standard deviation wobble_sd_rad that
                  diffuses with D at short times, stationary
    two_position  as tethered, and half a turn on or back at random moments
    arc           Brownian motion with D, reflected arc_rad / 2 to either side of start
    ============  =============================================================================

    Parameters
    ----------
    rotor, clock
        How it moves; when frames are exposed.
    seed
        Of the film.
    drive
        Factor of omega in time; None for 1.
    delays_s
        How much later each labelled end is exposed, at most a frame interval.

    Attributes
    ----------
    parts
        Parts of an exposure.
    inward
        Distance of a part's mean position from the centre, over the radius.

    Raises
    ------
    ConfigurationError
        The rotor turns too much within an exposure to be followed.
    """

    def __init__(
        self,
        rotor: Rotor,
        clock: Clock,
        seed: int,
        drive: Drive | None = None,
        delays_s: tuple[float, ...] = (0.0,),
    ) -> None:
        self._rotor = rotor
        self._delays = len(delays_s)
        self._frame = self._seen = 0
        self._first = self._last = rotor.start_rad
        self.parts, self.inward = 1, 1.0
        if rotor.motion == "stuck":
            return
        turn_rad, spread_rad2 = _turn_and_spread(rotor, clock, drive)
        self.parts = _parts(rotor, turn_rad, spread_rad2)
        self.inward = inward(turn_rad / self.parts, spread_rad2 / self.parts)
        self._finer = _steps_of_a_part(rotor, clock, self.parts)
        self._segments = Segments(clock, self.parts * self._finer, delays_s)
        self._wander = self._make_wander(Streams.of(seed, Effect.MOTION, rotor.number))
        flips = None
        if rotor.switch_rate_per_s:
            flips = Flips(rotor.switch_rate_per_s, stream(seed, Effect.EVENTS, rotor.number))
        self._legs = Legs(drive, flips) if rotor.omega_rad_s else None
        self._poses = Poses(flips) if rotor.motion == "two_position" and flips else None
        self._ahead: Floats | None = None

    def advance(self, n: int) -> tuple[Floats, ...]:
        """Give the mean angle over each part of the exposures of the next n frames.

        Returns
        -------
        tuple of arrays
            One for each delay, (n, parts), rad, never wrapped; (1, 1) for what is stuck. Ends that
            are exposed together share one array.
        """
        if self._rotor.motion == "stuck":
            return (np.full((1, 1), self._rotor.start_rad),) * self._delays
        segments = self._segments
        if not segments.straddles:
            path = self._path(n)
        else:
            ahead = self._path(1) if self._ahead is None else self._ahead
            path = np.concatenate([ahead, self._path(n)])
            self._ahead = path[-1:].copy()
            path = np.concatenate([path[:-1], path[1:]], axis=1)
        seen: dict[float, Floats] = {}
        for delay_s in segments.delays_s:
            if delay_s not in seen:
                means = segments.exposed(path, delay_s)
                if self._finer > 1:
                    means = means.reshape(n, self.parts, self._finer).mean(axis=2)
                seen[delay_s] = means
        self._note(seen[segments.delays_s[0]])
        return tuple(seen[delay_s] for delay_s in segments.delays_s)

    def realised_rad_s(self) -> float:
        """Give the mean speed between the first and the last exposure so far, 0 for one alone."""
        if self._seen < 2:
            return 0.0
        elapsed_s = (self._seen - 1) * self._segments.period_s
        return (self._last - self._first) / elapsed_s

    def _note(self, angles: Floats) -> None:
        if not self._seen:
            self._first = float(angles[0].mean())
        self._last = float(angles[-1].mean())
        self._seen += len(angles)

    def _path(self, n: int) -> Floats:
        """Give the mean angle over each segment of the next n periods, shape (n, segments)."""
        segments = self._segments
        length_s = segments.length_s
        begin_s = segments.begin_s(self._frame, n)
        self._frame += n
        path = self._rotor.start_rad + self._wander.advance(n)
        if self._legs is not None:
            path = path + self._rotor.omega_rad_s * self._legs.means(begin_s, length_s)
        if self._poses is not None:
            path = path + self._poses.means(begin_s, length_s)
        return path

    def _make_wander(self, streams: Streams) -> Wander:
        rotor, length_s = self._rotor, self._segments.length_s
        if rotor.wobble_sd_rad:
            return Wobble(rotor.wobble_sd_rad, rotor.diffusion_rad2_s, length_s, streams)
        if rotor.diffusion_rad2_s:
            return Brownian(rotor.diffusion_rad2_s, length_s, streams, rotor.arc_rad)
        return Wander(length_s)


def _turn_and_spread(rotor: Rotor, clock: Clock, drive: Drive | None) -> tuple[float, float]:
    """Give the turn by the largest speed, and D times the duration, of an exposure."""
    largest = 1.0 if drive is None else drive.largest
    turn_rad = abs(rotor.omega_rad_s) * largest * clock.exposure_s
    return turn_rad, rotor.diffusion_rad2_s * clock.exposure_s


def _parts(rotor: Rotor, turn_rad: float, spread_rad2: float) -> int:
    if turn_rad == spread_rad2 == 0.0:
        return 1
    parts = parts_of(turn_rad, spread_rad2)
    return max(parts, PARTS_OF_A_FLIP) if rotor.motion == "two_position" else parts


def _steps_of_a_part(rotor: Rotor, clock: Clock, parts: int) -> int:
    """In how many steps each part is followed, so that walls act on the path and not on its mean.

    Against walls this far apart in steps, the variances of exposure means and of their increments
    are right within 1 %.
    """
    step_rad = max(rotor.arc_rad / _ARC_STEPS, _FINEST_RAD)
    spread_rad2 = 2.0 * rotor.diffusion_rad2_s * clock.exposure_s / parts
    return max(math.ceil(spread_rad2 / step_rad**2), 1) if rotor.arc_rad else 1
