"""What unweighted and weighted least squares minimise, with gradient and curvature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.gaussian import (
    BACKGROUND,
    PARAMETERS,
    PHOTONS,
    SIGMA,
    X,
    Y,
    pixel_gradient,
    profile,
)

SMALLEST_VALUE_OF_LARGEST = 1e-3
"""Weights 1/value are cut where a value is less than this part of the window's largest."""


@kernel
def inverse_value_weights(
    data: NDArray[np.float64], keep: NDArray[np.float64], weights: NDArray[np.float64]
) -> None:
    """Fill the weights of weighted least squares: 1/value, capped.

    Weights from the data themselves are what ThunderSTORM uses; they bias the background low and
    the photons high (Neyman), which the likelihood does not.

    Parameters
    ----------
    data, keep, weights
        (n, n) photons, 1 or 0 for pixels that count, and the result.
    """
    largest = 0.0
    n = data.shape[0]
    for i in range(n):
        for j in range(n):
            if keep[i, j] > 0.0:
                largest = max(largest, data[i, j])
    floor = largest * SMALLEST_VALUE_OF_LARGEST
    for i in range(n):
        for j in range(n):
            if keep[i, j] > 0.0 and floor > 0.0:
                weights[i, j] = 1.0 / max(data[i, j], floor)
            else:
                weights[i, j] = 0.0


@kernel
def squares(
    data: NDArray[np.float64],
    weights: NDArray[np.float64],
    parameters: NDArray[np.float64],
    along_x: NDArray[np.float64],
    along_y: NDArray[np.float64],
    gradient: NDArray[np.float64],
    curvature: NDArray[np.float64],
) -> float:
    """Sum ``w (d - mu)^2`` over a window.

    Parameters
    ----------
    data, weights
        (n, n) photons and weights.
    parameters
        (5,) x, y, photons, background, sigma.
    along_x, along_y
        (3, n) scratch for the profiles.
    gradient, curvature
        (5,) minus half the gradient, (5, 5) the Gauss-Newton half Hessian.

    Returns
    -------
    float
        The sum.
    """
    n = data.shape[0]
    profile(parameters[X], parameters[SIGMA], along_x)
    profile(parameters[Y], parameters[SIGMA], along_y)
    photons = parameters[PHOTONS]
    slope = np.empty(PARAMETERS)
    gradient[:] = 0.0
    curvature[:, :] = 0.0
    total = 0.0
    for i in range(n):
        for j in range(n):
            weight = weights[i, j]
            if weight == 0.0:
                continue
            light = pixel_gradient(along_x, along_y, i, j, photons, slope)
            residual = data[i, j] - parameters[BACKGROUND] - photons * light
            total += weight * residual * residual
            for a in range(PARAMETERS):
                weighted = weight * slope[a]
                gradient[a] += weighted * residual
                for b in range(a + 1):
                    curvature[a, b] += weighted * slope[b]
    return total
