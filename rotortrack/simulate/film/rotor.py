"""One rotor of a film: what population.py draws, and what motion and light follow."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rotortrack.simulate.film.options import Motion


@dataclass(frozen=True, kw_only=True)
class End:
    """A labelled end. At angle theta it stands at radius_nm under theta + phase_rad.

    Attributes
    ----------
    radius_nm, phase_rad
        Polar coordinates about the pore, counter-clockwise on the image, at angle 0.
    tangent_rad
        Direction of the rod towards its tip, at angle 0, as seen from above.
    photons
        Expected photons a frame with every dye lit, in the middle of the laser.
    channel
        Colour, 0 or 1.
    """

    radius_nm: float
    phase_rad: float
    tangent_rad: float
    photons: float
    channel: int


@dataclass(frozen=True, kw_only=True)
class Rotor:
    """A rotor: x = x_nm + R cos(theta + phase), y = y_nm - R sin(theta + phase) for each end.

    Attributes
    ----------
    number, pore, group
        From 0; rotors of one pore share its number; group is the place of its [[rotors]] table.
    x_nm, y_nm
        The pore, from the outer corner of pixel (0, 0) of the first colour's image, y down.
    omega_rad_s
        Signed, counter-clockwise positive; 0 for what is not driven.
    start_rad
        Angle at time 0.
    arrive_s, leave_s
        It is there in between.
    """

    number: int
    pore: int
    group: int
    motion: Motion
    x_nm: float
    y_nm: float
    ends: tuple[End, ...]
    omega_rad_s: float = 0.0
    diffusion_rad2_s: float = 0.0
    start_rad: float = 0.0
    switch_rate_per_s: float = 0.0
    wobble_sd_rad: float = 0.0
    arc_rad: float = 0.0
    breathing_sd_nm: float = 0.0
    breathing_time_s: float = 0.0
    arrive_s: float = 0.0
    leave_s: float = math.inf
