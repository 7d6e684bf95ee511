"""Speed against end-to-end distance, with errors in both (after Fig. S10)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from rotortrack.twocolour.resampling import Interval, plain_interval

Floats = NDArray[np.float64]
Axes = Literal["log", "linear", "rank"]

RESOLVED_SD: Final = 2.0
"""Standard deviations by which a value must exceed 0 to have a place on a logarithmic axis."""

_ROUNDS: Final = 6
_RESOLVED_PART: Final = 0.1


@dataclass(frozen=True)
class Correlation:
    """How the speed of rotors goes with their end-to-end distance.

    Attributes
    ----------
    n
        Rotors with both.
    rho
        Spearman's rank correlation of |speed| and distance. Errors of both make it smaller.
    p
        Probability of one this large if distances belonged to any rotor; nan for simulated rods.
    detectable
        Smallest |rho| that n rotors tell from 0 at 5 %: t / sqrt(n - 2 + t^2).
    slope
        Of |speed| on the distance, freed of their errors; on logarithmic axes it is a power.
    slope_n
        Rotors that it is made of.
    reliability
        Part of the variance of the distances that is not their error.
    axes
        Of the slope; nan on rank axes, which have none.
    """

    n: int
    rho: Interval
    p: float
    detectable: float
    slope: Interval
    slope_n: int
    reliability: float
    axes: Axes


def correlate(
    distance_nm: Floats,
    speed_deg_s: Floats,
    distance_sd_nm: Floats,
    speed_sd_deg_s: Floats,
    *,
    axes: Axes,
    resamples: int,
    permutations: int,
    rng: np.random.Generator,
) -> Correlation:
    """Correlate measured rotors.

    Parameters
    ----------
    distance_nm, speed_deg_s
        Of each rotor, (rotors,); the sign of the speed does not count.
    distance_sd_nm, speed_sd_deg_s
        Their standard deviations; 0 where not known.
    axes
        Of the slope. On logarithmic ones rotors count whose speed and distance exceed two standard
        deviations; others have no logarithm with an error.
    resamples, permutations
        Of rotors.
    rng
        Random numbers.
    """
    size = np.abs(speed_deg_s)
    both = np.isfinite(distance_nm) & np.isfinite(size)
    x, y = distance_nm[both], size[both]
    x_sd, y_sd = np.nan_to_num(distance_sd_nm[both]), np.nan_to_num(speed_sd_deg_s[both])
    n = len(x)
    nothing = Interval(math.nan, math.nan, math.nan)
    if n < 3:
        return Correlation(n, nothing, math.nan, math.nan, nothing, 0, math.nan, axes)
    drawn = rng.integers(0, n, (resamples, n))
    rho = float(spearman(x[None], y[None])[0])
    shuffled = rng.permuted(np.tile(x, (permutations, 1)), axis=1)
    extreme = np.abs(spearman(shuffled, y[None])) >= abs(rho) * (1.0 - 1e-9)
    p = (1.0 + float(np.count_nonzero(extreme))) / (permutations + 1.0)
    slope, slope_n, reliability = _slope(x, y, x_sd, y_sd, axes, resamples, rng)
    return Correlation(
        n=n,
        rho=plain_interval(rho, spearman(x[drawn], y[drawn])),
        p=p if math.isfinite(rho) else math.nan,
        detectable=detectable_rho(n),
        slope=slope,
        slope_n=slope_n,
        reliability=reliability,
        axes=axes,
    )


def spearman(x: Floats, y: Floats) -> Floats:
    """Give Spearman's correlation of each row, nan where one of them has a single value."""
    a = stats.rankdata(x, axis=1)
    b = stats.rankdata(y, axis=1)
    a = a - a.mean(axis=1, keepdims=True)
    b = b - b.mean(axis=1, keepdims=True)
    scale = np.sqrt((a**2).sum(axis=1) * (b**2).sum(axis=1))
    rho: Floats = np.divide(
        (a * b).sum(axis=1), scale, out=np.full(len(scale), np.nan), where=scale > 0
    )
    return rho


