"""A straight line through points with errors in both axes, and whether it can be a given one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]

_FEWEST_POINTS = 3
_ROUNDS = 4
_MOST_SHARE = 0.8
_LEAST_SPREAD = 3.0
"""Standard deviations by which x must scatter beyond its errors before it tells a slope."""


@dataclass(frozen=True)
class LineFit:
    """Lines ``y = slope x`` and ``y = intercept + slope x``, held against ``y = ratio x``.

    Attributes
    ----------
    n
        Points used.
    slope, slope_sd
        Of the line through the origin; nan where x does not differ from 0 beyond its errors.
    free_slope, free_slope_sd, intercept, intercept_sd
        Of the free line; nan where x is the same for all points within its errors.
    scatter
        Root-mean-square distance from the line through the origin, in units of the points' errors:
        about 1 where these explain it, more where rotors differ.
    ratio
        Slope of the line that is tested.
    p_slope
        Probability of a slope through the origin at least as far from `ratio`, were it true.
    p_line
        The same of slope and intercept together.
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
    """Fit lines whose slopes the errors of x do not flatten and the scatter of y does not steepen.

    With weights ``w = 1 / (y_sd^2 + slope^2 x_sd^2)`` the slope through the origin is
    ``sum(w x y) / sum(w (x^2 - x_sd^2))``, the free line likewise: where errors alone make points
    stray it is as good as the least squares of Deming and York, which take scatter beyond the
    errors, as rotors of different build have it, for a steeper line. Standard deviations come from
    how much each point pulls at the line, so that they hold with such scatter, too. The tests ask
    whether those pulls at the tested line are zero on average beside their spread about the fitted
    one (Student's t, Hotelling's T^2). A true line is refused at 5 % in 5 to 6 % of cases where
    errors explain the scatter, in up to 10 % where rotors differ by 30 %.

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
    Sources: Fuller, Measurement Error Models (1987), 3.1; White, Econometrica 48, 817 (1980).
    """
    good = np.isfinite(x) & np.isfinite(y) & (x_sd > 0.0) & (y_sd > 0.0)
    good &= np.isfinite(x_sd) & np.isfinite(y_sd)
    points = _Points(x[good], y[good], x_sd[good] ** 2, y_sd[good] ** 2)
    n = int(good.sum())
    nan = float("nan")
    if n < _FEWEST_POINTS:
        return LineFit(n, *(nan,) * 7, ratio, *(nan,) * 3)
    (slope, _), through, share = points.solve(free=False)
    (free, intercept), both, both_share = points.solve(free=True)
    line = slope if np.isfinite(slope) else ratio
    on_line = points.squares(ratio)
    return LineFit(
        n=n,
        slope=slope,
        slope_sd=float(np.sqrt(through[0, 0])),
        free_slope=free,
        free_slope_sd=float(np.sqrt(both[0, 0])),
        intercept=intercept,
        intercept_sd=float(np.sqrt(both[-1, -1])),
        scatter=float(np.sqrt(points.squares(line) / (n - 1))),
        ratio=ratio,
        p_slope=points.chance(ratio, (slope, 0.0), share, terms=1),
        p_line=points.chance(ratio, (free, intercept), both_share, terms=2),
        p_errors=float(stats.chi2.sf(on_line, n)),
    )


@dataclass(frozen=True)
class _Points:
    x: Floats
    y: Floats
    x_variance: Floats
    y_variance: Floats

    def weight(self, slope: float) -> Floats:
        weight: Floats = 1.0 / (self.y_variance + slope**2 * self.x_variance)
        return weight

    def squares(self, slope: float) -> float:
        return float(self.weight(slope) @ (self.y - slope * self.x) ** 2)

    def pulls(self, slope: float, intercept: float, weight: Floats) -> Floats:
        """Pull of each point at the slope and at the intercept, shape (2, n), 0 on average."""
        strayed = self.y - intercept - slope * self.x
        return np.stack([weight * (strayed * self.x + slope * self.x_variance), weight * strayed])

    def solve(self, *, free: bool) -> tuple[tuple[float, float], Floats, Floats]:
        """Find slope and intercept at which the pulls cancel, their covariance, and shares.

        The share of a point, (n,), is how far it leads the line.
        """
        terms = 2 if free else 1
        nan = float("nan")
        unknown = (nan, nan), np.full((terms, terms), nan), np.zeros(self.x.size)
        slope = float(np.sqrt(np.mean(self.y**2) / np.mean(self.x**2)))
        for _ in range(_ROUNDS):
            weight = self.weight(slope)
            square = weight * (self.x**2 - self.x_variance)
            each = np.array([[square, weight * self.x], [weight * self.x, weight]])[:terms, :terms]
            middle = np.average(self.x, weights=weight) if free else 0.0
            spread = weight * ((self.x - middle) ** 2 - self.x_variance)
            by_errors = np.sqrt(2.0 * np.sum((weight * self.x_variance) ** 2))
            if not spread.sum() > _LEAST_SPREAD * by_errors:
                return unknown
            told = np.stack([weight * self.x * self.y, weight * self.y])[:terms].sum(axis=1)
            inverse = np.linalg.inv(each.sum(axis=2))
            found = inverse @ told
            slope = float(found[0])
        intercept = float(found[1]) if free else 0.0
        share = np.clip(np.einsum("ab,ban->n", inverse, each), 0.0, _MOST_SHARE)
        # As a jackknife does: a point that leads the line strays less from it than from the truth.
        pulls = self.pulls(slope, intercept, weight)[:terms] / (1.0 - share)
        covariance: Floats = inverse @ (pulls @ pulls.T) @ inverse
        return (slope, intercept), covariance, share

    def chance(
        self, ratio: float, found: tuple[float, float], shares: Floats, *, terms: int
    ) -> float:
        """Probability of pulls at ``y = ratio x`` at least as far from zero by chance.

        Their spread is that about the fitted line, so that a wrong `ratio` does not excuse itself.
        """
        n = self.x.size
        if n <= terms + 1:
            return float("nan")
        weight = self.weight(ratio)
        mean = self.pulls(ratio, 0.0, weight)[:terms].mean(axis=1)
        slope, intercept = found if np.isfinite(found[0]) else (ratio, 0.0)
        pulls = self.pulls(slope, intercept, weight)[:terms] / (1.0 - shares)
        squared = n * float(mean @ np.linalg.solve(pulls @ pulls.T / n, mean))
        return float(stats.f.sf(squared * (n - terms) / (terms * (n - 1)), terms, n - terms))
