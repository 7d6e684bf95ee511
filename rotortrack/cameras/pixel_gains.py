"""The gain of every pixel by photon transfer, drawn towards its column, row and sensor as it must.

A variance from n frames is known to sqrt(2 / n), so a pixel's own gain from 2000 frames scatters by
3 % where pixels truly differ by 1 %. How far they differ shows all the same, as what the scatter
has above its own error, and that says how much of each pixel's deviation to believe.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.film_statistics import Floats

Mask = NDArray[np.bool_]

_CERTAIN_SD = 3.0
_FAR_SD = 6.0
_NORMAL_MAD = 1.4826


@dataclass(frozen=True)
class Level:
    """One point of the photon transfer of every pixel.

    Attributes
    ----------
    signal, variance
        (y, x) mean above the dark film (ADU), 0 for the dark film itself, and variance (ADU^2).
    freedom
        Degrees of freedom of the variance.
    usable
        (y, x) pixels for which it counts.
    """

    signal: NDArray[np.floating]
    variance: NDArray[np.floating]
    freedom: float
    usable: Mask


@dataclass(frozen=True)
class PixelGains:
    """Gains, and how they came about.

    Attributes
    ----------
    gain_e_per_adu, sd
        (y, x) photo-electrons per count and standard error, what was drawn together included.
    mean_e_per_adu, mean_sd
        The gain of all pixels together and its standard error.
    own_error
        Median standard error of one pixel's own gain, relative.
    pixel_spread, column_spread, row_spread
        By how much the gains of pixels, columns and rows truly differ (standard deviation,
        relative); 0 where that cannot be told from their errors.
    own_weight
        Median share of a pixel's own deviation that was believed, 0 to 1.
    pixels
        How many pixels had a gain of their own.
    """

    gain_e_per_adu: Floats
    sd: Floats
    mean_e_per_adu: float
    mean_sd: float
    own_error: float
    pixel_spread: float
    column_spread: float
    row_spread: float
    own_weight: float
    pixels: int


def mean_slope(level: Level, dark: Level, among: Mask) -> tuple[float, float]:
    """Give variance over signal (ADU per electron) of all pixels together, and its standard error.

    Parameters
    ----------
    level, dark
        A flat and the dark film.
    among
        Pixels that count where the level has them.
    """
    chosen = among & level.usable
    if not chosen.any():
        return math.nan, math.inf
    signal = float(np.sum(level.signal[chosen], dtype=np.float64))
    above = level.variance[chosen].astype(np.float64) - dark.variance[chosen]
    slope = float(above.sum()) / signal
    spread = _error2(level, dark, max(slope, 0.0)) + _error2(dark, dark, 0.0)
    return slope, math.sqrt(float(spread[chosen].sum())) / signal


def pixel_gains(levels: Sequence[Level], dark: Level, slope: float, among: Mask) -> PixelGains:
    """Fit a line through dark film and flats in every pixel, and draw the gains together.

    The line of variance against signal is fitted by weighted least squares; the weights follow the
    variance that is expected, since those by the variance found would favour what is low by chance.
    Deviations of columns, rows and pixels from the gain of all are then multiplied by
    ``T^2 / (T^2 + e^2)``, with e their error and T the true spread (empirical Bayes).

    Parameters
    ----------
    levels, dark
        Flats and the dark film.
    slope
        Counts per electron of all pixels together.
    among
        Pixels whose spread tells that of the sensor; the others are drawn together all the same.

    Notes
    -----
    Photon transfer per pixel: F. Huang et al., *Nature Methods* 10, 653 (2013). Spread by moments:
    R. DerSimonian and N. Laird, *Controlled Clinical Trials* 7, 177 (1986).
    """
    own, error2 = _lines(levels, dark, slope)
    own, error2 = own / slope, error2 / slope**2
    known = among & np.isfinite(error2)
    weights = np.where(known, 1 / error2, 0.0)
    mean = float(np.average(own[known], weights=weights[known]))
    # Errors were those of the slope that was expected; relative to the one that was found:
    error2 /= mean**2
    deviation = np.where(np.isfinite(error2), own / mean - 1, 0.0)
    far = np.abs(deviation) > _FAR_SD * np.maximum(
        np.sqrt(error2), _NORMAL_MAD * float(np.median(np.abs(deviation[known])))
    )
    shared = np.zeros_like(deviation)
    shared_error2 = np.zeros_like(deviation)
    weights = np.where(known & ~far, 1 / error2, 0.0)
    spreads = {}
    for name, axis in (("column", 0), ("row", 1)):
        moved, moved_error2, spread = _lines_apart(deviation - shared, weights, axis)
        shared = shared + moved
        shared_error2 = shared_error2 + moved_error2
        spreads[name] = spread
    rest = deviation - shared
    spread2, most2 = _spread2(rest[weights > 0], error2[weights > 0])
    believed = spread2 / (spread2 + error2)
    relative = mean * (1 + shared + believed * rest)
    left2 = most2 / (1 + most2 / error2)
    mean_sd = mean / math.sqrt(float(np.sum(1 / error2[known])))
    gain = 1 / (slope * np.maximum(relative, 0.1))
    return PixelGains(
        gain_e_per_adu=gain,
        sd=gain * np.sqrt(left2 + shared_error2 + (mean_sd / mean) ** 2),
        mean_e_per_adu=1 / (slope * mean),
        mean_sd=mean_sd / (slope * mean**2),
        own_error=math.sqrt(float(np.median(error2[known]))),
        pixel_spread=math.sqrt(spread2),
        column_spread=spreads["column"],
        row_spread=spreads["row"],
        own_weight=float(np.median(believed[known])),
        pixels=int(known.sum()),
    )


def _error2(level: Level, dark: Level, slope: float) -> Floats:
    """Give the square of the standard error of a level's variance, as expected from its signal.

    That of a normal variance and the excess of Poisson's fourth moment.
    """
    shot = slope * np.maximum(level.signal, 0.0).astype(np.float64)
    # A constant pixel still has the noise of rounding, which keeps its weight finite.
    expected = np.maximum(dark.variance, 1 / 12) + shot
    error2: Floats = (2 * expected**2 + slope**2 * shot) / level.freedom
    return error2


def _lines(levels: Sequence[Level], dark: Level, slope: float) -> tuple[Floats, Floats]:
    """Fit variance against signal; give slopes and their squared errors, infinite where unknown."""
    size = dark.variance.shape
    s0, sx, sy, sxx, sxy = (np.zeros(size) for _ in range(5))
    for level in (dark, *levels):
        weight = np.where(level.usable, 1 / _error2(level, dark, slope), 0.0)
        x = np.where(level.usable, level.signal, 0.0).astype(np.float64)
        y = np.where(level.usable, level.variance, 0.0).astype(np.float64)
        s0 += weight
        sx += weight * x
        sy += weight * y
        sxx += weight * x * x
        sxy += weight * x * y
    determinant = s0 * sxx - sx * sx
    solved = determinant > 1e-12 * s0 * sxx
    safe = np.where(solved, determinant, 1.0)
    return (
        np.where(solved, (s0 * sxy - sx * sy) / safe, slope),
        np.where(solved, s0 / safe, np.inf),
    )


def _lines_apart(values: Floats, weights: Floats, axis: int) -> tuple[Floats, Floats, float]:
    """Give what is believed of the deviation of whole columns (axis 0) or rows (axis 1).

    Also the square of its error, and how far columns or rows truly differ.
    """
    total = weights.sum(axis=axis, keepdims=True)
    known = total > 0
    safe = np.where(known, total, 1.0)
    mean = (weights * values).sum(axis=axis, keepdims=True) / safe
    # The scatter within the line holds the pixels' errors and how they differ.
    within = (weights * (values - mean) ** 2).sum(axis=axis, keepdims=True)
    count = (weights > 0).sum(axis=axis, keepdims=True)
    known &= count > 1
    inflation = np.sum(within[known]) / max(1.0, float(np.sum(count[known] - 1)))
    error2 = np.where(known, inflation / safe, np.inf)
    if known.sum() < 2:
        return np.zeros_like(mean), np.zeros_like(mean), 0.0
    spread2, most2 = _spread2(mean[known], error2[known])
    believed = spread2 / (spread2 + error2)
    left2 = most2 / (1 + most2 / error2)
    return np.where(known, believed * mean, 0.0), left2, math.sqrt(spread2)


def _spread2(values: Floats, error2: Floats) -> tuple[float, float]:
    """Give the true variance of values beyond that of their errors, 0 unless it is certain.

    Also the most that it may be: two standard errors above where it is not certain.
    """
    if len(values) < 2:
        return 0.0, 0.0
    weights = 1 / error2
    weights = weights / weights.sum()
    excess = float(np.sum(weights * ((values - np.sum(weights * values)) ** 2 - error2)))
    excess += float(np.sum(weights**2 * error2))
    error = math.sqrt(2 * float(np.sum(weights**2 * (error2 + max(excess, 0.0)) ** 2)))
    null_error = math.sqrt(2 * float(np.sum(weights**2 * error2**2)))
    if excess > _CERTAIN_SD * null_error:
        return excess, excess
    return 0.0, max(excess, 0.0) + 2 * error
