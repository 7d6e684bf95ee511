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

from rotortrack.twocolour.distance_law import log_density_slopes
from rotortrack.twocolour.independent import independent_distances

Floats = NDArray[np.float64]

_BREATHES = 2.71
"""Twice the logarithm of the likelihood ratio above which breathing counts: 5 %, one-sided."""

_INTERVAL = 3.84
_TOLD_SD = 1.96
_FAR_SD, _SMALL_SD = 30.0, 0.05
_LARGEST_SCALE = 1.5
_STEP = 3e-3
_LIKE, _BIN = 0.08, 0.05
_SETTLED, _KNOWN_SD = 1e-3, 1e-4
_FEWEST = 10


@dataclass(frozen=True)
class Estimate:
    """One fit of the distance.

    Attributes
    ----------
    mean_nm, mean_sd_nm
        Mean of the true distance over the frames, and its standard deviation.
    low_nm, high_nm
        Its 95 % interval, of the profile of the likelihood less what breathing adds; from 0 where
        the distance drowns in noise.
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
    n_independent
        How many independent distances the frames are worth, where breathing keeps from frame to
        frame; the number of frames where nothing breathes.
    lasting_sd_nm
        Standard deviation of the default mean as that of the rod in any other film: with so few
        independent distances.
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
    n_independent: float
    lasting_sd_nm: float
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
    Errors are those of the mean over these frames: the likelihood's own are of the mean that all
    frames are drawn from, and so wider by the variance of breathing over their number. A rod that
    breathes may have another mean in another film: `lasting_sd_nm` is wider by the variance of
    breathing over the number of independent distances, which are counted by the autocovariance of
    squared lengths. Noise does not enter it, as that of two frames is independent.

    Examples
    --------
    >>> import numpy as np, rotortrack as rt
    >>> x, y = np.random.default_rng(1).normal(0.0, 30.0, (2, 5000))
    >>> found = rt.true_distance(np.hypot(50.0 + x, y), np.full(5000, 30.0))
    >>> round(found.plain_mean_nm), round(found.default.mean_nm)
    (60, 49)
    """
    lengths = np.asarray(lengths_nm, np.float64)
    noise = np.asarray(noise_nm, np.float64)
    if lengths.shape != noise.shape or lengths.ndim != 1 or lengths.size < _FEWEST:
        raise ValueError(f"give at least {_FEWEST} lengths, each with its noise")
    if not (np.isfinite(lengths) & np.isfinite(noise) & (lengths >= 0) & (noise**2 > 0)).all():
        raise ValueError("lengths and noise must be finite, lengths at least 0, noise above 0")
    told = float(np.sqrt(np.mean(noise**2)))
    # A length of exactly 0 has no logarithm; a millionth of the noise is none of anybody's.
    data = _gathered(np.maximum(lengths, 1e-6 * told), noise, told)
    square = float(np.mean(lengths**2)) - 2.0 * told**2
    rigid, breathing = _bests(data, noise_prior)
    breathes = 2.0 * (rigid.cost - breathing.cost) > _BREATHES
    best = breathing if breathes else rigid
    default = _fit(data, noise_prior, best, breathes=breathes)
    known = default
    if noise_prior > _KNOWN_SD:
        known = _fit(data, 0.0, _least(data, 0.0, best.place, breathes=breathes), breathes=breathes)
    free = _least(data, math.inf, best.place, breathes=breathes)
    variance = default.breathing_nm**2
    breaths = independent_distances(lengths, noise) if breathes else float(lengths.size)
    lasting = default.mean_sd_nm**2 + variance / breaths if breathes else default.mean_sd_nm**2
    return Distance(
        default=default,
        known=known,
        free=_fit(data, math.inf, free, breathes=breathes),
        n_independent=breaths,
        lasting_sd_nm=math.sqrt(lasting),
        told_noise_nm=told,
        plain_mean_nm=float(lengths.mean()),
        moment_nm=math.sqrt(max(square, 0.0)),
    )


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

    def cost(
        self, mean: float, breathing: float, log_scale: float, prior: float
    ) -> tuple[float, Floats]:
        """Give minus the logarithm of likelihood and prior, and its slope by each of the three.

        Mean and breathing are in units of noise.
        """
        noise = math.exp(log_scale) * self.noise
        sums = self.counts @ log_density_slopes(
            self.lengths, noise, mean * self.unit, breathing * self.unit
        )
        slope = -sums[1:] * (self.unit, self.unit, 1.0)
        cost = -float(sums[0])
        if 0.0 < prior < math.inf:
            cost += 0.5 * (log_scale / prior) ** 2
            slope[2] += log_scale / prior**2
        return cost, slope


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


def _bests(data: _Data, prior: float) -> tuple[_Best, _Best]:
    """Find the best place of a constant distance and of one that breathes."""
    mean = math.sqrt(max(data.mean_square, 0.25))
    rigid = _least(data, prior, (mean, 0.0, 0.0), breathes=False)
    width = math.sqrt(max(data.spread**2 - 1.0, 0.01))
    return rigid, _least(data, prior, (mean, width, 0.0), breathes=True)


