"""How many emitters one window holds, decided by fits with ever more of them.

A true pair and a spot that merely is no Gaussian both fail the goodness of fit. They differ in what
a second emitter achieves: it must gain more than noise allows, by a multiple that grows with the
misfit that stays, and must itself be significant, apart from the first and of some weight. A tip
that was blurred along its path fails on the last three.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.emitters import WIDTH, deviance, fit_emitters, model
from rotortrack.localise.misfit import misfit_score, pixel_moments, scan

SUSPICIOUS_MISFIT: Final = 1.28
"""Standard deviations of the deviance above its expectation; one good spot in ten exceeds it."""

SMALLEST_SCORE: Final = 10.0
"""Score of the scan from which one more emitter is tried."""

SMALLEST_GAIN: Final = 20.0
"""Deviance that an emitter must gain, times the misfit that stays over its expectation.

Three parameters of which two have no place without the third: this is not chi-square; simulated
single spots exceed it less than once in a thousand (tests/unit/localise/test_joint.py).
"""

SMALLEST_SIGNIFICANCE: Final = 3.0
"""Photons, and distances between emitters, over their own standard deviations."""

SMALLEST_SHARE: Final = 0.2
"""Photons over those of the window's brightest emitter."""

SMALLEST_SEPARATION: Final = 0.8
"""Distance between emitters over their width; a blurred path of 90 degrees at 100 nm is shorter."""

LARGEST_POSITION_SD_PX: Final = 0.6

SIGMA_RANGE: Final = (0.55, 1.6)
"""Bounds of a free width over the width of the options; a fit that ends there is refused."""

_LOOK, _PRUNE, _ADD = range(3)


