"""How motion during the exposure shrinks the circle that a rotor seems to trace."""

from __future__ import annotations

import cmath
import math

_SERIES_BELOW = 1e-2


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
        # The quotient loses all its digits to cancellation here.
        return math.sqrt(
            (1.0 - c / 3.0 + c**2 / 12.0 - c**3 / 60.0 + c**4 / 360.0 - c**5 / 2520.0).real
        )
    return math.sqrt(2.0 * ((cmath.exp(-c) - 1.0 + c) / c**2).real)
