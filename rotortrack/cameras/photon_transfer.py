"""The gain as the movie itself shows it: how variance grows with the mean.

Shot noise makes the variance of a pixel `read noise + mean / gain` in counts, so the slope of
variance against mean over pixels is one over the gain, whatever the offset and the read noise.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rotortrack.cameras.camera import Number
from rotortrack.errors import GainWarning

if TYPE_CHECKING:  # cameras and movies are neighbours: neither needs the other to run
    from rotortrack.movies.movie import Movie

# Fourth differences along x and y. Shot noise is white in space, so it passes; a spot of sigma
# 1.2 px that moves, blinks or bleaches is smooth at that scale and loses all but 1e-4 of its power.
_KERNEL = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / math.sqrt(70.0)
_REACH = len(_KERNEL) // 2
# Pixels that share noise after the filter, per axis: (sum w^2)^2 / sum w^4.
_SHARED = 70.0**2 / 1810.0
_LARGEST_SIDE = 512
_BINS = 24
_FEWEST_IN_BIN = 30
_FEWEST_BINS = 4
_FEWEST_PAIRS = 8
_LEAST_RELIABILITY = 0.9
_LEAST_SIGNIFICANCE = 5.0
_CONTRADICTION = 0.2
_SIGNIFICANT_SD = 3.0


@dataclass(frozen=True)
class GainEstimate:
    """Gain by photon transfer.

    Attributes
    ----------
    gain_e_per_adu, sd
        Gain and its standard deviation, photo-electrons per count; NaN when not estimated.
    pairs
        Pairs of successive frames that were used.
    reason
        Why there is no estimate, as a sentence; None when there is one.
    """

    gain_e_per_adu: float
    sd: float
    pairs: int
    reason: str | None = None


def gain_from_movie(
    movie: Movie, *, most_pairs: int = 200, saturation_adu: float | None = None
) -> GainEstimate:
    """Estimate the gain from differences of successive frames.

    For pairs spread evenly over the movie, differences free the variance from drift and a spatial
    high-pass filter frees it from moving spots. The filtered variance at a pixel is the mean of
    its neighbours' variances with the filter's squared weights; the mean is taken with the same
    weights, so their relation stays exactly linear. Medians in bins of the mean are fitted by a
    weighted line.

    Parameters
    ----------
    movie
        Raw counts. Of large frames the central 512 x 512 pixels are used.
    most_pairs
        Largest number of pairs read; two frames are held at a time.
    saturation_adu
        Counts from which a pixel is saturated and its surroundings are left out; by default the
        largest number of an integer type.

    Returns
    -------
    GainEstimate
        With a reason instead of numbers when there are too few frames or pixels, too little range
        of the mean, or no significant slope.

    Notes
    -----
    The standard deviation is that of the line, enlarged where the bins scatter more than the
    counts explain. Photon transfer: J. R. Janesick, *Photon Transfer* (SPIE Press, 2007).
    """
    frames = movie.shape[0]
    pairs = min(most_pairs, frames // 2)
    if pairs < _FEWEST_PAIRS:
        has = f"{frames} frame" if frames == 1 else f"{frames} frames"
        return _none(pairs, f"the movie has {has}; {2 * _FEWEST_PAIRS} are needed")
    if min(movie.shape[1:]) <= 2 * _REACH:
        return _none(pairs, "the frames are smaller than the 5 x 5 pixels of the filter")
    mean, variance, pairs = _mean_and_variance(movie, pairs, saturation_adu)
    if pairs < _FEWEST_PAIRS:
        return _none(pairs, "the counts do not vary in time")
    if len(mean) < _FEWEST_BINS * _FEWEST_IN_BIN:
        return _none(pairs, "too few pixels are finite, alive and not saturated")
    if not np.median(variance) > 0:
        return _none(pairs, "hardly any count varies in time")
    noise = float(np.median(variance)) / (2 * pairs * _SHARED**2)
    if noise > (1 - _LEAST_RELIABILITY) * float(np.var(mean)):
        return _none(pairs, "all pixels are equally bright, so the variance has no range of means")
    return _fit(mean, variance, pairs)


def warn_if_contradicted(estimate: GainEstimate, given_e_per_adu: Number) -> None:
    """Warn when the movie's own slope speaks against the given gain.

    Parameters
    ----------
    estimate
        From `gain_from_movie`; without a number nothing happens.
    given_e_per_adu
        Gain in use; of a map the median is compared.

    Warns
    -----
    GainWarning
        The two differ by more than 20 % and by more than three standard deviations.
    """
    given = float(np.median(given_e_per_adu))
    difference = abs(estimate.gain_e_per_adu - given)
    if difference > _CONTRADICTION * given and difference > _SIGNIFICANT_SD * estimate.sd:
        warnings.warn(
            f"the gain is given as {given:.4g} electrons per ADU, but the movie's own variance "
            f"grows with the mean as for {estimate.gain_e_per_adu:.4g} +- {estimate.sd:.2g}: check "
            "gain_e_per_adu (is it the inverse, ADU per electron?) and whether the camera or "
            "another program changed the counts",
            GainWarning,
            stacklevel=2,
        )


def _none(pairs: int, reason: str) -> GainEstimate:
    return GainEstimate(math.nan, math.nan, pairs, f"the gain cannot be estimated: {reason}")


def _mean_and_variance(
    movie: Movie, pairs: int, saturation_adu: float | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Average mean and variance over the pairs, for each pixel whose surroundings are usable.

    Also gives how many pairs told of noise.
    """
    frames, height, width = movie.shape
    sides = [min(side, _LARGEST_SIDE) for side in (height, width)]
    top, left = (height - sides[0]) // 2, (width - sides[1]) // 2
    window = np.s_[:, top : top + sides[0], left : left + sides[1]]
    limit = saturation_adu
    if limit is None:
        limit = np.iinfo(movie.dtype).max if movie.dtype.kind in "iu" else np.inf
    total = np.zeros(sides)
    squares = np.zeros(sides)
    usable = np.ones(sides, np.bool_)
    alive = np.zeros(sides, np.bool_)
    used = 0
    # At least two apart, so that no frame serves twice and all differences are independent.
    for start in np.linspace(0, frames - 2, pairs).astype(int):
        pair = movie.frames(int(start), int(start) + 2)[window]
        if not tells_of_noise(pair):
            continue
        used += 1
        first, second = pair.astype(np.float64)
        good = np.isfinite(first) & np.isfinite(second) & (np.maximum(first, second) < limit)
        usable &= good
        alive |= first != second
        total += np.where(good, first + second, 0.0) / 2
        squares += _filtered(np.where(good, second - first, 0.0), _KERNEL) ** 2 / 2
    clean = ndimage.binary_erosion(usable & alive, np.ones((len(_KERNEL),) * 2, np.bool_))
    mean = _filtered(total, _KERNEL**2) / max(used, 1)
    return mean[clean], squares[clean] / max(used, 1), used