@kernel
def disentangle(
    data: NDArray[np.float64],
    variance: NDArray[np.float64],
    n: int,
    starts: NDArray[np.float64],
    background: float,
    sigma: float,
    known: int,
    most: int,
    reach: int,
    sigma_px: float,
    free_sigma: bool,
    moments: NDArray[np.float64],
    parameters: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> int:
    """Find how many emitters a window holds, and fit them.

    Parameters
    ----------
    data, variance
        (p,) photons and read variance (electrons^2), infinite where a pixel does not count.
    n
        Pixels along a side of the window; p = padded(n).
    starts
        (known, 3) x, y, photons of the window's candidate and of its neighbours. Neighbours that
        turn out insignificant or at the place of another emitter leave the fit.
    background, sigma
        Start of both.
    known
        How many starts. With 1, the window is scanned before anything is fitted.
    most
        Largest number of emitters.
    reach
        New emitters are looked for within this distance (pixels) of the middle.
    sigma_px, free_sigma
        Width of the options, and whether it is fitted.
    moments
        Of `misfit.deviance_moments`.
    parameters, covariance
        (WIDTH,) and (WIDTH, WIDTH) receive the fit; unless 2 or more are found, neither is of use.

    Returns
    -------
    int
        The number of emitters; 1 also when no fit settled.
    """
    expected = np.zeros(data.shape[0])
    slopes = np.zeros((WIDTH, data.shape[0]))
    gradient = np.empty(WIDTH)
    curvature = np.empty((WIDTH, WIDTH))
    lower = np.empty(WIDTH)
    upper = np.empty(WIDTH)
    trial = np.zeros(WIDTH)
    best = np.zeros(WIDTH)
    best_cost = np.inf
    trial_covariance = np.empty((WIDTH, WIDTH))
    best_covariance = np.empty((WIDTH, WIDTH))
    found = np.zeros(3)
    count = known
    for a in range(3 * known):
        trial[a] = starts[a // 3, a % 3]
    trial[3 * known] = background
    trial[3 * known + 1] = sigma if free_sigma else sigma_px
    for a in range(WIDTH):
        parameters[a] = trial[a]
    fixed = 0 if free_sigma else 1
    stage = _LOOK if known == 1 else _PRUNE
    cost = np.inf
    expectation = 1.0
    turn = 0
    # One call each of the fit and of the scan: every further one is inlined and compiled again.
    while True:
        if stage != _LOOK:
            tried = count + 1 if stage == _ADD else count
            _bounds(tried, 0.5 * n + 1.0, sigma_px, lower, upper)
            end, trial_cost = fit_emitters(
                data,
                variance,
                n,
                tried,
                3 * tried + 2 - fixed,
                lower,
                upper,
                trial,
                trial_covariance,
            )
            if stage == _PRUNE:
                weakest = _weakest_neighbour(trial, trial_covariance, count, end)
                if weakest > 0:
                    for a in range(3 * weakest, WIDTH - 3):
                        trial[a] = trial[a + 3]
                    for a in range(3):
                        trial[a] = starts[0, a]
                    count -= 1
                    continue
                if end != 0:
                    return 1
                _keep(trial, trial_covariance, parameters, covariance)
            else:
                if end == 0 and trial_cost < best_cost:
                    best_cost = trial_cost
                    _keep(trial, trial_covariance, best, best_covariance)
                turn += 1
                if turn < 2 and _propose(turn, count, parameters, found, trial):
                    continue
                excess = max(best_cost / expectation, 1.0)
                if not cost - best_cost >= SMALLEST_GAIN * excess:
                    return count
                if not _sound(best, best_covariance, count + 1, excess, 0.5 * n):
                    return count
                if not _within(best[3 * count + 4], sigma_px, free_sigma):
                    return count
                count += 1
                _keep(best, best_covariance, parameters, covariance)
        if count == most:
            return count
        size = 3 * count + 2
        model(parameters, count, n, variance, expected, slopes)
        cost = deviance(data, variance, expected, slopes, size, gradient, curvature)
        score = scan(
            data,
            variance,
            expected,
            slopes,
            gradient,
            curvature,
            n,
            size - fixed,
            parameters[size - 1],
            reach,
            found,
        )
        if score < SMALLEST_SCORE:
            return count
        expectation, spread = _expected_deviance(expected, variance, size - fixed, moments)
        if known > 1 and misfit_score(cost, expectation, spread) < SUSPICIOUS_MISFIT:
            return count
        if stage == _LOOK:
            stage = _PRUNE
            continue
        stage = _ADD
        best_cost = np.inf
        turn = 0
        if not _propose(turn, count, parameters, found, trial):
            turn = 1
            _propose(turn, count, parameters, found, trial)


@kernel
def _keep(
    parameters: NDArray[np.float64],
    covariance: NDArray[np.float64],
    kept_parameters: NDArray[np.float64],
    kept_covariance: NDArray[np.float64],
) -> None:
    for a in range(WIDTH):
        kept_parameters[a] = parameters[a]
        for b in range(WIDTH):
            kept_covariance[a, b] = covariance[a, b]


@kernel
def _bounds(
    emitters: int,
    reach: float,
    sigma_px: float,
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
) -> None:
    for a in range(3 * emitters):
        is_position = a % 3 < 2
        lower[a] = -reach if is_position else 1e-3
        upper[a] = reach if is_position else np.inf
    lower[3 * emitters] = 0.0
    upper[3 * emitters] = np.inf
    lower[3 * emitters + 1] = SIGMA_RANGE[0] * sigma_px
    upper[3 * emitters + 1] = SIGMA_RANGE[1] * sigma_px


@kernel
def _expected_deviance(
    expected: NDArray[np.float64],
    variance: NDArray[np.float64],
    fitted: int,
    moments: NDArray[np.float64],
) -> tuple[float, float]:
    """Mean and variance of the deviance of a window whose model holds."""
    mean = 0.0
    spread = 0.0
    pixels = 0
    for pixel in range(expected.shape[0]):
        if variance[pixel] < np.inf:
            moment = pixel_moments(expected[pixel], variance[pixel], moments)
            mean += moment[0]
            spread += moment[1]
            pixels += 1
    left = max(pixels - fitted, 1) / max(pixels, 1)
    return mean * left, spread * left


@kernel
def _weakest_neighbour(
    parameters: NDArray[np.float64], covariance: NDArray[np.float64], count: int, end: int
) -> int:
    """Find the neighbour that must leave a fit; 0 when all may stay.

    A noisy top of one spot can be two candidates, so a neighbour within a spot's reach must be as
    significant as an emitter that nobody saw.
    """
    weakest = 0
    least = np.inf
    sigma = parameters[3 * count + 1]
    for e in range(1, count):
        a = 3 * e + 2
        significance = 0.0
        if end == 0:
            significance = parameters[a] / math.sqrt(covariance[a, a])
            for f in range(count):
                if f == e:
                    continue
                distance, spread = _distance(parameters, covariance, e, f)
                if distance < SMALLEST_SEPARATION * sigma:
                    significance = 0.0
                elif distance < 2.0 * sigma:
                    significance *= SMALLEST_SIGNIFICANCE / math.sqrt(SMALLEST_GAIN)
                if distance < SMALLEST_SIGNIFICANCE * spread:
                    significance = 0.0
        # Of those at 0 the last, which is the farthest, goes first.
        if significance < SMALLEST_SIGNIFICANCE and significance <= least:
            weakest = e
            least = significance
    return weakest


@kernel
def _distance(
    parameters: NDArray[np.float64], covariance: NDArray[np.float64], e: int, f: int
) -> tuple[float, float]:
    """Give the distance between two emitters and its standard deviation (pixels)."""
    x = 3 * e
    y = x + 1
    u = 3 * f
    v = u + 1
    dx = parameters[x] - parameters[u]
    dy = parameters[y] - parameters[v]
    square = dx * dx + dy * dy
    if square == 0.0:
        return 0.0, np.inf
    xx = covariance[x, x] + covariance[u, u] - 2.0 * covariance[x, u]
    yy = covariance[y, y] + covariance[v, v] - 2.0 * covariance[y, v]
    xy = covariance[x, y] + covariance[u, v] - covariance[x, v] - covariance[u, y]
    # By the gradient of the distance, (dx, dy) / distance.
    variance = (dx * dx * xx + dy * dy * yy + 2.0 * dx * dy * xy) / square
    return math.sqrt(square), math.sqrt(max(variance, 0.0))


@kernel
def _propose(
    turn: int,
    count: int,
    parameters: NDArray[np.float64],
    found: NDArray[np.float64],
    trial: NDArray[np.float64],
) -> bool:
    """Start one more emitter: on its own (turn 0), or by splitting the nearest one (turn 1).

    Returns
    -------
    bool
        False when the other start is the only sensible one.
    """
    sigma = parameters[3 * count + 1]
    nearest = 0
    distance = np.inf
    for e in range(count):
        away = math.hypot(found[0] - parameters[3 * e], found[1] - parameters[3 * e + 1])
        if away < distance:
            distance = away
            nearest = 3 * e
    new = 3 * count
    for a in range(new):
        trial[a] = parameters[a]
    trial[new + 3] = parameters[new]
    trial[new + 4] = parameters[new + 1]
    photons = parameters[nearest + 2]
    if turn == 0:
        trial[new] = found[0]
        trial[new + 1] = found[1]
        trial[new + 2] = min(max(found[2], 0.05 * photons), photons)
        return bool(distance >= 1.2 * sigma)
    half = 0.8 * sigma / max(distance, 1e-3)
    dx = (found[0] - parameters[nearest]) * half
    dy = (found[1] - parameters[nearest + 1]) * half
    trial[nearest] -= dx
    trial[nearest + 1] -= dy
    trial[nearest + 2] = 0.5 * photons
    trial[new] = parameters[nearest] + dx
    trial[new + 1] = parameters[nearest + 1] + dy
    trial[new + 2] = 0.5 * photons
    return bool(distance <= 2.6 * sigma)


@kernel
def _within(sigma: float, sigma_px: float, free_sigma: bool) -> bool:
    lowest = 1.001 * SIGMA_RANGE[0] * sigma_px
    highest = 0.999 * SIGMA_RANGE[1] * sigma_px
    return not free_sigma or (lowest < sigma < highest)


@kernel
def _sound(
    parameters: NDArray[np.float64],
    covariance: NDArray[np.float64],
    count: int,
    excess: float,
    reach: float,
) -> bool:
    """Whether every emitter is significant, inside the window, apart and of some weight."""
    apart = SMALLEST_SEPARATION * parameters[3 * count + 1]
    brightest = 0.0
    for e in range(count):
        brightest = max(brightest, parameters[3 * e + 2])
    limit = SMALLEST_SIGNIFICANCE**2 * excess
    for e in range(count):
        x = 3 * e
        y = x + 1
        photons = parameters[y + 1]
        if photons < SMALLEST_SHARE * brightest:
            return False
        if photons * photons < limit * covariance[y + 1, y + 1]:
            return False
        if max(covariance[x, x], covariance[y, y]) * excess > LARGEST_POSITION_SD_PX**2:
            return False
        if max(abs(parameters[x]), abs(parameters[y])) > reach:
            return False
        for f in range(e):
            distance, spread = _distance(parameters, covariance, e, f)
            if distance < apart or distance < spread * math.sqrt(limit):
                return False
    return True
