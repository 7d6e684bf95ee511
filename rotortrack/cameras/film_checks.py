"""Whether films are what a calibration takes them for: dark, lit, long enough, not saturated."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.film_statistics import FilmStatistics, Floats
from rotortrack.cameras.pixel_gains import Mask
from rotortrack.cameras.pixels import CONVERTER_BITS
from rotortrack.errors import CalibrationWarning, CameraError

FEWEST_DARK_FRAMES = 20
FEWEST_FLAT_FRAMES = 10

_ENOUGH_DARK_FRAMES = 100
_BLOCK = 32
_COARSEST = 16
_CERTAIN_SD = 5.0
_AT_THE_END = 10
_MOST_NOISE_E = 15.0
_MOST_HOT = 0.05
_UNSTEADY = 0.5
_WANDERING = 1.1
_MIXED = 1.5


def typical(values: NDArray[Any], among: Mask) -> float:
    """Give the median of a map over some pixels; NaN where there are none."""
    chosen = values[among]
    return float(np.median(chosen)) if chosen.size else math.nan


def most(film: FilmStatistics) -> float:
    """Give the largest count that the number type of a film can hold."""
    dtype = film.largest.dtype
    return float(np.iinfo(dtype).max) if dtype.kind in "iu" else math.inf


def saturation(
    dark: FilmStatistics, flats: Sequence[FilmStatistics], given_adu: float | None
) -> float:
    """Give the count from which a pixel is saturated.

    What was given; or the last count of a converter, where ten pixels reached it and none went
    beyond; or the largest that the number type can hold.
    """
    if given_adu is not None:
        return given_adu
    for film in flats:
        end = float(np.max(film.largest, initial=0))
        is_end = any(end == 2**bits - 1 for bits in CONVERTER_BITS)
        if is_end and np.count_nonzero(film.largest == end) >= _AT_THE_END:
            others = max(float(other.largest.max()) for other in (dark, *flats))
            if others <= end:
                return end
    return min(most(film) for film in (dark, *flats))


def check_dark(dark: FilmStatistics) -> None:
    """Refuse a dark film that is too short; warn where it is short or not steady.

    Raises
    ------
    CameraError
        Says how many frames are needed.

    Warns
    -----
    CalibrationWarning
        The noise is known badly, or the level or the pattern of the offsets changes.
    """
    frames = dark.frames
    if frames < FEWEST_DARK_FRAMES:
        raise CameraError(
            f"the dark film has {frames} usable frames: give at least {FEWEST_DARK_FRAMES}; "
            f"{_ENOUGH_DARK_FRAMES} tell a pixel's read noise to 7 %, 1000 to 2 %"
        )
    if frames < _ENOUGH_DARK_FRAMES:
        _warn(
            f"{frames} dark frames tell a pixel's read noise to {1 / math.sqrt(2 * frames - 2):.0%}"
            f": {_ENOUGH_DARK_FRAMES} tell it to 7 %, 1000 to 2 %"
        )
    alive = np.isfinite(dark.mean)
    noise_adu = math.sqrt(typical(dark.variance, alive))
    wander_adu = float(dark.levels.std())
    if wander_adu > _UNSTEADY * noise_adu:
        _warn(
            f"the level of the dark film moves between {dark.levels.min():.5g} and "
            f"{dark.levels.max():.5g} ADU (a pixel's own noise is {noise_adu:.2g}): see that no "
            "light reaches the camera and that it has warmed up; the offset is a mean"
        )
    whole, successive = (typical(values, alive) for values in (dark.variance, dark.successive))
    if whole > _WANDERING * successive:
        _warn(
            f"the offsets of the dark film wander: over the film their variance is "
            f"{whole / successive - 1:.0%} above that from frame to frame, and counts as read "
            "noise: let the camera warm up and film again"
        )


def check_size(name: str, film: FilmStatistics, dark: FilmStatistics) -> None:
    """Refuse a flat of another size than the dark film.

    Raises
    ------
    CameraError
        Names both sizes.
    """
    if film.mean.shape != dark.mean.shape:
        (high, wide), (height, width) = film.mean.shape, dark.mean.shape
        raise CameraError(
            f"{name} has frames of {wide} x {high} pixels, the dark film of {width} x {height} "
            "(width x height): take all films with one region of the sensor"
        )


def check_flat(name: str, film: FilmStatistics, dark: FilmStatistics, among: Mask) -> None:
    """Refuse a flat that is too short or not lit; warn where the light was changed.

    Raises
    ------
    CameraError
        Names the film.

    Warns
    -----
    CalibrationWarning
        The film holds several brightnesses.
    """
    if film.frames < FEWEST_FLAT_FRAMES:
        raise CameraError(
            f"{name} has {film.frames} usable frames: give at least {FEWEST_FLAT_FRAMES}; the gain "
            "of the sensor needs no more, that of each pixel thousands"
        )
    signal = typical(film.mean - dark.mean, among)
    noise = math.sqrt(typical(dark.variance, among))
    if not signal > noise:
        raise CameraError(
            f"{name} is {typical(film.mean, among):.5g} ADU bright and the dark film "
            f"{typical(dark.mean, among):.5g} (medians; noise {noise:.2g}): give the dark film "
            "first and behind it films of clearly more light"
        )
    if film.levels.min() * _MIXED < film.levels.max():
        _warn(
            f"the light on {name} changes from {film.levels.min():.4g} to {film.levels.max():.4g} "
            "ADU above the dark level: its mean is used; give one film for each brightness"
        )


def warn_of_light(dark: FilmStatistics, among: Mask, slope_adu_per_e: float) -> None:
    """Warn when the dark film is brighter where it is noisier, as light is and offsets are not.

    Parameters
    ----------
    dark
        The dark film.
    among
        Pixels that count.
    slope_adu_per_e
        By how much the variance of light grows with its mean.

    Warns
    -----
    CalibrationWarning
        With the counts between the dim and the bright parts.
    """
    level = _medians(np.where(among, dark.mean, np.nan))
    noise = _medians(np.where(among, dark.variance, np.nan))
    known = np.isfinite(level) & np.isfinite(noise)
    x, y = level[known], noise[known]
    if x.size < _COARSEST // 2 or not np.ptp(x) > 0:
        return
    x = x - x.mean()
    found = float(x @ y / (x @ x))
    rest = y - y.mean() - found * x
    error = math.sqrt(float(rest @ rest) / (x.size - 2) / float(x @ x))
    low, high = np.quantile(x, [0.05, 0.95])
    shot = found * (high - low)
    if (
        found > _CERTAIN_SD * error
        and 0.5 < found / slope_adu_per_e < 2.0
        and shot > 0.1 * np.median(y)
    ):
        _warn(
            f"the dark film is {high - low:.3g} ADU brighter in some parts than in others, and "
            "noisier there as light is: close the shutter and film again"
        )


def warn_of_noise(read_noise_e: Floats, hot: Mask) -> None:
    """Warn when the read noise is none that scientific cameras have.

    Warns
    -----
    CalibrationWarning
        Its median is above 15 electrons, or more than one pixel in 20 is hot.
    """
    median = float(np.median(read_noise_e))
    if median > _MOST_NOISE_E:
        _warn(
            f"the read noise of the median pixel is {median:.3g} electrons, more than that of "
            "cameras for single molecules: see that the dark film is dark and the gain is right"
        )
    if hot.mean() > _MOST_HOT:
        _warn(
            f"{hot.mean():.0%} of the pixels are hot: see that the dark film is dark and shows "
            "nothing that moves"
        )


def surroundings(values: NDArray[Any]) -> Floats:
    """Give for every pixel the median of the block of some 32 x 32 pixels that it lies in."""
    rows, columns = (_cuts(side) for side in values.shape)
    medians = _medians(values)
    return np.repeat(np.repeat(medians, np.diff(rows), axis=0), np.diff(columns), axis=1)


def _medians(values: NDArray[Any]) -> Floats:
    """Give the medians of blocks; NaN where a block has no number."""
    rows, columns = (_cuts(side) for side in values.shape)
    medians = np.full((len(rows) - 1, len(columns) - 1), np.nan)
    for i in range(len(rows) - 1):
        for j in range(len(columns) - 1):
            block = values[rows[i] : rows[i + 1], columns[j] : columns[j + 1]]
            finite = block[np.isfinite(block)]
            if finite.size:
                medians[i, j] = np.median(finite)
    return medians


def _cuts(side: int) -> NDArray[np.int64]:
    """Cut a side into blocks, small frames into smaller ones."""
    blocks = max(1, round(side / min(_BLOCK, max(4, side // 4))))
    return np.linspace(0, side, blocks + 1).astype(np.int64)


def _warn(sentence: str) -> None:
    warnings.warn(sentence, CalibrationWarning, stacklevel=4)