def tells_of_noise(pair: NDArray[Any]) -> bool:
    """Whether two frames tell of noise: neither is black, full or lost, nor the other's copy."""
    if not np.isfinite(pair).any(axis=(1, 2)).all():
        return False
    low, high = pair.min(axis=(1, 2)), pair.max(axis=(1, 2))
    return bool(np.all(low != high)) and not np.array_equal(pair[0], pair[1])


def _filtered(image: NDArray[np.float64], kernel: NDArray[np.float64]) -> NDArray[np.float64]:
    along_y: NDArray[np.float64] = ndimage.convolve1d(image, kernel, axis=0)
    along_x: NDArray[np.float64] = ndimage.convolve1d(along_y, kernel, axis=1)
    return along_x


def _fit(mean: NDArray[np.float64], variance: NDArray[np.float64], pairs: int) -> GainEstimate:
    """Fit a line to medians of the variance in bins of equal width of the mean."""
    low, high = np.quantile(mean, [0.002, 0.998])
    edges = np.linspace(low, high, _BINS + 1)
    place = np.searchsorted(edges, mean, side="right") - 1
    chosen = [np.flatnonzero(place == number) for number in range(_BINS)]
    chosen = [members for members in chosen if len(members) >= _FEWEST_IN_BIN]
    if len(chosen) < _FEWEST_BINS:
        return _none(pairs, "too few pixels differ in brightness")
    x = np.array([mean[members].mean() for members in chosen])
    # The median of a chi-squared mean of n squares lies below 1 by this factor (Wilson-Hilferty).
    below = (1 - 2 / (9 * pairs)) ** 3
    y = np.array([np.median(variance[members]) for members in chosen]) / below
    independent = np.array([len(members) for members in chosen]) / _SHARED**2
    # A median scatters sqrt(pi / 2) times as much as a mean.
    sd = y * np.sqrt(2 / pairs * (math.pi / 2) / independent)
    design = np.stack([np.ones_like(x), x], axis=1) / sd[:, np.newaxis]
    inverse = np.linalg.inv(design.T @ design)
    line = inverse @ (design.T @ (y / sd))
    excess = float(np.sum((y / sd - design @ line) ** 2)) / (len(x) - 2)
    slope, slope_sd = float(line[1]), math.sqrt(inverse[1, 1] * max(1.0, excess))
    if slope < _LEAST_SIGNIFICANCE * slope_sd:
        return _none(pairs, "the variance does not grow significantly with the mean")
    return GainEstimate(1 / slope, slope_sd / slope**2, pairs)