def weighted_spearman(x: Floats, y: Floats, weight: Floats) -> float:
    """Give Spearman's correlation of weighted points: ranks are the weight below, ties shared."""
    ranks = np.stack([_weighted_ranks(x, weight), _weighted_ranks(y, weight)])
    covariance = np.cov(ranks, aweights=weight, ddof=0)
    scale = math.sqrt(covariance[0, 0] * covariance[1, 1])
    return float(covariance[0, 1] / scale) if scale > 0 else math.nan


def detectable_rho(n: int) -> float:
    """Give the smallest |rho| of n rotors that differs from 0 at 5 %: 0.207 for 90."""
    if n < 4:
        return math.nan
    t = float(stats.t.ppf(0.975, n - 2))
    return t / math.sqrt(n - 2 + t**2)


def errors_in_variables(
    x: Floats, y: Floats, x_variance: Floats, y_variance: Floats
) -> tuple[Floats, Floats]:
    """Fit y = a + b x + scatter to rows of points whose errors are known.

    The moments ``b = S_xy / (S_xx - mean x_variance)``, weighted by one over the variance that the
    errors and the scatter about the line give each point, in turns (Fuller, Measurement Error
    Models, 1987, 3.1).

    Parameters
    ----------
    x, y
        Shape (rows, points).
    x_variance, y_variance
        Of the errors, same shape.

    Returns
    -------
    slope, reliability
        Shape (rows,); the second is the part of the variance of x that is not its error. Where
        that is below a tenth the slope is nan.
    """
    weight = np.ones_like(x)
    slope = np.zeros((len(x), 1))
    left = np.zeros((len(x), 1))
    for _ in range(_ROUNDS):
        total = weight.sum(axis=1, keepdims=True)
        dx = x - (weight * x).sum(axis=1, keepdims=True) / total
        dy = y - (weight * y).sum(axis=1, keepdims=True) / total
        s_xx = (weight * dx**2).sum(axis=1, keepdims=True) / total
        error = (weight * x_variance).sum(axis=1, keepdims=True) / total
        # A resample may hold one rotor alone, whose x does not vary.
        left = np.divide(s_xx - error, s_xx, out=np.zeros_like(s_xx), where=s_xx > 0)
        resolved = left > _RESOLVED_PART
        s_xy = (weight * dx * dy).sum(axis=1, keepdims=True) / total
        slope = np.divide(s_xy, s_xx - error, out=np.full_like(s_xy, np.nan), where=resolved)
        known = y_variance + slope**2 * x_variance
        beyond = (weight * ((dy - slope * dx) ** 2 - known)).sum(axis=1, keepdims=True) / total
        floor = 1e-6 * (weight * dy**2).sum(axis=1, keepdims=True) / total
        spread = known + np.maximum(beyond, floor)
        weight = np.divide(1.0, spread, out=np.ones_like(spread), where=spread > 0)
    return slope[:, 0], left[:, 0]


def _slope(
    x: Floats,
    y: Floats,
    x_sd: Floats,
    y_sd: Floats,
    axes: Axes,
    resamples: int,
    rng: np.random.Generator,
) -> tuple[Interval, int, float]:
    """Fit the slope with an interval from drawing rotors."""
    if axes == "log":
        good = (x > RESOLVED_SD * x_sd) & (y > RESOLVED_SD * y_sd)
        x, y, x_sd, y_sd = x[good], y[good], x_sd[good], y_sd[good]
        x, y, x_sd, y_sd = np.log(x), np.log(y), x_sd / x, y_sd / y
    n = len(x)
    if axes == "rank" or n < 4 or np.ptp(x) == 0.0:
        return Interval(math.nan, math.nan, math.nan), 0 if axes == "rank" else n, math.nan
    table = (x, y, x_sd**2, y_sd**2)
    value, left = errors_in_variables(*(column[None] for column in table))
    drawn = rng.integers(0, n, (resamples, n))
    many, _ = errors_in_variables(*(column[drawn] for column in table))
    return plain_interval(float(value[0]), many), n, float(left[0])


def _weighted_ranks(values: Floats, weight: Floats) -> Floats:
    _, place = np.unique(values, return_inverse=True)
    of_value = np.bincount(place, weight)
    rank: Floats = (np.cumsum(of_value) - 0.5 * of_value)[place]
    return rank
