"""Where a window holds more light than its model: goodness of fit, and a scan for one more emitter.

The deviance of few photons is not distributed as chi-square. Its mean and variance are summed
exactly here, for Poisson light with Gaussian read noise in the likelihood's own approximation.
"""

from __future__ import annotations

import functools
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.emitters import WIDTH
from rotortrack.localise.gaussian import profile
from rotortrack.localise.likelihood import SMALLEST_EXPECTATION
from rotortrack.localise.linear import cholesky

LOWEST_LOG: Final = math.log(0.01)
HIGHEST_LOG: Final = math.log(100.0)
"""Expectations of the table; below, a pixel says nothing, and above, the end of the table holds."""

_LEVELS = 60
_SHARES = 11
_NOISE_POINTS = 97


@functools.cache
def deviance_moments() -> NDArray[np.float64]:
    """Tabulate the mean and variance of one pixel's deviance at its true expectation.

    For a pixel of light mu and read variance v, with m = mu + v: the table runs evenly over ln m
    from LOWEST_LOG to HIGHEST_LOG and over the share mu / m from 0 to 1.

    Returns
    -------
    ndarray, shape (2, 60, 11)
        Means, and variances.
    """
    # An even grid: the cut at zero counts would spoil the accuracy of Gaussian quadrature.
    nodes = np.linspace(-6.0, 6.0, _NOISE_POINTS)
    weights = np.exp(-0.5 * nodes**2)
    weights /= weights.sum()
    moments = np.empty((2, _LEVELS, _SHARES))
    for row, m in enumerate(np.exp(np.linspace(LOWEST_LOG, HIGHEST_LOG, _LEVELS))):
        for column, share in enumerate(np.linspace(0.0, 1.0, _SHARES)):
            light = share * m
            counts = np.arange(int(light + 12.0 * math.sqrt(light) + 25.0))
            logs = np.cumsum(np.log(np.maximum(counts, 1)))
            chance = np.exp(counts * math.log(light) - light - logs) if light else counts == 0
            noise = math.sqrt(m - light) * nodes
            observed = np.maximum(counts[:, None] + noise + (m - light), 0.0)
            ratio = np.log(np.where(observed > 0.0, observed, 1.0) / m)
            value = 2.0 * (m - observed + observed * ratio)
            joint = chance[:, None] * weights
            mean = np.sum(joint * value)
            moments[0, row, column] = mean
            moments[1, row, column] = np.sum(joint * (value - mean) ** 2)
    return moments


@kernel
def pixel_moments(
    expected: float, variance: float, moments: NDArray[np.float64]
) -> tuple[float, float]:
    """Interpolate the mean and variance of one pixel's deviance.

    Parameters
    ----------
    expected, variance
        Expectation (read variance included) and read variance (electrons^2).
    moments
        Of :func:`deviance_moments`.
    """
    m = max(expected, SMALLEST_EXPECTATION)
    level = (math.log(m) - LOWEST_LOG) * (_LEVELS - 1) / (HIGHEST_LOG - LOWEST_LOG)
    level = min(max(level, 0.0), _LEVELS - 1.000001)
    share = (_SHARES - 1) * min(max(1.0 - variance / m, 0.0), 0.999999)
    row = int(level)
    column = int(share)
    up = level - row
    right = share - column
    below = (1.0 - up) * (1.0 - right)
    beside = (1.0 - up) * right
    above = up * (1.0 - right)
    across = up * right
    return (
        below * moments[0, row, column]
        + beside * moments[0, row, column + 1]
        + above * moments[0, row + 1, column]
        + across * moments[0, row + 1, column + 1],
        below * moments[1, row, column]
        + beside * moments[1, row, column + 1]
        + above * moments[1, row + 1, column]
        + across * moments[1, row + 1, column + 1],
    )


