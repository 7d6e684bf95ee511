"""Whether distances from a centre are those of a ring or of a blob."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import i0e

_NOISE_KNOWN_TO = 0.15
_MOST_SURPRISE = 9.0
_BLOCK = 50
_FEWEST_BLOCKS = 8


def ring_evidence(
    x_nm: NDArray[np.float64],
    y_nm: NDArray[np.float64],
    x_centre_nm: float,
    y_centre_nm: float,
    noise_nm: float = math.nan,
) -> float:
    """Difference of the Bayesian information criteria of a blob and of a ring; > 6 speaks for one.

    Only the distances r from the centre are compared, so that it does not matter where on its ring
    a rotor dwells: p(r) = (r / s^2) exp(-(r^2 + R^2) / 2 s^2) I0(r R / s^2), with R = 0 (a blob,
    one parameter) against R free. Distances beyond four times their median are left out as
    background.

    Parameters
    ----------
    x_nm, y_nm
        Positions of one rotor in order of time, shape (n,), nm.
    x_centre_nm, y_centre_nm
        Centre of its circle, or the mean position, nm.
    noise_nm
        Expected noise per axis, believed to 15 %: a blob wider than that speaks for the ring, by 9
        at most, since noise may be wider than expected, too. nan where it is not known.

    Returns
    -------
    BIC(blob) - BIC(ring); nan for fewer than 10 positions or when all coincide.

    Notes
    -----
    About 2 ms for 2000 positions. Distances of a rotor are independent from frame to frame however
    slowly it turns; those of a spot that wanders are not, and are thinned until they are.
    """
    r = np.hypot(x_nm - x_centre_nm, y_nm - y_centre_nm)
    middle = float(np.median(r)) if r.size else 0.0
    r = r[r <= 4.0 * middle]
    r = r[:: _alike(r)]
    if r.size < 10 or not middle > 0.0:
        return math.nan
    r = r / middle
    square = r * r
    mean = float(square.mean())
    # At the maximum 2 s^2 = <r^2> - R^2, which leaves one parameter to search.
    best = minimize_scalar(
        lambda radius: -_log_likelihood(radius, r, square, mean),
        bounds=(0.0, math.sqrt(mean) * (1.0 - 1e-9)),
        method="bounded",
    )
    gain = max(0.0, -float(best.fun) - _log_likelihood(0.0, r, square, mean))
    radius = float(best.x) if gain > 0.0 else 0.0
    told = _surprise(mean, noise_nm / middle) - _surprise(mean - radius**2, noise_nm / middle)
    return 2.0 * gain - math.log(r.size) + told


def _surprise(twice_variance: float, expected: float) -> float:
    """Square of how many of its standard deviations log noise lies from the expected one."""
    if not expected > 0.0:
        return 0.0
    strayed = 0.5 * math.log(0.5 * twice_variance) - math.log(expected)
    return min((strayed / _NOISE_KNOWN_TO) ** 2, _MOST_SURPRISE)


def _alike(r: NDArray[np.float64]) -> int:
    """How many successive distances say the same, by the scatter of their means over blocks."""
    blocks = r.size // _BLOCK
    if blocks < _FEWEST_BLOCKS:
        return 1
    values = r[: blocks * _BLOCK]
    means = values.reshape(blocks, _BLOCK).mean(axis=1)
    variance = float(values.var())
    if not variance > 0.0:
        return 1
    excess = _BLOCK * float(means.var(ddof=1)) / variance
    # Four standard errors of a variance from so many blocks.
    return math.ceil(excess) if excess > 1.0 + 4.0 * math.sqrt(2.0 / (blocks - 1)) else 1


def _log_likelihood(
    radius: float, r: NDArray[np.float64], square: NDArray[np.float64], mean: float
) -> float:
    """Log-likelihood of R with its best s, less the sum of log r; `mean` is that of `square`."""
    noise2 = 0.5 * (mean - radius * radius)
    argument = r * (radius / noise2)
    exponent = -(square + radius * radius) / (2.0 * noise2) + argument + np.log(i0e(argument))
    return float(exponent.sum()) - r.size * math.log(noise2)
