"""Circle fits that solve for the circle at once, and the geometric fit that starts from one.

All take centred and scaled coordinates (mean 0, rms distance 1), in which they are invariant to
rotation and well conditioned.
"""

from __future__ import annotations

import math
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

Method = Literal["hyper", "kasa", "pratt", "taubin", "geometric"]
Values = NDArray[np.float64]
Circle = tuple[float, float, float]
"""Centre x, centre y and radius; the radius is infinite for a line."""


def algebraic_circle(x: Values, y: Values, weights: Values, method: Method) -> Circle:
    """Minimise the mean of (A z + B x + C y + D)^2, z = x^2 + y^2, under a method's constraint.

    With the constraint matrix N, the coefficients solve Z'Z a = eta N a for the smallest eta >= 0.
    Relative radius bias for noise s on a full circle: Kasa and Taubin +s^2/R^2, Pratt +2 s^2/R^2,
    Hyper (N = 2 N_Taubin - N_Pratt) zero to that order.

    Parameters
    ----------
    x, y, weights
        Centred, scaled coordinates and non-negative weights, shape (n,), n >= 3, not collinear.
    method
        "geometric" is treated as Taubin.

    Notes
    -----
    O(n). Solved from the singular values of the data matrix instead of its moments, so that exact
    circles and short arcs keep their digits. Source: A. Al-Sharadqah & N. Chernov, Electron. J.
    Statist. 3 (2009) 886; N. Chernov, Circular and Linear Regression (2010), ch. 5.
    """
    z = x * x + y * y
    if method == "kasa":
        root = np.sqrt(weights)
        design = np.column_stack((x, y, np.ones_like(x))) * root[:, None]
        b, c, d = np.linalg.lstsq(design, -z * root, rcond=None)[0]
        return _from_coefficients(1.0, b, c, d)
    total = weights.sum()
    data = np.column_stack((z, x, y, np.ones_like(x))) * np.sqrt(weights / total)[:, None]
    # numpy's types know no mode that returns the triangle alone.
    upper = cast(Values, np.linalg.qr(data, mode="r"))
    _, singular, right = np.linalg.svd(upper)
    if upper.shape[0] < 4 or singular[3] < 1e-12 * singular[0]:
        return _from_coefficients(*right[3])
    symmetric = right.T @ (singular[:, None] * right)
    constraint = _constraint(method, *((weights @ v) / total for v in (z, x, y)))
    eta, vectors = np.linalg.eigh(_inverse_sandwich(symmetric, constraint))
    # eigh gives 1 / eta of the problem above: its largest value is the smallest positive eta.
    return _from_coefficients(*np.linalg.solve(symmetric, vectors[:, int(np.argmax(eta))]))


def geometric_circle(x: Values, y: Values, weights: Values, start: Circle) -> Circle:
    """Minimise the summed squares of the distances to the circle by Levenberg-Marquardt.

    Radius bias +s^2 / 2 R^2 on a full circle. Returns the best circle reached in 100 iterations;
    each costs O(n).
    """
    circle = np.array(start)
    damping = 1e-3
    residual, slopes = _residuals(circle, x, y)
    cost = weights @ residual**2
    for _ in range(100):
        normal = slopes.T @ (weights[:, None] * slopes)
        gradient = slopes.T @ (weights * residual)
        try:
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), gradient)
        except np.linalg.LinAlgError:
            # From a centre far away all positions lie in one direction, to the last digit.
            damping *= 10.0
            continue
        trial = circle - step
        trial_residual, trial_slopes = _residuals(trial, x, y)
        trial_cost = weights @ trial_residual**2
        if trial_cost <= cost:
            settled = float(np.abs(step).max()) < 1e-12 * (1.0 + abs(circle[2]))
            circle, residual, slopes, cost = trial, trial_residual, trial_slopes, trial_cost
            damping *= 0.1
            if settled:
                break
        else:
            damping *= 10.0
            if damping > 1e12:
                break
    return float(circle[0]), float(circle[1]), abs(float(circle[2]))


def _residuals(circle: Values, x: Values, y: Values) -> tuple[Values, Values]:
    """Distances outward from the circle and their derivatives by centre and radius."""
    dx, dy = x - circle[0], y - circle[1]
    r = np.hypot(dx, dy)
    safe = np.where(r > 0.0, r, 1.0)
    return r - circle[2], np.column_stack((-dx / safe, -dy / safe, np.full_like(r, -1.0)))


def _constraint(method: Method, z: float, x: float, y: float) -> Values:
    """Constraint matrix N from the weighted means of z, x and y."""
    pratt = np.array([[0, 0, 0, -2], [0, 1, 0, 0], [0, 0, 1, 0], [-2, 0, 0, 0]], dtype=float)
    taubin = np.array([[4 * z, 2 * x, 2 * y, 0], [2 * x, 1, 0, 0], [2 * y, 0, 1, 0], [0, 0, 0, 0]])
    if method == "pratt":
        return pratt
    if method == "hyper":
        hyper: Values = 2.0 * taubin - pratt
        return hyper
    return taubin


def _inverse_sandwich(symmetric: Values, constraint: Values) -> Values:
    """Return Y^-1 N Y^-1, whose eigenvalues are 1 / eta even where N itself is singular."""
    half = np.linalg.solve(symmetric, constraint)
    whole = np.linalg.solve(symmetric, half.T)
    symmetrised: Values = 0.5 * (whole + whole.T)
    return symmetrised


def _from_coefficients(a: float, b: float, c: float, d: float) -> Circle:
    """Centre and radius of a z + b x + c y + d = 0."""
    if a == 0.0:
        return math.nan, math.nan, math.inf
    x, y = -b / (2.0 * a), -c / (2.0 * a)
    return float(x), float(y), math.sqrt(max(0.0, x * x + y * y - d / a))
