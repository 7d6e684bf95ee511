"""Into how many parts an exposure is cut, so that a moving spot is blurred rightly.

Each part is given the *mean* angle over it, drawn jointly with the angle at its end. So the angle
averaged over an exposure has its exact law whatever the number of parts; what their number limits
is the radius of the averaged position, within 0.1 % of R.
"""

from __future__ import annotations

import math

from rotortrack.errors import ConfigurationError

PART_TURN_RAD = 0.1
"""Rms turn allowed within a part: mean and end of a part then differ by < 1e-3 of the radius."""

PARTS_OF_A_FLIP = 8
"""Parts of an exposure within which a two-position rotor may flip."""

MOST_PARTS = 1000
"""Beyond it the ring has long collapsed to a point and the angle aliases."""


def parts_of(turn_rad: float, spread_rad2: float) -> int:
    """Return the least n with (turn / n)^2 + 2 spread / n <= `PART_TURN_RAD` squared.

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
    tolerance = PART_TURN_RAD**2
    parts = math.ceil(
        (spread_rad2 + math.sqrt(spread_rad2**2 + tolerance * turn_rad**2)) / tolerance
    )
    if parts > MOST_PARTS:
        raise ConfigurationError(
            f"a rotor that turns {turn_rad:.3g} rad and diffuses {2.0 * spread_rad2:.3g} rad^2 "
            "within an exposure is a blur: lower omega_rad_s, diffusion_rad2_s or exposure_s"
        )
    return max(parts, 1)
