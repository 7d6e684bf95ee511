"""From drift at bin centres to drift at every frame: LOESS, then a natural spline."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

_ROBUSTNESS_PASSES = 2


def loess(x: NDArray[np.float64], y: NDArray[np.float64], points: int) -> NDArray[np.float64]:
    """Smooth y by robust local lines: tricube weights over the nearest points.

    Weights are ``(1 - (d / d_max)^3)^3`` with d_max the distance of the farthest point of the
    window, which thus has none; two robustness passes multiply them by the bisquare
    ``(1 - (r / 6 median|r|)^2)^2`` of the residuals r. With two points the result is y itself.

    Parameters
    ----------
    x, y
        Shape (n,), x strictly ascending.
    points
        Points in each window, 2 to n.

    Notes
    -----
    Source: W. S. Cleveland, J. Am. Stat. Assoc. 74, 829 (1979). O(n^2), n being a few bins.
    """
    smoothed = y.copy()
    robust = np.ones_like(y)
    # Residuals below rounding are not outliers of anything.
    rounding = 1e-12 * float(np.abs(y).max(initial=0.0))
    for _ in range(_ROBUSTNESS_PASSES + 1):
        for i in range(x.size):
            near = np.sort(np.argsort(np.abs(x - x[i]), kind="stable")[:points])
            distance = np.abs(x[near] - x[i])
            weight = (1.0 - (distance / distance.max()) ** 3) ** 3 * robust[near]
            # A window of nothing but outliers keeps its last value: its own y would make the
            # outlier look like a perfect fit in the next pass.
            smoothed[i] = _line_at(x[near] - x[i], y[near], weight, fallback=smoothed[i])
        residual = np.abs(y - smoothed)
        scale = 6.0 * float(np.median(residual))
        if scale <= 6.0 * rounding:
            break
        robust = np.where(residual < scale, (1.0 - (residual / scale) ** 2) ** 2, 0.0)
    return smoothed


def _line_at(
    x: NDArray[np.float64], y: NDArray[np.float64], weight: NDArray[np.float64], fallback: float
) -> float:
    """Value at x = 0 of the weighted least-squares line (a constant where x does not vary)."""
    total = weight.sum()
    if total <= 0:
        return fallback
    mean_x = (weight * x).sum() / total
    mean_y = (weight * y).sum() / total
    spread = (weight * (x - mean_x) ** 2).sum() / total
    if spread <= 1e-12 * float(np.abs(x).max()) ** 2:
        return float(mean_y)
    slope = (weight * (x - mean_x) * (y - mean_y)).sum() / total / spread
    return float(mean_y - slope * mean_x)


def curve_through(
    knots: NDArray[np.float64], values: NDArray[np.float64], at: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate by a natural cubic spline, straight on beyond the outer knots.

    Fewer than four knots are joined by straight lines instead; a single one gives a constant.

    Parameters
    ----------
    knots
        Shape (n,), strictly ascending.
    values
        Shape (n,) or (n, curves).
    at
        Shape (m,), where to evaluate.

    Returns
    -------
    Shape (m,) or (m, curves).
    """
    if knots.size == 1:
        return np.repeat(values[:1], at.size, axis=0)
    inside = np.clip(at, knots[0], knots[-1])
    if knots.size < 4:
        segment = np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, knots.size - 2)
        slopes = np.diff(values, axis=0) / _as_column(np.diff(knots), values)
        return values[segment] + slopes[segment] * _as_column(at - knots[segment], values)
    spline = CubicSpline(knots, values, bc_type="natural")
    beyond = _as_column(at - inside, values)
    return np.asarray(spline(inside) + spline(inside, 1) * beyond, dtype=np.float64)


def _as_column(vector: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector if values.ndim == 1 else vector[:, np.newaxis]
