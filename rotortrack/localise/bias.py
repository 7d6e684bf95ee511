"""The bias of likelihood fits at few photons, to second order."""

from __future__ import annotations

import math
from typing import Final

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
    bend,
    pixel_gradient,
    profile,
)
from rotortrack.localise.likelihood import SMALLEST_EXPECTATION

LONGEST_CORRECTION: Final = 0.5
"""A correction longer than this, in standard deviations, is shortened to it: where the bias is as
large as the error, two orders of the series do not tell it."""


@kernel
def correct(
    parameters: NDArray[np.float64],
    variance: NDArray[np.float64],
    keep: NDArray[np.float64],
    matrix: NDArray[np.float64],
) -> None:
    """Subtract the bias of Cox and Snell from the parameters of a likelihood fit.

    For expectations mu with variances V = mu + v, Jacobian J and Hessians H_i of pixel i,

        bias = -1/2 C sum_i J_i tr(H_i C) / V_i

    with C the inverse Fisher information. Since the mean enters linearly and the information has
    weights 1 / V, the terms from the change of the variance cancel (Cox and Snell, J. R. Stat. Soc.
    B 30, 248 (1968), in general).

    Parameters
    ----------
    parameters
        (5,) optimum, replaced by the corrected parameters.
    variance, keep
        (n, n) read variance (electrons^2), and 1 or 0 for pixels that count.
    matrix
        (5, 5) covariance of the parameters that were fitted, 0 for the others.
    """
    n = keep.shape[0]
    along_x = np.empty((3, n))
    along_y = np.empty((3, n))
    bend_x = np.empty((2, n))
    bend_y = np.empty((2, n))
    sigma = parameters[SIGMA]
    photons = parameters[PHOTONS]
    profile(parameters[X], sigma, along_x)
    profile(parameters[Y], sigma, along_y)
    bend(parameters[X], sigma, bend_x)
    bend(parameters[Y], sigma, bend_y)
    slope = np.empty(PARAMETERS)
    total = np.zeros(PARAMETERS)
    for i in range(n):
        gy, dy, sy = along_y[0, i], along_y[1, i], along_y[2, i]
        for j in range(n):
            if keep[i, j] == 0.0:
                continue
            gx, dx, sx = along_x[0, j], along_x[1, j], along_x[2, j]
            light = pixel_gradient(along_x, along_y, i, j, photons, slope)
            expected = parameters[BACKGROUND] + photons * light + variance[i, j]
            trace = photons * (
                matrix[X, X] * sx * gy / sigma
                + matrix[Y, Y] * gx * sy / sigma
                + 2.0 * matrix[X, Y] * dx * dy
                + 2.0 * matrix[X, SIGMA] * (bend_x[0, j] * gy + dx * sy)
                + 2.0 * matrix[Y, SIGMA] * (gx * bend_y[0, i] + sx * dy)
                + matrix[SIGMA, SIGMA] * (bend_x[1, j] * gy + 2.0 * sx * sy + gx * bend_y[1, i])
            ) + 2.0 * (
                matrix[X, PHOTONS] * dx * gy
                + matrix[Y, PHOTONS] * gx * dy
                + matrix[PHOTONS, SIGMA] * (sx * gy + gx * sy)
            )
            half = 0.5 * trace / max(expected, SMALLEST_EXPECTATION)
            for a in range(PARAMETERS):
                total[a] += half * slope[a]
    step = np.zeros(PARAMETERS)
    squared = 0.0
    for a in range(PARAMETERS):
        for b in range(PARAMETERS):
            step[a] += matrix[a, b] * total[b]
        squared += step[a] * total[a]
    part = min(1.0, LONGEST_CORRECTION / math.sqrt(squared)) if squared > 0.0 else 1.0
    for a in range(PARAMETERS):
        parameters[a] += part * step[a]
    parameters[PHOTONS] = max(parameters[PHOTONS], 0.5 * photons)
    parameters[SIGMA] = max(parameters[SIGMA], 0.5 * sigma)
    parameters[BACKGROUND] = max(parameters[BACKGROUND], 0.0)
