"""Several emitters of one width on one flat background, fitted together in float64.

    mu_ij = b + sum_e N_e g(x_e; j, s) g(y_e; i, s)

The parameters are ordered x, y, photons of every emitter, then b and s, so that a fixed width is
the same model without its last parameter. Poisson noise, read noise and masked pixels are those of
`likelihood` and of `windows`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.flags import FitFlag
from rotortrack.kernels import kernel
from rotortrack.localise.gaussian import profile
from rotortrack.localise.likelihood import SMALLEST_EXPECTATION
from rotortrack.localise.linear import cholesky, invert, solve_factored

MOST_EMITTERS: Final = 3

WIDTH: Final = 3 * MOST_EMITTERS + 2
"""Places for the parameters of the largest model."""

PARTS: Final = 8
"""Sums over pixels run in this many parts, which become one vector."""

MAX_ITERATIONS = 60
STEP_TOLERANCE = 1e-4
"""A fit has settled when a step changes every parameter by less than this part of its scale.

That last step is still taken, and is the last but one by far in size.
"""

MAX_DAMPING = 1e9
LARGEST_STEP_PX = 1.0

_ITERATION_LIMIT = int(FitFlag.ITERATION_LIMIT)
_SINGULAR = int(FitFlag.SINGULAR)
_NOT_FINITE = int(FitFlag.NOT_FINITE)


@kernel
def padded(n: int) -> int:
    """Give the length of a window of n x n pixels, filled up to a multiple of PARTS."""
    return (n * n + PARTS - 1) // PARTS * PARTS


@kernel
def model(
    parameters: NDArray[np.float64],
    emitters: int,
    n: int,
    variance: NDArray[np.float64],
    expected: NDArray[np.float64],
    slopes: NDArray[np.float64],
) -> None:
    """Fill the expectation of every pixel, read variance included, and its gradient.

    Parameters
    ----------
    parameters
        (WIDTH,) of each emitter its position (pixels from the middle pixel's centre) and photons,
        then background per pixel and width in pixels.
    emitters
        How many.
    n
        Pixels along a side of the window.
    variance
        (p,) read variance (electrons^2), row by row, p = padded(n); infinite where a pixel does
        not count, as in the padding.
    expected, slopes
        (p,) and (WIDTH, p) receive the results; the padding is left alone.
    """
    along_x = np.empty((3, n))
    along_y = np.empty((3, n))
    background = 3 * emitters
    sigma = parameters[background + 1]
    for pixel in range(n * n):
        expected[pixel] = parameters[background] + variance[pixel]
        slopes[background, pixel] = 1.0
        slopes[background + 1, pixel] = 0.0
    for e in range(emitters):
        profile(parameters[3 * e], sigma, along_x)
        profile(parameters[3 * e + 1], sigma, along_y)
        photons = parameters[3 * e + 2]
        for i in range(n):
            value = along_y[0, i]
            by_y = photons * along_y[1, i]
            by_sigma = photons * along_y[2, i]
            scaled = photons * value
            for j in range(n):
                pixel = i * n + j
                light = along_x[0, j]
                expected[pixel] += scaled * light
                slopes[3 * e, pixel] = scaled * along_x[1, j]
                slopes[3 * e + 1, pixel] = by_y * light
                slopes[3 * e + 2, pixel] = value * light
                slopes[background + 1, pixel] += scaled * along_x[2, j] + by_sigma * light


@kernel
def deviance(
    data: NDArray[np.float64],
    variance: NDArray[np.float64],
    expected: NDArray[np.float64],
    slopes: NDArray[np.float64],
    size: int,
    gradient: NDArray[np.float64],
    curvature: NDArray[np.float64],
) -> float:
    """Compute the deviance of a model with its gradient and Fisher information.

    Parameters
    ----------
    data, variance
        (p,) photons and read variance (electrons^2), infinite where a pixel does not count.
    expected, slopes
        Of :func:`model`, zero in the padding.
    size
        How many parameters the model has.
    gradient, curvature
        (WIDTH,) the gradient of the log-likelihood, (WIDTH, WIDTH) its Fisher information (lower
        triangle).

    Returns
    -------
    float
        The deviance.
    """
    length = data.shape[0]
    pulls = np.zeros(length)
    weights = np.zeros(length)
    weighted = np.empty(length)
    total = 0.0
    for pixel in range(length):
        if variance[pixel] < np.inf:
            mean = max(expected[pixel], SMALLEST_EXPECTATION)
            observed = max(data[pixel] + variance[pixel], 0.0)
            total += mean - observed
            if observed > 0.0:
                total += observed * math.log(observed / mean)
            weights[pixel] = 1.0 / mean
            pulls[pixel] = observed / mean - 1.0
    for a in range(size):
        slope = slopes[a]
        gradient[a] = _dot(pulls, slope)
        for pixel in range(length):
            weighted[pixel] = weights[pixel] * slope[pixel]
        for b in range(a + 1):
            curvature[a, b] = _dot(weighted, slopes[b])
    return 2.0 * total


@kernel
def _dot(left: NDArray[np.float64], right: NDArray[np.float64]) -> float:
    parts = np.zeros(PARTS)
    for start in range(0, left.shape[0], PARTS):
        for part in range(PARTS):
            parts[part] += left[start + part] * right[start + part]
    total = 0.0
    for part in range(PARTS):
        total += parts[part]
    return total


@kernel
def fit_emitters(
    data: NDArray[np.float64],
    variance: NDArray[np.float64],
    n: int,
    emitters: int,
    free: int,
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    parameters: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> tuple[int, float]:
    """Fit a window by Levenberg-Marquardt within bounds.

    Parameters
    ----------
    data, variance
        (p,) photons and read variance (electrons^2), infinite where a pixel does not count.
    n
        Pixels along a side of the window.
    emitters
        How many.
    free
        3 * emitters + 2, or one less to hold the width.
    lower, upper
        (WIDTH,) bounds.
    parameters
        (WIDTH,) start, overwritten by the optimum.
    covariance
        (WIDTH, WIDTH) receives the Cramer-Rao bound at the optimum.

    Returns
    -------
    int
        0 when settled, else the bit of FitFlag that tells why not; `covariance` is then not filled.
    float
        The deviance.
    """
    size = 3 * emitters + 2
    expected = np.zeros(data.shape[0])
    slopes = np.zeros((WIDTH, data.shape[0]))
    gradient = np.empty(WIDTH)
    curvature = np.empty((WIDTH, WIDTH))
    trial_gradient = np.empty(WIDTH)
    trial_curvature = np.empty((WIDTH, WIDTH))
    trial = parameters.copy()
    step = np.zeros(WIDTH)
    cost = np.inf
    predicted = 0.0
    settled = False
    damping = 1e-3
    growth = 2.0
    end = _ITERATION_LIMIT
    for _ in range(MAX_ITERATIONS):
        model(trial, emitters, n, variance, expected, slopes)
        trial_cost = deviance(
            data, variance, expected, slopes, size, trial_gradient, trial_curvature
        )
        if trial_cost <= cost:
            if cost < np.inf:
                # Nielsen's rule: the better the model foretold the gain, the less damping.
                gain = (cost - trial_cost) / predicted if predicted > 0.0 else 0.5
                damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 1e-9)
            growth = 2.0
            cost = trial_cost
            for a in range(WIDTH):
                parameters[a] = trial[a]
                gradient[a] = trial_gradient[a]
                for b in range(a + 1):
                    curvature[a, b] = trial_curvature[a, b]
        elif not np.isfinite(cost):
            return _NOT_FINITE, cost
        else:
            damping *= growth
            growth *= 2.0
        # A rejected step this small means that the cost cannot fall further within rounding.
        if settled or damping > MAX_DAMPING:
            end = 0
            break
        while not _step(gradient, curvature, damping, free, parameters, lower, upper, step):
            damping *= 10.0
            if damping > MAX_DAMPING:
                return _SINGULAR, cost
        settled = True
        predicted = 0.0
        for a in range(free):
            is_position = a < 3 * emitters and a % 3 < 2
            move = step[a]
            if is_position:
                # Gaussians foretell little beyond their width.
                move = min(max(move, -LARGEST_STEP_PX), LARGEST_STEP_PX)
            trial[a] = min(max(parameters[a] + move, lower[a]), upper[a])
            if a < 3 * emitters and not is_position:
                # One rash step to no light would leave nothing to come back by.
                trial[a] = min(max(trial[a], 0.2 * parameters[a]), 5.0 * parameters[a])
            moved = trial[a] - parameters[a]
            predicted += moved * (gradient[a] + damping * curvature[a, a] * moved)
            scale = 1.0 if is_position else max(abs(parameters[a]), 1e-3)
            if abs(moved) > STEP_TOLERANCE * scale:
                settled = False
    if end == 0:
        # Slices of arrays take numba seconds to compile; loops do not.
        information = np.empty((free, free))
        for a in range(free):
            for b in range(a + 1):
                information[a, b] = curvature[a, b]
        if not invert(information, covariance):
            end = _SINGULAR
    return end, cost


@kernel
def _step(
    gradient: NDArray[np.float64],
    curvature: NDArray[np.float64],
    damping: float,
    free: int,
    parameters: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    step: NDArray[np.float64],
) -> bool:
    """Solve for the damped step; what rests on a bound and is pushed against it stays there."""
    moving = np.empty(free, np.int64)
    count = 0
    for a in range(free):
        step[a] = 0.0
        pushed_down = parameters[a] <= lower[a] and gradient[a] <= 0.0
        pushed_up = parameters[a] >= upper[a] and gradient[a] >= 0.0
        if not pushed_down and not pushed_up:
            moving[count] = a
            count += 1
    system = np.empty((WIDTH, WIDTH))
    right = np.empty(WIDTH)
    scale = np.empty(WIDTH)
    for a in range(count):
        diagonal = curvature[moving[a], moving[a]]
        if not diagonal > 0.0:
            return False
        scale[a] = 1.0 / math.sqrt(diagonal)
    for a in range(count):
        right[a] = gradient[moving[a]] * scale[a]
        for b in range(a):
            system[a, b] = curvature[moving[a], moving[b]] * scale[a] * scale[b]
        system[a, a] = 1.0 + damping
    if not cholesky(system, count):
        return False
    solve_factored(system, right, count)
    for a in range(count):
        step[moving[a]] = right[a] * scale[a]
    return True
