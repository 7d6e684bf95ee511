"""Noise that whole columns or rows share, as fast read-out modes of sCMOS cameras add it.

An offset drawn anew for each column and frame is common to all rows of the column, while the noise
of pixels is not: so the product of what two groups of rows say about one column is, on average,
the variance of the offset, however noisy the pixels are.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.photon_transfer import tells_of_noise
from rotortrack.errors import LineNoiseWarning

if TYPE_CHECKING:  # cameras and movies are neighbours: neither needs the other to run
    from rotortrack.movies.movie import Movie

Axis = Literal["column", "row"]

MOST_PAIRS = 60
_FEWEST_PAIRS = 8
_LARGEST_SIDE = 128
_SMALLEST_SIDE = 32
# Rows left out between bands, so that no spot lies in two of them: it reaches some 4 px.
_GAP = 8
_LARGEST_COUNT = 1e12
"""No camera counts as far; the squares of larger numbers would overflow."""
_CLIP = 1.5
_CLIPPED_VARIANCE = 0.7784652
"""Variance of a standard normal number clipped at 1.5."""
_STEPS = 3
_BLOCK = 8
_LEAST_SIGNIFICANCE = 5.0
_LEAST_SHARE = 0.1


@dataclass(frozen=True)
class LineNoise:
    """Noise that a column's or a row's pixels share within a frame.

    Attributes
    ----------
    axis
        Which lines of the frame share it.
    rms_adu, sd_adu
        Its rms and the standard error of that, counts; 0 where none is seen, NaN where it cannot
        be estimated.
    pixel_adu
        Noise of one pixel from frame to frame, counts rms, which the shared noise comes on top of.
    significance
        Variance of the shared noise over its own standard error.
    reason
        Why there is no estimate, as a sentence; None when there is one.
    """

    axis: Axis
    rms_adu: float
    sd_adu: float
    pixel_adu: float
    significance: float
    reason: str | None = None

    @property
    def matters(self) -> bool:
        """Whether it is certain and above 10 % of a pixel's own noise."""
        return (
            self.significance > _LEAST_SIGNIFICANCE and self.rms_adu > _LEAST_SHARE * self.pixel_adu
        )

    def sentence(self, gain_e_per_adu: float | None = None) -> str:
        """Say what was found, in electrons too where the gain is known."""
        if self.reason is not None:
            return self.reason
        electrons = f" ({self.rms_adu * gain_e_per_adu:.2g} electrons)" if gain_e_per_adu else ""
        return (
            f"{self.axis} noise of {self.rms_adu:.2g} +- {self.sd_adu:.1g} counts rms{electrons}, "
            f"beside {self.pixel_adu:.2g} of a pixel"
        )


