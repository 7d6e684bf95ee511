"""The fitted model: a Gaussian integrated over square pixels, on a flat background.

    mu_ij = b + N g(x; j, s) g(y; i, s),
    g(x; k, s) = 1/2 [erf((k + 1/2 - x) / (s sqrt 2)) - erf((k - 1/2 - x) / (s sqrt 2))]

with positions in pixels from the centre of the window's middle pixel. The parameters are ordered
x, y, photons N, background b, width s everywhere.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel

X, Y, PHOTONS, BACKGROUND, SIGMA = range(5)
PARAMETERS = 5

_SQRT_HALF = math.sqrt(0.5)
_INVERSE_SQRT_2PI = 1.0 / math.sqrt(2.0 * math.pi)


@kernel
def profile(position: float, sigma: float, values: NDArray[np.float64]) -> None:
    """Integrate a unit Gaussian over the pixels of one axis, with its derivatives.

    Parameters
    ----------
    position, sigma
        Centre (pixels from the middle pixel's centre) and width in pixels.
    values
        (3, n) receives the integral, its derivative by position, and by sigma.
    """
    count = values.shape[1]
    edge = -0.5 * count - position
    scaled = edge / sigma
    below_erf = math.erf(scaled * _SQRT_HALF)
    below_density = math.exp(-0.5 * scaled * scaled) * _INVERSE_SQRT_2PI / sigma
    below_moment = scaled * below_density
    for k in range(count):
        scaled = (edge + k + 1.0) / sigma
        above_erf = math.erf(scaled * _SQRT_HALF)
        above_density = math.exp(-0.5 * scaled * scaled) * _INVERSE_SQRT_2PI / sigma
        above_moment = scaled * above_density
        values[0, k] = 0.5 * (above_erf - below_erf)
        values[1, k] = below_density - above_density
        values[2, k] = below_moment - above_moment
        below_erf = above_erf
        below_density = above_density
        below_moment = above_moment


@kernel
def bend(position: float, sigma: float, values: NDArray[np.float64]) -> None:
    """Fill the second derivatives of one axis of the profile.

    The Gaussian obeys the heat equation, so its second derivative by position is the first by
    sigma, divided by sigma: :func:`profile` has it.

    Parameters
    ----------
    position, sigma
        Centre (pixels from the middle pixel's centre) and width in pixels.
    values
        (2, n) receives the derivatives by position and sigma, and twice by sigma.
    """
    count = values.shape[1]
    mixed_below = bend_below = 0.0
    for k in range(count + 1):
        scaled = (k - 0.5 * count - position) / sigma
        square = scaled * scaled
        density = math.exp(-0.5 * square) * _INVERSE_SQRT_2PI / (sigma * sigma)
        mixed = density * (1.0 - square)
        twice = density * scaled * (2.0 - square)
        if k > 0:
            values[0, k - 1] = mixed - mixed_below
            values[1, k - 1] = twice - bend_below
        mixed_below = mixed
        bend_below = twice


@kernel
def pixel_gradient(
    along_x: NDArray[np.float64],
    along_y: NDArray[np.float64],
    i: int,
    j: int,
    photons: float,
    gradient: NDArray[np.float64],
) -> float:
    """Give the spot's light in one pixel per photon, and fill the model's gradient there.

    Parameters
    ----------
    along_x, along_y
        (3, n) profiles of both axes.
    i, j
        Row and column in the window.
    photons
        Photons of the spot.
    gradient
        (5,) receives the derivatives by x, y, photons, background and sigma.
    """
    gx = along_x[0, j]
    gy = along_y[0, i]
    gradient[0] = photons * along_x[1, j] * gy
    gradient[1] = photons * gx * along_y[1, i]
    gradient[2] = gx * gy
    gradient[3] = 1.0
    gradient[4] = photons * (along_x[2, j] * gy + gx * along_y[2, i])
    return float(gx * gy)
