"""Into how many parts an exposure is cut, so that a moving spot is blurred rightly.

Each part is given the *mean* angle over it, drawn jointly with the angle at its end. So the angle
averaged over an exposure has its exact law whatever the number of parts. The position averaged over
a part lies inside the circle, by `inward`; what the number of parts limits is the error of that.
"""

from __future__ import annotations

import math

from rotortrack.errors import ConfigurationError

PART_SPREAD_RAD = 0.1
"""Rms spread by diffusion allowed within a part."""

PART_TURN_RAD = 0.03
"""Turn allowed within a part: at other speeds than the largest `inward` is off by 4e-5 at most."""

PARTS_OF_A_FLIP = 8
"""Parts of an exposure within which a two-position rotor may flip."""

MOST_PARTS = 1000
"""Beyond it the ring has long collapsed to a point and the angle aliases."""


def parts_of(turn_rad: float, spread_rad2: float) -> int:
    """Return the least n with (a turn / n)^2 + 2 spread / n <= `PART_SPREAD_RAD` squared.

    a = `PART_SPREAD_RAD` / `PART_TURN_RAD`.

    Parameters
    ----------
    turn_rad
        Angular speed times exposure.
    spread_rad2
        Diffusion coefficient times exposure.

    Raises
    ------
    ConfigurationError
        More than `MOST_PARTS` were needed.
    """
    tolerance = PART_SPREAD_RAD**2
    turn = turn_rad * PART_SPREAD_RAD / PART_TURN_RAD
    parts = math.ceil((spread_rad2 + math.sqrt(spread_rad2**2 + tolerance * turn**2)) / tolerance)
    if parts > MOST_PARTS:
        raise ConfigurationError(
            f"a rotor that turns {turn_rad:.3g} rad and diffuses {2.0 * spread_rad2:.3g} rad^2 "
            "within an exposure is a blur: lower omega_rad_s, diffusion_rad2_s or exposure_s"
        )
    return max(parts, 1)


def inward(turn_rad: float, spread_rad2: float) -> float:
    """Return the distance of a part's mean position from the centre, over the radius.

    Along the direction of the mean angle, and on average over paths: the variance of the angle
    about its mean over the part is turn^2 / 12 + spread / 3, and half of it is missing from the
    cosine.

    Parameters
    ----------
    turn_rad, spread_rad2
        Angular speed and diffusion coefficient, times the duration of the part.
    """
    return math.exp(-(turn_rad**2) / 24.0 - spread_rad2 / 6.0)