def line_noise(movie: Movie, *, most_pairs: int = MOST_PAIRS) -> tuple[LineNoise, LineNoise]:
    """Estimate the noise shared by columns and by rows.

    For pairs of successive frames spread evenly over the movie, robust means of their difference
    along each line, in four bands with gaps between them, are freed of what is smooth across lines
    by second differences; products of neighbouring bands average to the shared variance.

    Parameters
    ----------
    movie
        Raw counts. Of large frames the central 128 x 128 pixels.
    most_pairs
        Largest number of pairs read.

    Returns
    -------
    LineNoise, LineNoise
        Of columns and of rows, each with a reason instead of numbers where frames are too few or
        too small.

    Notes
    -----
    Differences of successive frames are blind to stage drift and bleaching, and to an offset that
    stays: that belongs to the camera's offset map. Bands lie in both halves of the frame, so that
    sensors that read their halves through separate converters are judged alike. The standard error
    is the larger one of those from frame to frame and from line to line.

    Costs the reading of 120 frames and at most some 40 ms of computing.
    """
    frames, height, width = movie.shape
    pairs = min(most_pairs, frames // 2)
    if pairs < _FEWEST_PAIRS:
        has = f"{frames} frame" if frames == 1 else f"{frames} frames"
        return _both(f"the movie has {has}; {2 * _FEWEST_PAIRS} are needed")
    if min(height, width) < _SMALLEST_SIDE:
        return _both(
            f"the frames of {width} x {height} pixels are smaller than {_SMALLEST_SIDE} x "
            f"{_SMALLEST_SIDE}"
        )
    rows, columns = (_middle(side) for side in (height, width))
    # At least two apart, so that no frame serves twice and all differences are independent.
    starts = np.linspace(0, frames - 2, pairs).astype(int)
    windows = (movie.frames(int(start), int(start) + 2)[:, rows, columns] for start in starts)
    telling = [_difference(pair) for pair in windows if tells_of_noise(pair)]
    if len(telling) < _FEWEST_PAIRS:
        return _both("the counts do not vary in time")
    differences = np.stack(telling)
    return _estimate(differences, "column"), _estimate(differences.swapaxes(1, 2), "row")


def check_line_noise(
    movie: Movie, gain_e_per_adu: float | None = None
) -> tuple[LineNoise, LineNoise]:
    """Warn when columns or rows share noise that matters.

    Parameters
    ----------
    movie
        Raw counts.
    gain_e_per_adu
        To name the noise in electrons too.

    Warns
    -----
    LineNoiseWarning
        The shared noise is certain (five standard errors) and above 10 % of a pixel's own.

    Returns
    -------
    LineNoise, LineNoise
        As :func:`line_noise`, whose cost this is.
    """
    found = line_noise(movie)
    for noise in found:
        if noise.matters:
            warnings.warn(
                f"{noise.sentence(gain_e_per_adu)}: the camera adds an offset to each whole "
                f"{noise.axis} anew in every frame, as fast read-out modes do, so positions "
                "scatter more than their error bars say: film in a slower mode where you can",
                LineNoiseWarning,
                stacklevel=2,
            )
    return found


def _both(reason: str) -> tuple[LineNoise, LineNoise]:
    return _none("column", reason), _none("row", reason)


def _none(axis: Axis, reason: str) -> LineNoise:
    nan = math.nan
    return LineNoise(axis, nan, nan, nan, nan, f"{axis} noise cannot be estimated: {reason}")


def _middle(side: int) -> slice:
    used = min(side, _LARGEST_SIDE)
    return slice((side - used) // 2, (side + used) // 2)


def _difference(pair: NDArray[Any]) -> NDArray[np.float32]:
    """Subtract two frames; what is no number becomes 0, no difference."""
    with np.errstate(invalid="ignore", over="ignore"):
        difference: NDArray[np.float32] = np.subtract(
            pair[1], pair[0], dtype=np.float32, casting="unsafe"
        )
        return np.where(np.abs(difference) < _LARGEST_COUNT, difference, np.float32(0))


def _estimate(differences: NDArray[np.float32], axis: Axis) -> LineNoise:
    """Estimate the noise shared along axis 1 of differences (pair, along, across)."""
    differences = differences - differences.mean(axis=(1, 2), keepdims=True)
    scale = _scale(differences)
    first, second, third, fourth = (
        _across(_location(differences[:, band], scale)) for band in _bands(differences.shape[1])
    )
    # A difference of two frames has twice the variance of one.
    products = (first * second + third * fourth) / 4
    variance = float(products.mean())
    error = max(_standard_error(products.mean(axis=1)), _standard_error(_blocks(products)))
    if error == 0:
        return _none(axis, "hardly any count varies in time")
    rms = math.sqrt(max(variance, 0.0))
    sd = error / (2 * rms) if rms**2 > error else math.sqrt(error)
    return LineNoise(axis, rms, sd, scale / math.sqrt(2), variance / error)


def _bands(length: int) -> list[slice]:
    """Cut a line into four bands with gaps between them."""
    gap = min(_GAP, length // 8)
    size = (length - 3 * gap) // 4
    return [slice(start, start + size) for start in (i * (size + gap) for i in range(4))]


def _scale(differences: NDArray[np.float32]) -> float:
    """Give the standard deviation of the many pixels without spots (Huber's proposal 2)."""
    some = differences.reshape(-1)[:: max(1, differences.size // 100_000)].astype(np.float64)
    scale = float(some.std())
    for _ in range(12):
        limit = _CLIP * scale
        scale = math.sqrt(np.mean(np.clip(some, -limit, limit) ** 2) / _CLIPPED_VARIANCE)
    return scale


def _location(differences: NDArray[np.float32], scale: float) -> NDArray[np.float64]:
    """Give Huber's robust mean along axis 1.

    Unlike a median it moves in proportion to an offset also where noise is below one count.
    """
    limit = np.float32(_CLIP * scale)
    centre = np.zeros((differences.shape[0], 1, differences.shape[2]), np.float32)
    least = (differences.shape[1] + 1) // 2
    for _ in range(_STEPS):
        residual = differences - centre
        np.clip(residual, -limit, limit, out=residual)
        within = np.count_nonzero(np.abs(residual) < limit, axis=1, keepdims=True)
        # Newton's step, held back where so few are within the limit that it would overshoot.
        centre += residual.sum(axis=1, keepdims=True) / np.maximum(within, least)
    return centre[:, 0].astype(np.float64)


def _across(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take second differences across lines, scaled so that white noise keeps its variance.

    What is smooth over the frame, as flicker of uneven light or a drifting background, is lost.
    """
    curved = lines[:, 2:] - 2 * lines[:, 1:-1] + lines[:, :-2]
    return curved / math.sqrt(6.0)


def _blocks(products: NDArray[np.float64]) -> NDArray[np.float64]:
    """Average over blocks of neighbouring lines, which second differences make dependent."""
    starts = np.arange(0, products.shape[1] - _BLOCK + 1, _BLOCK)
    by_line = products.mean(axis=0)
    return np.array([by_line[start : start + _BLOCK].mean() for start in starts])


def _standard_error(values: NDArray[np.float64]) -> float:
    return float(values.std(ddof=1)) / math.sqrt(len(values))
