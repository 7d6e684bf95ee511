"""How long an end-to-end vector is measured whose true length breathes and whose ends are noisy.

The true distance of both ends is m + b g with g standard normal: mean m, breathing b. Noise of
standard deviation s per axis is added to the vector, so that along its own direction the measured
vector is normal about m with the variance A = s^2 + b^2, and across normal about 0 with B = s^2.
Its direction is not used: a rotor turns. The length r then has the density (Beckmann, 1962; Rice's
for b = 0)

    f(r) = r / (2 pi sqrt(A B)) int exp(-(r cos u - m)^2 / 2 A - (r sin u)^2 / 2 B) du.

The integrand peaks at u = 0 and, where the law is wide, at u = pi; each peak is integrated by
itself over the part that counts.
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
    Shape (n,), per nm; minus infinity at a length of 0.
    """
    lengths = np.ascontiguousarray(lengths_nm, np.float64)
    noise = np.ascontiguousarray(noise_nm, np.float64)
    values = np.empty(lengths.size)
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
    """Fill in the logarithm of the density of every length, by Gauss-Legendre on both peaks."""
    for i in range(lengths.size):
        r, s = lengths[i], noise[i]
        if r == 0.0:
            values[i] = -np.inf
            continue
        # In units of the noise, so that no square leaves the range of numbers.
        r, m, b = r / s, mean / s, breathing / s
        along = 1.0 + b * b
        steep = m / along * r
        bent = 0.5 * r * r * (b * b / along)
        total = _peak(steep, bent, nodes, weights)
        if 2.0 * steep < _NEGLIGIBLE:
            total += np.exp(-2.0 * steep) * _peak(-steep, bent, nodes, weights)
        off = r - m
        values[i] = (
            np.log(r / (s * np.pi * np.sqrt(along))) - 0.5 * off * off / along + np.log(total)
        )


@kernel
def _peak(steep: float, bent: float, nodes: Floats, weights: Floats) -> float:
    """Integrate exp(-steep (1 - cos u) - bent sin^2 u) over u from 0 to where it is nothing.

    Over t = sin(u / 2), which needs no sine: 1 - cos u = 2 t^2, du = 2 dt / sqrt(1 - t^2).
    """
    curved = steep + 2.0 * bent
    end = np.sqrt(0.5)
    if curved > (_WINDOW / (0.5 * np.pi)) ** 2:
        end = np.sin(0.5 * _WINDOW / np.sqrt(curved))
    total = 0.0
    for j in range(nodes.size):
        t = 0.5 * end * (1.0 + nodes[j])
        square = t * t
        rest = 1.0 - square
        total += (
            weights[j] * np.exp(-2.0 * steep * square - 4.0 * bent * square * rest) / np.sqrt(rest)
        )
    return float(end * total)
