"""Levenberg-Marquardt in float64 for one fit window, to the true optimum within bounds.

Parameters that rest on a bound and are pushed against it leave the system of the step; they come
back as soon as the gradient points inwards. Marquardt's damping is scaled by the curvature's
diagonal, so that photons and pixels need no common scale.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.flags import FitFlag
from rotortrack.kernels import kernel
from rotortrack.localise.gaussian import BACKGROUND, PARAMETERS, PHOTONS, SIGMA, X, Y
from rotortrack.localise.least_squares import squares
from rotortrack.localise.likelihood import deviance
from rotortrack.localise.linear import cholesky, solve_factored

LEAST_SQUARES = 0
LIKELIHOOD = 1

MAX_ITERATIONS = 200
STEP_TOLERANCE = 1e-7
"""A fit has settled when a step changes every parameter by less than this part of its scale."""

MAX_DAMPING = 1e12
SMALLEST_PHOTONS = 1e-3
"""A spot fainter than this is no spot."""

SIGMA_BOUNDS_PX = (0.1, 50.0)

_ITERATION_LIMIT = int(FitFlag.ITERATION_LIMIT)
_SINGULAR = int(FitFlag.SINGULAR)
_NOT_FINITE = int(FitFlag.NOT_FINITE)
_AT_BOUND = int(FitFlag.AT_BOUND)


@kernel
def _objective(
    kind: int,
    data: NDArray[np.float64],
    weights: NDArray[np.float64],
    keep: NDArray[np.float64],
    parameters: NDArray[np.float64],
    along_x: NDArray[np.float64],
    along_y: NDArray[np.float64],
    gradient: NDArray[np.float64],
    curvature: NDArray[np.float64],
) -> float:
    if kind == LIKELIHOOD:
        return deviance(data, weights, keep, parameters, along_x, along_y, gradient, curvature)
    return squares(data, weights, parameters, along_x, along_y, gradient, curvature)


@kernel
def _bounds(
    reach: float,
    fixed_sigma: float,
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
) -> None:
    lower[X] = lower[Y] = -reach
    upper[X] = upper[Y] = reach
    lower[PHOTONS] = lower[BACKGROUND] = 0.0
    upper[PHOTONS] = upper[BACKGROUND] = np.inf
    lower[SIGMA] = SIGMA_BOUNDS_PX[0]
    upper[SIGMA] = SIGMA_BOUNDS_PX[1]
    if fixed_sigma > 0.0:
        lower[SIGMA] = upper[SIGMA] = fixed_sigma


@kernel
def optimise(
    kind: int,
    data: NDArray[np.float64],
    weights: NDArray[np.float64],
    keep: NDArray[np.float64],
    parameters: NDArray[np.float64],
    free_sigma: bool,
) -> int:
    """Fit one window.

    Parameters
    ----------
    kind
        ``LEAST_SQUARES`` or ``LIKELIHOOD``.
    data
        (n, n) photons.
    weights
        (n, n) weights of the squares; for the likelihood, read variance in electrons^2.
    keep
        (n, n) 1 for pixels that count, else 0.
    parameters
        (5,) start, overwritten by the optimum: x, y (pixels from the window's middle), photons,
        background, sigma (pixels).
    free_sigma
        False keeps sigma where it starts.

    Returns
    -------
    int
        Bits of FitFlag: how the fit ended and whether it rests on a bound.
    """
    n = data.shape[0]
    along_x = np.empty((3, n))
    along_y = np.empty((3, n))
    gradient = np.empty(PARAMETERS)
    curvature = np.empty((PARAMETERS, PARAMETERS))
    trial_gradient = np.empty(PARAMETERS)
    trial_curvature = np.empty((PARAMETERS, PARAMETERS))
    trial = np.empty(PARAMETERS)
    lower = np.empty(PARAMETERS)
    upper = np.empty(PARAMETERS)
    step = np.empty(PARAMETERS)
    # One pixel of room beyond the window lets a fit pass through before it is judged.
    _bounds(0.5 * n + 0.5, 0.0 if free_sigma else parameters[SIGMA], lower, upper)

    for a in range(PARAMETERS):
        trial[a] = parameters[a]
    cost = np.inf
    predicted = 0.0
    settled = False
    damping = 1e-3
    growth = 2.0
    end = _ITERATION_LIMIT
    # The start is the first trial: one call of the objective, so that it is compiled once.
    for _ in range(MAX_ITERATIONS):
        trial_cost = _objective(
            kind, data, weights, keep, trial, along_x, along_y, trial_gradient, trial_curvature
        )
        if trial_cost <= cost:
            if cost < np.inf:
                # Nielsen's rule: the better the model foretold the gain, the less damping.
                gain = (cost - trial_cost) / predicted if predicted > 0.0 else 0.5
                damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 1e-9)
            growth = 2.0
            cost = trial_cost
            for a in range(PARAMETERS):
                parameters[a] = trial[a]
                gradient[a] = trial_gradient[a]
                for b in range(a + 1):
                    curvature[a, b] = trial_curvature[a, b]
        elif not np.isfinite(cost):
            return _NOT_FINITE
        else:
            damping *= growth
            growth *= 2.0
        # A rejected step this small means that the cost cannot fall further within rounding.
        if settled or damping > MAX_DAMPING:
            end = 0
            break
        if parameters[PHOTONS] < SMALLEST_PHOTONS:
            end = _SINGULAR
            break
        while not _step(gradient, curvature, damping, parameters, lower, upper, step):
            damping *= 10.0
            if damping > MAX_DAMPING:
                return _SINGULAR
        settled = True
        predicted = 0.0
        for a in range(PARAMETERS):
            trial[a] = min(max(parameters[a] + step[a], lower[a]), upper[a])
            if a in (PHOTONS, SIGMA):
                # One rash step to no light, or to no width, would leave nothing to come back by.
                trial[a] = min(max(trial[a], 0.2 * parameters[a]), 5.0 * parameters[a])
            moved = trial[a] - parameters[a]
            predicted += moved * (gradient[a] + damping * curvature[a, a] * moved)
            scale = 1.0 if a in (X, Y) else max(abs(parameters[a]), 1e-3)
            if abs(moved) > STEP_TOLERANCE * scale:
                settled = False
    if parameters[BACKGROUND] == 0.0:
        end |= _AT_BOUND
    return end


@kernel
def _step(
    gradient: NDArray[np.float64],
    curvature: NDArray[np.float64],
    damping: float,
    parameters: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    step: NDArray[np.float64],
) -> bool:
    """Solve for the damped step of the free parameters; False when the system is singular."""
    free = np.empty(PARAMETERS, np.int64)
    count = 0
    for a in range(PARAMETERS):
        step[a] = 0.0
        pushed_down = parameters[a] <= lower[a] and gradient[a] <= 0.0
        pushed_up = parameters[a] >= upper[a] and gradient[a] >= 0.0
        if not pushed_down and not pushed_up:
            free[count] = a
            count += 1
    system = np.empty((PARAMETERS, PARAMETERS))
    right = np.empty(PARAMETERS)
    scale = np.empty(PARAMETERS)
    for a in range(count):
        diagonal = curvature[free[a], free[a]]
        if not diagonal > 0.0:
            return False
        scale[a] = 1.0 / np.sqrt(diagonal)
    for a in range(count):
        right[a] = gradient[free[a]] * scale[a]
        for b in range(a):
            system[a, b] = curvature[free[a], free[b]] * scale[a] * scale[b]
        system[a, a] = 1.0 + damping
    if not cholesky(system, count):
        return False
    solve_factored(system, right, count)
    for a in range(count):
        step[free[a]] = right[a] * scale[a]
    return True
