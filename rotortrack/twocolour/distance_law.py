"""How long an end-to-end vector is measured whose true length breathes and whose ends are noisy.

The true distance of both ends is m + b g with g standard normal: mean m, breathing b. Noise of
standard deviation s per axis is added to the vector, so that along its own direction the measured
vector is normal about m with the variance A = s^2 + b^2, and across normal about 0 with B = s^2.
Its direction is not used: a rotor turns. The length r then has the density (Beckmann, 1962; Rice's
for b = 0)

    f(r) = r / (2 pi sqrt(A B)) int exp(-(r cos u - m)^2 / 2 A - (r sin u)^2 / 2 B) du.

The integrand peaks at u = 0 and, where the law is wide, at u = pi; each peak is integrated by
itself over the part that counts. Where b is not small against m, b g passes m: the vector then
points backwards, and its length is the distance, |m + b g|.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel

Floats = NDArray[np.float64]

_NODES, _WEIGHTS = (part.astype(np.float64) for part in np.polynomial.legendre.leggauss(24))
_WINDOW = 11.0
_NEGLIGIBLE = 40.0


def log_density(
    lengths_nm: Floats, noise_nm: Floats, mean_nm: float, breathing_nm: float
) -> Floats:
    """Give the logarithm of the density of measured lengths.

    Parameters
    ----------
    lengths_nm, noise_nm
        Measured lengths, at least 0, and the noise of their vectors per axis, above 0; (n,).
    mean_nm, breathing_nm
        Mean and standard deviation of the true distance, at least 0.

    Returns
    -------
    Shape (n,), per nm; minus infinity at a length of 0. Errors are below 1e-8.
    """
    return log_density_slopes(lengths_nm, noise_nm, mean_nm, breathing_nm)[:, 0]


def log_density_slopes(
    lengths_nm: Floats, noise_nm: Floats, mean_nm: float, breathing_nm: float
) -> Floats:
    """Give the logarithm of the density of measured lengths, and how it changes.

    Parameters
    ----------
    lengths_nm, noise_nm, mean_nm, breathing_nm
        As of `log_density`.

    Returns
    -------
    Shape (n, 4): the logarithm, and its derivatives by the mean, by the breathing (both per nm)
    and by the logarithm of the noise; where a length is 0, minus infinity and nan.
    """
    lengths = np.ascontiguousarray(lengths_nm, np.float64)
    noise = np.ascontiguousarray(noise_nm, np.float64)
    values = np.empty((lengths.size, 4))
    fill_log_densities(
        lengths, noise, float(mean_nm), float(breathing_nm), _NODES, _WEIGHTS, values
    )
    return values


@kernel
def fill_log_densities(
    lengths: Floats,
    noise: Floats,
    mean: float,
    breathing: float,
    nodes: Floats,
    weights: Floats,
    values: Floats,
) -> None:
    """Fill in logarithm and derivatives of every length, by Gauss-Legendre on both peaks."""
    for i in range(lengths.size):
        s = noise[i]
        if lengths[i] == 0.0:
            values[i, 0] = -np.inf
            values[i, 1:] = np.nan
            continue
        # In units of the noise, so that no square leaves the range of numbers.
        r, m, b = lengths[i] / s, mean / s, breathing / s
        along = 1.0 + b * b
        steep = m / along * r
        bent = 0.5 * r * r * (b * b / along)
        total, versed, squared = _peak(steep, bent, nodes, weights)
        if 2.0 * steep < _NEGLIGIBLE:
            share = np.exp(-2.0 * steep)
            other, other_versed, other_squared = _peak(-steep, bent, nodes, weights)
            total += share * other
            versed += share * (2.0 * other - other_versed)
            squared += share * other_squared
        versed /= total
        squared /= total
        off = (r - m) / along
        by_mean = off - r / along * versed
        by_square = (
            0.5 * (off * off - 1.0 / along)
            + (m / along) * (r / along) * versed
            - 0.5 * (r / along) ** 2 * squared
        )
        by_length = 1.0 - r * off - steep * versed - 2.0 * bent * squared
        values[i, 0] = (
            np.log(r / (s * np.pi * np.sqrt(along))) - 0.5 * off * (r - m) + np.log(total)
        )
        values[i, 1] = by_mean / s
        values[i, 2] = 2.0 * b * by_square / s
        values[i, 3] = -1.0 - by_length - m * by_mean - 2.0 * b * b * by_square


@kernel
def _peak(steep: float, bent: float, nodes: Floats, weights: Floats) -> tuple[float, float, float]:
    """Integrate exp(-steep (1 - cos u) - bent sin^2 u) over u from 0 to where it is nothing.

    Over t = sin(u / 2), which needs no sine: 1 - cos u = 2 t^2, du = 2 dt / sqrt(1 - t^2). Returned
    are the integral, and those of the integrand times 1 - cos u and times sin^2 u.
    """
    curved = steep + 2.0 * bent
    end = np.sqrt(0.5)
    if curved > (_WINDOW / (0.5 * np.pi)) ** 2:
        end = np.sin(0.5 * _WINDOW / np.sqrt(curved))
    total = versed = squared = 0.0
    for j in range(nodes.size):
        t = 0.5 * end * (1.0 + nodes[j])
        square = t * t
        rest = 1.0 - square
        part = (
            weights[j] * np.exp(-2.0 * steep * square - 4.0 * bent * square * rest) / np.sqrt(rest)
        )
        total += part
        versed += part * 2.0 * square
        squared += part * 4.0 * square * rest
    return float(end * total), float(end * versed), float(end * squared)
