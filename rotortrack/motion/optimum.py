"""Maximum of a smooth likelihood of a few parameters, its curvature and its profiles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

Floats = NDArray[np.float64]
Objective = Callable[[Floats], float]

_ROUNDS = 12
_SETTLED = 0.004
_STRIDE_SD = 0.7
_FARTHEST_SD = 6.0
_STRIDES = 40
_PROFILE_STEPS = 6
_PROFILE_PRECISION = 0.01


@dataclass(frozen=True)
class Maximum:
    """Where an objective is greatest.

    Attributes
    ----------
    point, value
        Parameters and objective there.
    covariance
        Inverse of the negative second derivatives.
    """

    point: Floats
    value: float
    covariance: Floats

    @property
    def sd(self) -> Floats:
        """Standard deviations of the parameters."""
        found: Floats = np.sqrt(np.diag(self.covariance))
        return found


def maximise(objective: Objective, start: Floats, sd: Floats, bounds: Floats) -> Maximum:
    """Climb a log-likelihood of few parameters by its quadratic approximation.

    Each round measures gradient and second derivatives at 0.7 standard deviations to either side,
    steps to the maximum that they foretell, and ends when the next would raise the objective by
    less than 0.004, which is a tenth of a standard deviation before that step. Differences so wide
    see the likelihood at the scale of its intervals and not of its rounding.

    Parameters
    ----------
    objective
        Log-likelihood.
    start, sd
        First guess of the parameters and of their standard deviations, shape (p,).
    bounds
        Least and greatest parameters, shape (2, p).

    Notes
    -----
    ``(p + 1)(p + 2) / 2`` evaluations and one or two more a round, typically three rounds.
    """
    point, value = start.copy(), objective(start)
    stride = _STRIDE_SD * sd
    covariance = np.diag(sd**2)
    for _ in range(_ROUNDS):
        gradient, curvature = _derivatives(objective, point, value, stride)
        covariance = _positive_inverse(curvature, stride)
        move = covariance @ gradient
        foretold = 0.5 * float(gradient @ move)
        stride = np.clip(_STRIDE_SD * np.sqrt(np.diag(covariance)), 0.2 * stride, 5.0 * stride)
        farthest = float(np.max(np.abs(move) / (_FARTHEST_SD * stride)))
        move /= max(1.0, farthest)
        gained = False
        for shorter in (1.0, 0.4, 0.1, 0.02):
            trial = np.clip(point + shorter * move, *bounds)
            there = objective(trial)
            if there > value:
                point, value, gained = trial, there, True
                break
        if foretold < _SETTLED or not gained:
            break
    return Maximum(point, value, covariance)


def curvature_inverse(objective: Objective, point: Floats, sd: Floats) -> Floats:
    """Inverse of the negative second derivatives at a maximum, measured at the scale of `sd`."""
    _, curvature = _derivatives(objective, point, objective(point), _STRIDE_SD * sd)
    return _positive_inverse(curvature, _STRIDE_SD * sd)


def _derivatives(
    objective: Objective, point: Floats, value: float, stride: Floats
) -> tuple[Floats, Floats]:
    """Gradient and negative second derivatives by differences."""
    p = point.size
    unit = np.diag(stride)
    up = np.array([objective(point + unit[i]) for i in range(p)])
    down = np.array([objective(point - unit[i]) for i in range(p)])
    gradient = (up - down) / (2.0 * stride)
    second = np.diag((2.0 * value - up - down) / stride**2)
    for i, j in itertools.combinations(range(p), 2):
        both = objective(point + unit[i] + unit[j])
        mixed = -(both - up[i] - up[j] + value) / (stride[i] * stride[j])
        second[i, j] = second[j, i] = mixed
    return gradient, second


def _positive_inverse(curvature: Floats, stride: Floats) -> Floats:
    """Inverse of a curvature, made positive where a parameter is not determined."""
    scaled = curvature * np.outer(stride, stride)
    values, vectors = np.linalg.eigh(scaled)
    # A direction in which the likelihood is flat or hollow gets a long but finite reach.
    values = np.maximum(np.abs(values), 1e-2)
    inverse: Floats = (vectors / values) @ vectors.T * np.outer(stride, stride)
    return inverse


def profile_end(
    objective: Objective, maximum: Maximum, index: int, rise: float, side: float
) -> float:
    """Value of one parameter where twice the profile has fallen by `rise`, below or above.

    The other parameters follow it as the quadratic approximation tells. Their deviation from
    where the profile has them is of second order and its effect on the profile of fourth.
    """
    slope = maximum.covariance[:, index] / maximum.covariance[index, index]
    reach = side * math.sqrt(rise) * float(maximum.sd[index])
    for _ in range(_PROFILE_STEPS):
        fall = 2.0 * (maximum.value - objective(maximum.point + slope * reach))
        # Along a parabola the root of the fall is proportional to the distance.
        ratio = math.sqrt(rise / max(fall, 0.1 * rise))
        reach *= min(ratio, 2.5)
        if abs(ratio - 1.0) < _PROFILE_PRECISION:
            break
    return float(maximum.point[index]) + reach


def crossing(function: Callable[[float], float], start: float, stride: float) -> float:
    """Find where a function that is negative at the start crosses zero, on one side of it."""
    inside, outside = start, start + stride
    for _ in range(_STRIDES):
        if function(outside) > 0.0:
            return float(optimize.brentq(function, inside, outside, xtol=1e-3 * abs(stride)))
        inside, outside = outside, outside + 1.6 * (outside - inside)
    return outside
