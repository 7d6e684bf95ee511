"""How motion during the exposure shrinks the circle that a rotor seems to trace."""

from __future__ import annotations

import cmath
import math

_SERIES_BELOW = 0.5
_SERIES_TERMS = 14


def radius_factor(omega_rad_s: float, diffusion_rad2_s: float, exposure_s: float) -> float:
    """Root-mean-square radius of exposure-averaged positions over the true radius.

    ``sqrt(2 Re[(exp(-c) - 1 + c) / c^2])`` with ``c = (D - i omega) t``; about
    ``1 - D t / 6 - (omega t)^2 / 24``.

    Parameters
    ----------
    omega_rad_s, diffusion_rad2_s
        Angular speed (rad/s) and diffusion coefficient (rad^2/s).
    exposure_s
        Exposure, s.

    Returns
    -------
    float
        Factor in (0, 1]; 1 where speed or diffusion is not known.
    """
    c = complex(max(diffusion_rad2_s, 0.0), -omega_rad_s) * exposure_s
    if not (math.isfinite(c.real) and math.isfinite(c.imag)):
        return 1.0
    if abs(c) < _SERIES_BELOW:
        # The quotient loses its digits to cancellation here.
        total = term = complex(1.0)
        for n in range(3, 3 + _SERIES_TERMS):
            term *= -c / n
            total += term
        return math.sqrt(total.real)
    return math.sqrt(2.0 * ((cmath.exp(-c) - 1.0 + c) / c**2).real)
