"""What every likelihood of a rotor's motion gives: estimates, intervals, a test of no drift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]

IDENTIFIED = 0.15
"""Relative standard deviation of D above which its interval is a one-sided limit."""


@dataclass(frozen=True)
class Fit:
    """Maximum of a likelihood with profile intervals of 95 %.

    Attributes
    ----------
    omega_rad_s, omega_sd_rad_s, omega_interval_rad_s
        Signed speed, standard deviation and profile interval.
    drift_p
        Likelihood-ratio test of omega = 0.
    diffusion_rad2_s, diffusion_sd_rad2_s, diffusion_interval_rad2_s
        D of the restricted likelihood (omega integrated out, so that estimating it does not make
        D too small). The interval starts at zero where D is hardly known; the upper limit stays
        that of two sides, since which rotors get one side depends on the estimate.
    diffusion_relative_sd
        Standard deviation of log D by the information at the maximum; inf where D = 0.
    noise_factor
        Factor on the given noise variances.
    """

    omega_rad_s: float
    omega_sd_rad_s: float
    omega_interval_rad_s: tuple[float, float]
    drift_p: float
    diffusion_rad2_s: float
    diffusion_sd_rad2_s: float
    diffusion_interval_rad2_s: tuple[float, float]
    diffusion_relative_sd: float
    noise_factor: float

    @property
    def one_sided(self) -> bool:
        """Whether D is so uncertain that only its upper limit is given."""
        return not self.diffusion_relative_sd <= IDENTIFIED


_SMALLEST_VARIANCE = 1e-300
"""Squares of uncertainties below vanish."""

NAN = math.nan
NO_FIT = Fit(NAN, NAN, (NAN, NAN), NAN, NAN, NAN, (NAN, NAN), NAN, NAN)


def freedom(diffusion_relative_sd: float) -> float:
    """Degrees of freedom of a variance that is as uncertain as D."""
    return max(2.0 / max(diffusion_relative_sd**2, _SMALLEST_VARIANCE), 1.0)


def quantile(degrees: float) -> float:
    """Square of Student's quantile for intervals of 95 %, that of chi-square for many degrees."""
    return float(stats.t.isf(0.025, degrees)) ** 2


def profile_rise(degrees: float) -> float:
    """Rise of the deviance at the ends of an interval, the other parameters following.

    That of a normal mean whose variance is estimated with f degrees of freedom,
    ``f log(1 + t^2 / f)``; 3.84 for many and 5.1 for one of them.
    """
    return degrees * math.log1p(quantile(degrees) / degrees)


def student_square(deviance: float, degrees: float) -> float:
    """Square of Student's t that has this deviance where D follows omega."""
    return degrees * math.expm1(min(max(deviance, 0.0) / degrees, 700.0))


def drift_p(square: float, degrees: float) -> float:
    """Probability of such a square of Student's t, or a larger one, without drift."""
    return 2.0 * float(stats.t.sf(math.sqrt(max(square, 0.0)), degrees))
