"""The true end-to-end distance of a rotor, from lengths that noise makes too long.

Noise adds to a distance: at 50 nm with 30 nm per axis the mean of the measured lengths reads 60
nm, and their median hardly less. The law of `distance_law` is fitted to the lengths instead, by
maximum likelihood, three times: with the noise as the uncertainties tell it, with its scale free,
and, as the default, with a scale that a prior of some per cent draws to 1. A rod breathes where the
likelihood says so (a ratio test at 5 %): else its distance is taken to be constant, which the
lengths could not tell from a little breathing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize

from rotortrack.twocolour.distance_law import log_density

Floats = NDArray[np.float64]

_BREATHES = 2.71
"""Twice the logarithm of the likelihood ratio above which breathing counts: 5 %, one-sided."""

_INTERVAL = 3.84
_TOLD_SD = 1.96
_FAR_SD = 5.0
_LARGEST_SCALE = 1.5
_STEP = 3e-3
_LIKE, _BIN = 0.08, 0.05
_SETTLED = 1e-3
_KNOWN_SD = 1e-4


@dataclass(frozen=True)
class Estimate:
    """One fit of the distance.

    Attributes
    ----------
    mean_nm, mean_sd_nm
        Mean of the true distance over the frames, and its standard deviation.
    low_nm, high_nm
        Its 95 % interval, of the profile of the likelihood; from 0 where the distance drowns in
        noise.
    breathing_nm, breathing_sd_nm
        Standard deviation of the true distance over time; 0 with an unknown error (nan) where
        nothing tells it from a constant one.
    scale, scale_sd
        Noise over what the uncertainties tell; its error is 0 where it was taken as known.
    """

    mean_nm: float
    mean_sd_nm: float
    low_nm: float
    high_nm: float
    breathing_nm: float
    breathing_sd_nm: float
    scale: float
    scale_sd: float


@dataclass(frozen=True)
class Distance:
    """What the lengths of one rotor tell.

    Attributes
    ----------
    default, known, free
        Fits with the noise drawn to, fixed at, and free of what the uncertainties tell.
    told_noise_nm
        Noise of the vector per axis as they tell it, rms.
    plain_mean_nm
        Mean of the lengths, noise and all.
    moment_nm
        Root of the mean square less twice the square of the noise; 0 where that is negative.
    """

    default: Estimate
    known: Estimate
    free: Estimate
    told_noise_nm: float
    plain_mean_nm: float
    moment_nm: float


def true_distance(lengths_nm: Floats, noise_nm: Floats, *, noise_prior: float = 0.02) -> Distance:
    """Fit the true distance of two ends to measured lengths.

    Parameters
    ----------
    lengths_nm
        Lengths of the measured end-to-end vectors, (frames,), nm.
    noise_nm
        Noise of these vectors per axis as the uncertainties of both ends and of the registration
        tell it, (frames,), nm.
    noise_prior
        Relative standard deviation of that noise, known only so well; 0 takes it as known.

    Returns
    -------
    Distance

    Raises
    ------
    ValueError
        There are fewer than 10 lengths, or lengths or noise are not finite or not positive.

    Notes
    -----
    Errors take the noise of frames as independent. They are those of the mean over these frames:
    a rod that breathes slowly may have another mean in another film.
    """
    lengths = np.asarray(lengths_nm, np.float64)
    noise = np.asarray(noise_nm, np.float64)
    if lengths.shape != noise.shape or lengths.ndim != 1 or lengths.size < _FEWEST:
        raise ValueError(f"give at least {_FEWEST} lengths, each with its noise")
    if not (np.isfinite(lengths) & np.isfinite(noise) & (lengths >= 0) & (noise > 0)).all():
        raise ValueError("lengths and noise must be finite, lengths at least 0, noise above 0")
    told = float(np.sqrt(np.mean(noise**2)))
    # A length of exactly 0 has no logarithm; a millionth of the noise is none of anybody's.
    data = _gathered(np.maximum(lengths, 1e-6 * told), noise, told)
    square = float(np.mean(lengths**2)) - 2.0 * told**2
    breathes = _breathes(data, noise_prior)
    default = _fit(data, noise_prior, breathes=breathes)
    known = default if noise_prior <= _KNOWN_SD else _fit(data, 0.0, breathes=breathes)
    return Distance(
        default=default,
        known=known,
        free=_fit(data, math.inf, breathes=breathes),
        told_noise_nm=told,
        plain_mean_nm=float(lengths.mean()),
        moment_nm=math.sqrt(max(square, 0.0)),
    )


_FEWEST = 10


@dataclass(frozen=True)
class _Data:
    """Lengths and their noise, gathered where they are nearly equal, and how many of each.

    `unit` is the noise in which places are counted, `largest` the largest length in it.
    """

    lengths: Floats
    noise: Floats
    counts: Floats
    unit: float

    @property
    def largest(self) -> float:
        return float(self.lengths.max()) / self.unit + 1.0

    @property
    def mean_square(self) -> float:
        """Mean square of the lengths less that of the noise, in units."""
        square = float(self.counts @ self.lengths**2 / self.counts.sum())
        return square / self.unit**2 - 2.0

    @property
    def spread(self) -> float:
        """Standard deviation of the lengths, in units."""
        mean = float(self.counts @ self.lengths / self.counts.sum())
        variance = float(self.counts @ (self.lengths - mean) ** 2 / self.counts.sum())
        return math.sqrt(variance) / self.unit

    def cost(self, mean: float, breathing: float, log_scale: float, prior: float) -> float:
        """Give minus the log of likelihood and prior; mean and breathing in units of noise."""
        values = log_density(
            self.lengths, math.exp(log_scale) * self.noise, mean * self.unit, breathing * self.unit
        )
        drawn = 0.0 if math.isinf(prior) or prior == 0.0 else 0.5 * (log_scale / prior) ** 2
        return drawn - float(self.counts @ values)


def _gathered(lengths: Floats, noise: Floats, told: float) -> _Data:
    """Replace lengths within a twentieth of their like noise by their mean.

    That widens nothing by more than 2e-4 of the noise's variance, and spares most of the work.
    """
    kind = np.round(np.log(noise / told) / _LIKE)
    step = np.floor(lengths / (_BIN * told * np.exp(_LIKE * kind)))
    _, place = np.unique(np.column_stack([kind, step]), axis=0, return_inverse=True)
    place = place.reshape(-1)
    counts = np.bincount(place).astype(np.float64)
    return _Data(
        np.bincount(place, lengths) / counts,
        np.sqrt(np.bincount(place, noise**2) / counts),
        counts,
        told,
    )


@dataclass(frozen=True)
class _Best:
    """Where the cost is least, as (mean, breathing, log scale) in units of noise."""

    place: tuple[float, float, float]
    cost: float


def _breathes(data: _Data, prior: float) -> bool:
    """Tell whether breathing explains the lengths clearly better than a constant distance."""
    rigid = _least(data, prior, _start(data, breathes=False), breathes=False)
    breathing = _least(data, prior, _start(data, breathes=True), breathes=True)
    return 2.0 * (rigid.cost - breathing.cost) > _BREATHES


def _start(data: _Data, *, breathes: bool) -> tuple[float, float, float]:
    mean = math.sqrt(max(data.mean_square, 0.25))
    return mean, math.sqrt(max(data.spread**2 - 1.0, 0.01)) if breathes else 0.0, 0.0


def _fit(data: _Data, prior: float, *, breathes: bool) -> Estimate:
    """Find the best place, and its errors."""
    scaled = prior > _KNOWN_SD
    best = _least(data, prior, _start(data, breathes=breathes), breathes=breathes)
    covariance = _covariance(data, prior, best, breathes=breathes)
    mean, width, log_scale = best.place
    mean_sd = math.sqrt(covariance[0, 0])
    low, high = _interval(data, prior, best, mean_sd, breathes=breathes)
    scale = math.exp(log_scale)
    return Estimate(
        mean_nm=mean * data.unit,
        mean_sd_nm=mean_sd * data.unit,
        low_nm=low * data.unit,
        high_nm=high * data.unit,
        breathing_nm=width * data.unit,
        breathing_sd_nm=math.sqrt(covariance[1, 1]) * data.unit if breathes else math.nan,
        scale=scale,
        scale_sd=scale * math.sqrt(covariance[2, 2]) if scaled else 0.0,
    )


def _least(
    data: _Data,
    prior: float,
    start: tuple[float, float, float],
    *,
    breathes: bool,
    mean: float | None = None,
) -> _Best:
    """Find the least cost over what is free: the mean unless it is given, breathing, the scale."""
    scaled = prior > _KNOWN_SD
    largest = data.largest
    limit = math.log(_LARGEST_SCALE)
    free = [(0, (0.0, largest))] if mean is None else []
    free += [(1, (0.0, largest))] if breathes else []
    free += [(2, (-limit, limit))] if scaled else []
    fixed = [start[0] if mean is None else mean, start[1] if breathes else 0.0, start[2]]
    if not scaled:
        fixed[2] = 0.0

    def cost(values: Floats) -> float:
        place = list(fixed)
        for (index, _), value in zip(free, values.tolist(), strict=True):
            place[index] = value
        return data.cost(place[0], place[1], place[2], prior)

    if not free:
        return _Best((fixed[0], fixed[1], fixed[2]), cost(np.empty(0)))
    bounds = [bound for _, bound in free]
    at = np.clip([fixed[index] for index, _ in free], *np.transpose(bounds))
    found = minimize(
        cost, at, method="L-BFGS-B", bounds=bounds, options={"ftol": 1e-12, "gtol": 1e-4}
    )
    place = list(fixed)
    for (index, _), value in zip(free, found.x.tolist(), strict=True):
        place[index] = value
    return _Best((place[0], place[1], place[2]), float(found.fun))


def _covariance(data: _Data, prior: float, best: _Best, *, breathes: bool) -> NDArray[np.float64]:
    """Invert the curvature of the cost over what is free; zero elsewhere."""
    free = [0, *([1] if breathes else []), *([2] if prior > _KNOWN_SD else [])]
    place = np.array(best.place)
    # Where the mean is 0 the cost is even in it, and its curvature that of either side.
    step = np.full(3, _STEP)

    def cost(shift: Floats) -> float:
        mean, width, log_scale = place + shift
        return data.cost(abs(mean), abs(width), log_scale, prior)

    curvature = np.zeros((len(free), len(free)))
    for row, first in enumerate(free):
        for column, second in enumerate(free[: row + 1]):
            one, other = np.zeros(3), np.zeros(3)
            one[first], other[second] = step[first], step[second]
            bent = cost(one + other) - cost(one - other) - cost(other - one) + cost(-one - other)
            curvature[row, column] = curvature[column, row] = bent / (
                4.0 * step[first] * step[second]
            )
    values, vectors = np.linalg.eigh(curvature)
    # A direction that the lengths do not tell has no curvature, or a negative one by rounding.
    least = 1e-9 * max(float(values.max()), 1.0)
    inverse = (vectors / np.maximum(values, least)) @ vectors.T
    whole = np.zeros((3, 3))
    whole[np.ix_(free, free)] = inverse
    return whole


def _interval(
    data: _Data, prior: float, best: _Best, mean_sd: float, *, breathes: bool
) -> tuple[float, float]:
    """Give the 95 % interval of the mean, in units of noise."""
    mean = best.place[0]
    if mean > _FAR_SD * max(mean_sd, 1.0) and mean_sd < 0.2:
        return mean - _TOLD_SD * mean_sd, mean + _TOLD_SD * mean_sd

    def excess(at: float) -> float:
        there = _least(data, prior, best.place, breathes=breathes, mean=at)
        return 2.0 * (there.cost - best.cost) - _INTERVAL

    low = 0.0
    if excess(0.0) > 0.0 and mean > 0.0:
        low = _crossing(excess, 0.0, mean)
    reach = max(3.0 * mean_sd, 0.1)
    top = data.largest
    high = mean + reach
    while excess(high) < 0.0 and high < top:
        high += reach
    if high < top:
        high = _crossing(excess, high, mean)
    return low, min(high, top)


def _crossing(excess: Callable[[float], float], outside: float, inside: float) -> float:
    """Find where the profile crosses its bound; inside lies the best place."""
    return float(brentq(lambda at: excess(at), outside, inside, xtol=_SETTLED))
