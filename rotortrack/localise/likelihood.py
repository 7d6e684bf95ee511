"""The likelihood of photo-electrons with Poisson noise and Gaussian read noise.

Adding the read variance v of a pixel to its value and to its expectation makes the sum very nearly
Poisson distributed (Huang et al., Nature Methods 10, 653 (2013)). The deviance

    2 sum [mu' - k' + k' ln(k' / mu')],   k' = max(d + v, 0),  mu' = mu + v

is minus twice the log-likelihood ratio to a perfect fit; its minimum is the maximum of the
likelihood.
"""

from __future__ import annotations

import math

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

SMALLEST_EXPECTATION = 1e-9
"""Expected photons of a pixel are kept above this, so that the logarithm exists."""


@kernel
def deviance(
    data: NDArray[np.float64],
    variance: NDArray[np.float64],
    keep: NDArray[np.float64],
    parameters: NDArray[np.float64],
    along_x: NDArray[np.float64],
    along_y: NDArray[np.float64],
    gradient: NDArray[np.float64],
    curvature: NDArray[np.float64],
) -> float:
    """Compute the deviance of a window with its gradient and Fisher information.

    Parameters
    ----------
    data, variance, keep
        (n, n) photons, read variance (electrons^2), and 1 or 0 for pixels that count.
    parameters
        (5,) x, y, photons, background, sigma.
    along_x, along_y
        (3, n) scratch for the profiles.
    gradient, curvature
        (5,) the gradient of the log-likelihood, (5, 5) its Fisher information (lower triangle).

    Returns
    -------
    float
        The deviance.
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
            if keep[i, j] == 0.0:
                continue
            light = pixel_gradient(along_x, along_y, i, j, photons, slope)
            expected = parameters[BACKGROUND] + photons * light + variance[i, j]
            expected = max(expected, SMALLEST_EXPECTATION)
            observed = max(data[i, j] + variance[i, j], 0.0)
            total += expected - observed
            if observed > 0.0:
                total += observed * math.log(observed / expected)
            pull = observed / expected - 1.0
            information = 1.0 / expected
            for a in range(PARAMETERS):
                gradient[a] += pull * slope[a]
                weighted = information * slope[a]
                for b in range(a + 1):
                    curvature[a, b] += weighted * slope[b]
    return 2.0 * total
