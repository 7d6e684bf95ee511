"""A straight line through points with errors in both axes, and whether it can be a given one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

Floats = NDArray[np.float64]

_ANGLES = 181
_FEWEST_POINTS = 3
_SCATTER_ALARM = 0.05
_MOST_SHARE = 0.8


@dataclass(frozen=True)
class LineFit:
    """Lines ``y = slope x`` and ``y = intercept + slope x``, held against ``y = ratio x``.

    Attributes
    ----------
    n
        Points used.
    slope, slope_sd
        Of the line through the origin.
    free_slope, free_slope_sd, intercept, intercept_sd
        Of the free line.
    scatter
        Factor by which points scatter about the free line beyond what their errors say; 1 where
        chance explains it (5 %). Where it is above 1, errors and tests are of what is seen.
    ratio
        Slope of the line that is tested.
    p_slope
        Probability of a slope through the origin at least as far from `ratio`, were it true.
    p_line
        The same of a free line, in slope and intercept together.
    p_errors
        Probability of so much scatter about ``y = ratio x`` from the points' errors alone.
    """

    n: int
    slope: float
    slope_sd: float
    free_slope: float
    free_slope_sd: float
    intercept: float
    intercept_sd: float
    scatter: float
    ratio: float
    p_slope: float
    p_line: float
    p_errors: float


def fit_line(x: Floats, x_sd: Floats, y: Floats, y_sd: Floats, *, ratio: float) -> LineFit:
    """Fit lines by least ``sum (y - a - b x)^2 / (y_sd^2 + b^2 x_sd^2)``.

    Ordinary least squares would take the errors of x for a flatter slope. Where points scatter more
    than their errors say, as rotors of different build do, errors and tests come from the scatter
    that is seen, which may grow with speed: 2 % of precision is not claimed where rotors differ by
    20 %.

    Parameters
    ----------
    x, x_sd, y, y_sd
        Points and their standard deviations, shape (n,); rows that are not finite are left out.
    ratio
        Slope of the line through the origin that is tested.

    Returns
    -------
    LineFit
        nan with fewer than three points.

    Notes
    -----
    Sources: Deming (1943); York et al., Am. J. Phys. 72, 367 (2004).
    """
    good = np.isfinite(x) & np.isfinite(y) & (x_sd > 0.0) & (y_sd > 0.0)
    good &= np.isfinite(x_sd) & np.isfinite(y_sd)
    x, y, x_variance, y_variance = x[good], y[good], x_sd[good] ** 2, y_sd[good] ** 2
    nan = float("nan")
    if x.size < _FEWEST_POINTS:
        return LineFit(x.size, *(nan,) * 7, ratio, *(nan,) * 3)

    def weight(slope: float) -> Floats:
        return 1.0 / (y_variance + slope**2 * x_variance)

    def offset(slope: float) -> float:
        return float(np.average(y - slope * x, weights=weight(slope)))

    def squares(slope: float, intercept: float) -> float:
        return float(weight(slope) @ (y - intercept - slope * x) ** 2)

    # The angle of the line instead of its slope: steep lines are no special case.
    unit = float(np.sqrt(y_variance.mean() / x_variance.mean()))
    through = _least(lambda slope: squares(slope, 0.0), unit)
    free = _least(lambda slope: squares(slope, offset(slope)), unit)
    intercept = offset(free)
    freedom = x.size - 2
    residual = squares(free, intercept)
    by_chance = stats.chi2.sf(residual, freedom) > _SCATTER_ALARM
    scatter = 1.0 if by_chance else float(np.sqrt(residual / freedom))
    on_line = squares(ratio, 0.0)
    if by_chance:
        slope_sd = _curvature_sd(lambda slope: squares(slope, 0.0), through)
        free_sd = _curvature_sd(lambda slope: squares(slope, offset(slope)), free)
        lever = float(np.average(x, weights=weight(free)))
        intercept_sd = float(np.sqrt(1.0 / weight(free).sum() + (lever * free_sd) ** 2))
        p_slope = float(stats.chi2.sf(max(on_line - squares(through, 0.0), 0.0), 1))
        p_line = float(stats.chi2.sf(max(on_line - residual, 0.0), 2))
    else:

        def each(at: Floats) -> Floats:
            intercept = at[1] if at.size == 2 else 0.0
            half: Floats = 0.5 * weight(float(at[0])) * (y - intercept - at[0] * x) ** 2
            return half

        unit_y = float(np.sqrt(y_variance.mean()))
        one, sure = _as_seen(each, np.array([through]), np.array([unit]))
        both, both_sure = _as_seen(each, np.array([free, intercept]), np.array([unit, unit_y]))
        slope_sd, free_sd, intercept_sd = np.sqrt([one[0, 0], both[0, 0], both[1, 1]]).tolist()
        away = np.array([free - ratio, intercept])
        p_slope = float(2.0 * stats.t.sf(abs(through - ratio) / slope_sd, sure))
        p_line = float(stats.f.sf(0.5 * away @ np.linalg.solve(both, away), 2, both_sure))
    return LineFit(
        n=x.size,
        slope=through,
        slope_sd=slope_sd,
        free_slope=free,
        free_slope_sd=free_sd,
        intercept=intercept,
        intercept_sd=intercept_sd,
        scatter=scatter,
        ratio=ratio,
        p_slope=p_slope,
        p_line=p_line,
        p_errors=float(stats.chi2.sf(on_line, x.size)),
    )


def _as_seen(each: Callable[[Floats], Floats], best: Floats, unit: Floats) -> tuple[Floats, float]:
    """Covariance of a fit from how much each point pulls at it, whatever made it stray.

    The sandwich of White (1980), each pull divided by one less the point's share of the
    information as a jackknife would. `each` gives the half squares of every point. Where few points
    make up most of the covariance, it has few degrees of freedom, which come second.
    """
    step = 1e-3 * unit
    shift = np.diag(step)
    size = best.size
    pull = np.stack(
        [(each(best + shift[a]) - each(best - shift[a])) / (2.0 * step[a]) for a in range(size)]
    )
    bend = np.empty((size, size, pull.shape[1]))
    for a in range(size):
        for b in range(size):
            corners = [
                sign * each(best + first * shift[a] + second * shift[b])
                for first, second, sign in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
            ]
            bend[a, b] = sum(corners) / (4.0 * step[a] * step[b])
    inverse = np.linalg.inv(bend.sum(axis=2))
    share = np.clip(np.einsum("ab,ban->n", inverse, bend), 0.0, _MOST_SHARE)
    pull = pull / (1.0 - share)
    covariance: Floats = inverse @ (pull @ pull.T) @ inverse
    parts = (inverse[0] @ pull) ** 2
    return covariance, float(parts.sum() ** 2 / (parts @ parts))


def _least(squares: Callable[[float], float], unit: float) -> float:
    """Find the slope of least squares, first on a grid of angles."""

    def at(angle: float) -> float:
        return squares(unit * float(np.tan(angle)))

    edge = 0.5 * np.pi - 1e-6
    grid = np.linspace(-edge, edge, _ANGLES)
    best = int(np.argmin([at(angle) for angle in grid]))
    around = (grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)])
    found = optimize.minimize_scalar(at, bounds=around, method="bounded", options={"xatol": 1e-10})
    return unit * float(np.tan(found.x))


def _curvature_sd(squares: Callable[[float], float], slope: float) -> float:
    """Give the standard deviation of a slope from how squares grow beside their least value."""
    least = squares(slope)
    step = 1e-3 * max(abs(slope), 1e-3)
    for _ in range(60):
        # Wide enough to be far above rounding, near enough to be a parabola.
        growth = 0.5 * (squares(slope + step) + squares(slope - step)) - least
        if growth > 0.05:
            break
        step *= 1.5
    while growth > 0.2:
        step *= 0.7
        growth = 0.5 * (squares(slope + step) + squares(slope - step)) - least
    return float(step / np.sqrt(growth)) if growth > 0.0 else float("inf")