@kernel
def misfit_score(deviance: float, mean: float, variance: float) -> float:
    """Turn a deviance into standard deviations of a normal distribution with the same tail.

    A deviance is taken to be a scaled chi-square of the given mean and variance, whose cube root
    is very nearly normal (Wilson and Hilferty, PNAS 17, 684 (1931)).
    """
    spread = variance / (9.0 * mean * mean)
    root = (max(deviance, 0.0) / mean) ** (1.0 / 3.0)
    return float((root - (1.0 - spread)) / math.sqrt(spread))


@kernel
def scan(
    data: NDArray[np.float64],
    variance: NDArray[np.float64],
    expected: NDArray[np.float64],
    slopes: NDArray[np.float64],
    gradient: NDArray[np.float64],
    curvature: NDArray[np.float64],
    n: int,
    free: int,
    sigma: float,
    reach: int,
    found: NDArray[np.float64],
) -> float:
    """Find the pixel at which one more emitter would help most, without fitting it.

    Rao's score test: at each pixel the residuals' match with a spot, over what is left of the
    spot's information when the fitted parameters have taken theirs. At any one pixel it is
    distributed as chi-square with one degree of freedom. The parameters need not be at their
    optimum; one Newton step towards it is allowed for.

    Parameters
    ----------
    data, variance, expected, slopes, gradient, curvature
        The window and its model, see `emitters`.
    n
        Pixels along a side of the window.
    free
        How many of the parameters are free.
    sigma
        Width of a spot, pixels.
    reach
        Pixels within this distance of the middle are looked at.
    found
        (3,) receives x, y (pixels from the middle) and photons of the emitter.

    Returns
    -------
    float
        The largest score; 0 when the parameters are not determined.
    """
    middle = n // 2
    factor = curvature.copy()
    if not cholesky(factor, free):
        return 0.0
    steps = np.empty(WIDTH)
    for a in range(free):
        total = gradient[a]
        for b in range(a):
            total -= factor[a, b] * steps[b]
        steps[a] = total / factor[a, a]
    # The spot's light at every whole distance that two pixels of the window can have.
    spot = np.empty((3, 2 * n - 1))
    profile(0.0, sigma, spot)
    # Per pixel: the gradient over the expectation, then the pull, then the information of light.
    fields = np.zeros((WIDTH + 2, n * n))
    for pixel in range(n * n):
        if variance[pixel] < np.inf:
            mean = max(expected[pixel], SMALLEST_EXPECTATION)
            weight = 1.0 / mean
            for a in range(free):
                fields[a, pixel] = weight * slopes[a, pixel]
            fields[free, pixel] = max(data[pixel] + variance[pixel], 0.0) * weight - 1.0
            fields[free + 1, pixel] = weight
    along = np.empty((WIDTH + 2, n))
    light_x = np.empty(n)
    light_y = np.empty(n)
    shared = np.empty(WIDTH + 2)
    best = 0.0
    for column in range(middle - reach, middle + reach + 1):
        for j in range(n):
            light_x[j] = spot[0, j - column + n - 1]
        for a in range(free + 2):
            if a == free + 1:
                for j in range(n):
                    light_x[j] *= light_x[j]
            for i in range(n):
                total = 0.0
                for j in range(n):
                    total += light_x[j] * fields[a, i * n + j]
                along[a, i] = total
        for row in range(middle - reach, middle + reach + 1):
            for i in range(n):
                light_y[i] = spot[0, i - row + n - 1]
            for a in range(free + 2):
                if a == free + 1:
                    for i in range(n):
                        light_y[i] *= light_y[i]
                total = 0.0
                for i in range(n):
                    total += light_y[i] * along[a, i]
                shared[a] = total
            pull = shared[free]
            information = shared[free + 1]
            left = information
            for a in range(free):
                total = shared[a]
                for b in range(a):
                    total -= factor[a, b] * shared[b]
                shared[a] = total / factor[a, a]
                left -= shared[a] * shared[a]
                pull -= shared[a] * steps[a]
            # Right on a fitted emitter nothing is left but rounding.
            if pull <= 0.0 or left <= 1e-4 * information:
                continue
            score = pull * pull / left
            if score > best:
                best = score
                found[0] = column - middle
                found[1] = row - middle
                found[2] = pull / left
    return best
