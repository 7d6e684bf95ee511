"""Stiffness of rods that equilibrated in the plane: the two-dimensional worm-like chain.

Along such a chain the direction diffuses: <(d theta)^2> = s / P, <cos d theta> = exp(-s / (2 P)).
A chain is cut into segments of length a. The turns between their chords are Gaussian with the
covariance x T, x = a / P, plus y Q by the noise of the nodes, Q being the square of the
second-difference matrix and y = (sd / a)^2. Of a line as it is, T has 2/3 on its diagonal and 1/6
beside it; of a smoothed one it is the Fourier integral of what the smoother passes. With y known
from the image, the best estimate of x where noise is small is turns T^-1 turns - y tr(T^-1 Q) per
turn. Unlike a line through the tangent correlation it uses each bend once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import stdtrit

from rotortrack.afm.centre_line import along, resample

Floats = NDArray[np.float64]

_NOISE_ERROR = 0.3
"""Relative error that the variance of the nodes' noise is granted."""

_LARGEST_WAVE = 60.0
_TAIL = 4.0 / math.pi * 1.5 / (3.0 * _LARGEST_WAVE**3)
"""Upper limit of the integral over u, and what is beyond it of an unsmoothed line's variance."""

_LONGEST = 0.5
"""Part of the mean length up to which the tangent correlation is averaged."""


@dataclass(frozen=True)
class Persistence:
    """How stiff rods are.

    Attributes
    ----------
    persistence_nm
        Persistence length; infinite where no bending exceeds the noise.
    ci_low_nm, ci_high_nm
        Its 95 % interval; the upper end is infinite where only a lower limit is found.
    turns
        Number of turns behind it.
    segment_nm
        Length of the segments.
    noise_share
        Part of the turns' variance that noise makes.
    by_tangents_nm
        By the slope of the tangent correlation's logarithm, nan where it does not fall.
    by_end_to_end_nm
        By <R^2> and the contour lengths, nan where ends are as far apart as a stiff rod's.
    lag_nm, correlation, correlation_sd
        The tangent correlation, and its standard error over rods.
    """

    persistence_nm: float
    ci_low_nm: float
    ci_high_nm: float
    turns: int
    segment_nm: float
    noise_share: float
    by_tangents_nm: float
    by_end_to_end_nm: float
    lag_nm: Floats
    correlation: Floats
    correlation_sd: Floats

    @property
    def is_limit(self) -> bool:
        """Whether only a lower limit is found."""
        return not math.isfinite(self.ci_high_nm)


def turns_of(path_nm: Floats, segment_nm: float) -> Floats:
    """Cut a line into segments, what is left over at both ends apart, and give their turns."""
    length = float(along(path_nm)[-1])
    count = int(length / segment_nm)
    if count < 2:
        return np.zeros(0)
    start = (length - count * segment_nm) / 2.0
    nodes = resample(path_nm, segment_nm, start, start + count * segment_nm)
    chord = np.diff(nodes, axis=0)
    before, behind = chord[:-1], chord[1:]
    cross = before[:, 0] * behind[:, 1] - before[:, 1] * behind[:, 0]
    return np.asarray(np.arctan2(cross, (before * behind).sum(axis=1)))


def estimate_persistence(
    paths_nm: Sequence[Floats],
    *,
    segment_nm: float,
    smooth_nm: float,
    noise_nm: Sequence[float],
    resamples: int,
    seed: int,
) -> Persistence | None:
    """Estimate the persistence length from the centre lines of rods.

    The interval is Student's on the logarithm, with the standard deviation of the bootstrap over
    rods or that of the model, sqrt(2 / turns), whichever gives the wider one.

    Parameters
    ----------
    paths_nm
        Centre lines (n, 2) in nm.
    segment_nm
        Length of the segments.
    smooth_nm
        Length over which the lines were smoothed by `centre_line.smooth`.
    noise_nm
        Standard deviation of each line's points across it (nm).
    resamples, seed
        Of the bootstrap.

    Returns
    -------
    Persistence or None
        None where no rod has two segments.
    """
    pairs = [
        (path, turns, sd)
        for path, sd in zip(paths_nm, noise_nm, strict=True)
        if len(turns := turns_of(path, segment_nm))
    ]
    if not pairs:
        return None
    paths = [path for path, _, _ in pairs]
    parts = [_sums(turns, smooth_nm / segment_nm, (sd / segment_nm) ** 2) for _, turns, sd in pairs]
    total, noise, count = np.array(parts).T
    n = int(count.sum())
    bend = float((total - noise).sum() / n)
    share = float(noise.sum() / max(total.sum(), 1e-300))
    rods = len(pairs)
    model = float(total.sum() / n) * math.sqrt(2.0 / n)
    half = 1.96 * model
    if rods > 1:
        rng = np.random.default_rng(seed)
        chosen = rng.integers(0, rods, (resamples, rods))
        drawn = (total - noise)[chosen].sum(axis=1) / count[chosen].sum(axis=1)
        spread = float(drawn.std()) * math.sqrt(rods / (rods - 1))
        half = max(half, float(stdtrit(rods - 1, 0.975)) * spread)
    half = math.hypot(half, 1.96 * _NOISE_ERROR * float(noise.sum() / n))
    lag, correlation, sd = tangent_correlation(paths, segment_nm)
    if bend - half > 0.0:
        persistence = segment_nm / bend
        low, high = (persistence * math.exp(sign * half / bend) for sign in (-1, 1))
    else:
        persistence = segment_nm / bend if bend > 0.0 else math.inf
        low, high = segment_nm / (bend + half), math.inf
    return Persistence(
        persistence,
        low,
        high,
        n,
        segment_nm,
        share,
        _by_tangents(lag, correlation, segment_nm),
        _by_end_to_end(paths),
        lag,
        correlation,
        sd,
    )