def _fit(data: _Data, prior: float, best: _Best, *, breathes: bool) -> Estimate:
    """Give the best place with its errors."""
    covariance = _covariance(data, prior, best, breathes=breathes)
    mean, width, log_scale = best.place
    low, high, mean_sd = _interval(
        data, prior, best, math.sqrt(covariance[0, 0]), breathes=breathes
    )
    scale = math.exp(log_scale)
    kept = 1.0
    if breathes:
        # An efficient mean errs from that of the frames by its variance less that of theirs; noise
        # leaves at least its own.
        frames = float(data.counts.sum())
        kept = math.sqrt(max(mean_sd**2 - width**2 / frames, scale**2 / frames)) / mean_sd
    below = kept if low > 0.0 else 1.0
    return Estimate(
        mean_nm=mean * data.unit,
        mean_sd_nm=kept * mean_sd * data.unit,
        low_nm=(mean - below * (mean - low)) * data.unit,
        high_nm=(mean + kept * (high - mean)) * data.unit,
        breathing_nm=width * data.unit,
        breathing_sd_nm=math.sqrt(covariance[1, 1]) * data.unit if breathes else math.nan,
        scale=scale,
        scale_sd=scale * math.sqrt(covariance[2, 2]) if prior > _KNOWN_SD else 0.0,
    )


def _free(prior: float, *, breathes: bool) -> list[int]:
    """List which of mean, breathing and log scale are fitted."""
    return [0, *([1] if breathes else []), *([2] if prior > _KNOWN_SD else [])]


def _least(
    data: _Data,
    prior: float,
    start: tuple[float, float, float],
    *,
    breathes: bool,
    mean: float | None = None,
) -> _Best:
    """Find the least cost over what is free: the mean unless it is given, breathing, the scale."""
    free = _free(prior, breathes=breathes)
    place = np.where(np.isin(np.arange(3), free), start, 0.0)
    if mean is not None:
        free, place[0] = free[1:], mean
    if not free:
        return _Best(_three(place), data.cost(*_three(place), prior)[0])
    limit = math.log(_LARGEST_SCALE)
    limits = [(0.0, data.largest), (0.0, data.largest), (-limit, limit)]
    bounds = [limits[k] for k in free]

    def cost(values: Floats) -> tuple[float, Floats]:
        there = place.copy()
        there[free] = values
        value, slope = data.cost(*_three(there), prior)
        return value, slope[free]

    # L-BFGS-B would do as well, but its threads of BLAS wait for each other for most of the time.
    found = minimize(
        cost,
        np.clip(place[free], *np.transpose(bounds)),
        method="TNC",
        jac=True,
        bounds=bounds,
        options={"ftol": 1e-6, "gtol": 0.0, "xtol": 1e-6, "maxfun": 300},
    )
    place[free] = found.x
    return _Best(_three(place), float(found.fun))


def _three(place: Floats) -> tuple[float, float, float]:
    return float(place[0]), float(place[1]), float(place[2])


def _covariance(data: _Data, prior: float, best: _Best, *, breathes: bool) -> Floats:
    """Invert the curvature of the cost over what is free; zero elsewhere."""
    free = _free(prior, breathes=breathes)
    even = np.array([1.0, 1.0, 0.0])

    def slope(index: int, step: float) -> Floats:
        there = np.array(best.place)
        there[index] += step
        # The cost is even in mean and breathing, so that its slope is odd in both.
        turned = np.where((even > 0.0) & (there < 0.0), -1.0, 1.0)
        return turned * data.cost(*_three(turned * there), prior)[1]

    rows = [(slope(k, _STEP) - slope(k, -_STEP))[free] / (2.0 * _STEP) for k in free]
    curvature = np.array(rows)
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
    # A direction that the lengths do not tell has no curvature, or a negative one by rounding.
    least = 1e-9 * max(float(values.max()), 1.0)
    inverse = (vectors / np.maximum(values, least)) @ vectors.T
    whole = np.zeros((3, 3))
    whole[np.ix_(free, free)] = inverse
    return whole


def _interval(
    data: _Data, prior: float, best: _Best, mean_sd: float, *, breathes: bool
) -> tuple[float, float, float]:
    """Give the 95 % interval of the mean and its standard deviation, in units of noise.

    Where the curvature cannot be trusted the standard deviation is that of a normal law with the
    interval's upper part.
    """
    mean = best.place[0]
    if mean > _FAR_SD * mean_sd and mean_sd < _SMALL_SD:
        return mean - _TOLD_SD * mean_sd, mean + _TOLD_SD * mean_sd, mean_sd

    def excess(at: float) -> float:
        if at == mean:
            return -_INTERVAL
        there = _least(data, prior, best.place, breathes=breathes, mean=at)
        return 2.0 * (there.cost - best.cost) - _INTERVAL

    low = 0.0
    if mean > 0.0 and excess(0.0) > 0.0:
        low = _crossing(excess, 0.0, mean)
    top = data.largest
    reach = min(max(2.0 * mean_sd, 0.1), 1.0)
    high = mean + reach
    while high < top and excess(high) < 0.0:
        reach *= 1.5
        high += reach
    if high < top:
        high = _crossing(excess, high, mean)
    high = min(high, top)
    sides = 0.5 * (high - low) if low > 0.0 else high - mean
    return low, high, sides / _TOLD_SD


def _crossing(excess: Callable[[float], float], outside: float, inside: float) -> float:
    """Find where the profile crosses its bound; inside lies the best place."""
    return float(brentq(excess, outside, inside, xtol=_SETTLED))