def _sums(turns: Floats, smooth: float, noise: float) -> tuple[float, float, int]:
    """Give turns T^-1 turns, what noise adds to it, and the number of turns."""
    n = len(turns)
    lags = np.arange(n)
    bending = turn_covariance(n, smooth)[np.abs(lags[:, None] - lags)]
    second = np.eye(n, n + 2) - 2.0 * np.eye(n, n + 2, k=1) + np.eye(n, n + 2, k=2)
    inverse = np.linalg.inv(bending)
    added = noise * float(np.trace(inverse @ second @ second.T))
    return float(turns @ inverse @ turns), added, n


def turn_covariance(count: int, smooth: float) -> Floats:
    """Covariance of turns 0, 1, ... segments apart, in units of a / P.

    (4 / pi) int_0^inf H(u)^2 sin(u/2)^4 / (u/2)^2 / u^2 cos(m u) du, H = 1 / (1 + (u l)^4).

    Parameters
    ----------
    count
        Number of lags.
    smooth
        l: smoothing length in units of a segment.
    """
    step = 0.01
    u = step * (np.arange(round(_LARGEST_WAVE / step)) + 0.5)
    passed = 1.0 / (1.0 + (u * smooth) ** 4) ** 2
    density = passed * np.sin(u / 2.0) ** 4 / (u / 2.0) ** 2 / u**2
    found = 4.0 / math.pi * step * np.cos(np.arange(count)[:, None] * u) @ density
    if smooth == 0.0:
        found[0] += _TAIL
    return np.asarray(found)


def tangent_correlation(
    paths_nm: Sequence[Floats], segment_nm: float
) -> tuple[Floats, Floats, Floats]:
    """Average cos(theta(s + lag) - theta(s)) over all rods.

    Returns
    -------
    array, array, array
        Lags (nm) in quarters of a segment, the correlation, its standard error over rods.
    """
    step = segment_nm / 4.0
    longest = _LONGEST * float(np.mean([along(path)[-1] for path in paths_nm]))
    count = max(int(longest / step), 1)
    sums, pairs = np.zeros((len(paths_nm), count)), np.zeros((len(paths_nm), count))
    for row, path in enumerate(paths_nm):
        chord = np.diff(resample(path, step), axis=0)
        chord /= np.hypot(*chord.T)[:, None]
        for lag in range(1, min(count, len(chord) - 1) + 1):
            products = (chord[:-lag] * chord[lag:]).sum(axis=1)
            sums[row, lag - 1], pairs[row, lag - 1] = products.sum(), len(products)
    seen = pairs.sum(axis=0) > 0
    sums, pairs = sums[:, seen], pairs[:, seen]
    mean = sums.sum(axis=0) / pairs.sum(axis=0)
    off = sums - mean * pairs
    rods = len(paths_nm)
    spread = np.sqrt((off**2).sum(axis=0) * rods / max(rods - 1, 1)) / pairs.sum(axis=0)
    return np.asarray(step * (np.flatnonzero(seen) + 1.0)), np.asarray(mean), np.asarray(spread)


def _by_tangents(lag: Floats, correlation: Floats, segment_nm: float) -> float:
    """Slope of -ln <cos> behind one segment, weighted by 1 / lag as its variance grows."""
    used = (lag >= segment_nm) & (correlation > 0.0)
    if np.count_nonzero(used) < 3:
        return math.nan
    slope = np.polyfit(lag[used], -np.log(correlation[used]), 1, w=1.0 / lag[used])[0]
    return 1.0 / (2.0 * float(slope)) if slope > 0.0 else math.nan


def mean_square_distance(length: Floats, persistence: float) -> Floats:
    """<R^2> = 4 P L (1 - 2 P / L (1 - exp(-L / (2 P)))) of chains in the plane."""
    u = length / (2.0 * persistence)
    # 2 (u - 1 + exp(-u)) / u^2 loses all digits for stiff rods.
    series = 1.0 - u / 3.0 + u**2 / 12.0 - u**3 / 60.0 + u**4 / 360.0
    exact = 2.0 * (u + np.expm1(-u)) / np.maximum(u, 1e-3) ** 2
    return np.asarray(length**2 * np.where(u < 1e-2, series, exact))


def _by_end_to_end(paths: Sequence[Floats]) -> float:
    length = np.array([along(path)[-1] for path in paths])
    squared = float(np.mean([((path[-1] - path[0]) ** 2).sum() for path in paths]))

    def excess(log_p: float) -> float:
        return float(mean_square_distance(length, math.exp(log_p)).mean()) - squared

    low, high = math.log(1e-2 * length.mean()), math.log(1e3 * length.mean())
    if excess(low) >= 0.0 or excess(high) <= 0.0:
        return math.nan
    return math.exp(float(brentq(excess, low, high)))
