"""What the counts show of a camera: saturated and dead pixels, frames without a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:  # cameras and movies are neighbours: neither needs the other to run
    from rotortrack.movies.movie import Movie

MOST_BYTES = 4_000_000_000
"""Bytes of counts that are looked at; a longer movie is sampled evenly."""

_BLOCK_BYTES = 8_000_000
_FEWEST_FRAMES = 8
CONVERTER_BITS = (8, 10, 11, 12, 14)


@dataclass(frozen=True)
class PixelCheck:
    """What was seen in the counts.

    Attributes
    ----------
    frames
        How many frames were looked at.
    least_adu, largest_adu
        Range of the finite counts; NaN where there is none.
    saturation_adu
        Counts from which a pixel was taken as saturated; None where nothing tells.
    saturated_pixels, saturated_frames
        Counts that reached it, summed over frames, and frames with at least one.
    missing_pixels
        Counts that are no finite number, summed over frames.
    zero_frames, constant_frames
        Frames in which all pixels are 0, or have another value in common; in numbers of the whole
        recording.
    dead_rows, dead_columns
        Rows and columns of the sensor in which no pixel ever changes; empty when fewer than 8
        frames have a picture.
    dead_pixels
        Pixels that never change, those of dead rows and columns included.
    """

    frames: int
    least_adu: float
    largest_adu: float
    saturation_adu: float | None
    saturated_pixels: int
    saturated_frames: int
    missing_pixels: int
    zero_frames: tuple[int, ...]
    constant_frames: tuple[int, ...]
    dead_rows: tuple[int, ...]
    dead_columns: tuple[int, ...]
    dead_pixels: int

    @property
    def looks_like_bits(self) -> int | None:
        """Depth of a converter of which the largest count is exactly the end; None if of none."""
        return next((b for b in CONVERTER_BITS if self.largest_adu == 2**b - 1), None)


def check_pixels(
    movie: Movie,
    *,
    saturation_adu: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> PixelCheck:
    """Look at the counts of a movie for what no later step can repair.

    Parameters
    ----------
    movie
        Raw counts. Of more than 4 GB of counts evenly spread frames are looked at.
    saturation_adu
        Counts from which a pixel is saturated; by default the largest of an integer type.
    progress
        Called with frames done and frames in all.

    Notes
    -----
    Costs one reading of the movie and some 0.2 s for 1 GB of counts.
    """
    frame_bytes = movie.shape[1] * movie.shape[2] * movie.dtype.itemsize
    chosen = _spread(movie.shape[0], max(1, MOST_BYTES // frame_bytes))
    limit = saturation_adu
    if limit is None and movie.dtype.kind in "iu":
        limit = float(np.iinfo(movie.dtype).max)
    seen = _Seen(movie, limit)
    block = max(1, _BLOCK_BYTES // frame_bytes)
    for start in range(0, len(chosen), block):
        indices = chosen[start : start + block]
        seen.look(indices, _read(movie, indices))
        if progress is not None:
            progress(start + len(indices), len(chosen))
    return seen.check(len(chosen))


def _spread(frames: int, most: int) -> NDArray[np.int64]:
    if frames <= most:
        return np.arange(frames)
    return np.linspace(0, frames - 1, most).astype(np.int64)


def _read(movie: Movie, indices: NDArray[np.int64]) -> NDArray[Any]:
    first, last = int(indices[0]), int(indices[-1])
    if last - first + 1 == len(indices):
        return movie.frames(first, last + 1)
    return np.concatenate([movie.frames(int(index), int(index) + 1) for index in indices])


class _Seen:
    """What was seen so far, block after block."""

    def __init__(self, movie: Movie, limit: float | None) -> None:
        self._limit = limit
        self._first_frame = movie.first_frame
        self._left, self._top = movie.origin_px
        self._lowest = np.full(movie.shape[1:], np.inf)
        self._highest = np.full(movie.shape[1:], -np.inf)
        self._range = (np.inf, -np.inf)
        self._pictures = 0
        self._saturated = [0, 0]
        self._missing = 0
        self._zero: list[int] = []
        self._constant: list[int] = []

    def look(self, indices: NDArray[np.int64], block: NDArray[Any]) -> None:
        if block.dtype.kind == "f":
            missing = ~np.isfinite(block)
            self._missing += int(missing.sum())
            low, high = np.where(missing, np.inf, block), np.where(missing, -np.inf, block)
        else:
            low = high = block
        least, most = low.min(axis=(1, 2)), high.max(axis=(1, 2))
        # A frame without any number is neither: its least is above its most.
        same = least == most
        numbers = indices + self._first_frame
        self._zero += numbers[same & (most == 0)].tolist()
        self._constant += numbers[same & (most != 0)].tolist()
        self._range = (
            min(self._range[0], float(least.min())),
            max(self._range[1], float(most.max())),
        )
        self._saturate(high, most)
        if same.any():
            low, high = low[~same], high[~same]
        self._pictures += len(low)
        if len(low):
            np.minimum(self._lowest, low.min(axis=0), out=self._lowest)
            np.maximum(self._highest, high.max(axis=0), out=self._highest)

    def _saturate(self, high: NDArray[Any], most: NDArray[Any]) -> None:
        if self._limit is not None and (reaching := most >= self._limit).any():
            self._saturated[0] += int((high[reaching] >= self._limit).sum())
            self._saturated[1] += int(reaching.sum())

    def check(self, frames: int) -> PixelCheck:
        still = np.zeros(self._lowest.shape, np.bool_)
        if self._pictures >= _FEWEST_FRAMES:
            still = self._lowest >= self._highest
        least, largest = self._range if self._range[0] <= self._range[1] else (np.nan, np.nan)
        return PixelCheck(
            frames=frames,
            least_adu=least,
            largest_adu=largest,
            saturation_adu=self._limit,
            saturated_pixels=self._saturated[0],
            saturated_frames=self._saturated[1],
            missing_pixels=self._missing,
            zero_frames=tuple(self._zero),
            constant_frames=tuple(self._constant),
            dead_rows=tuple((np.flatnonzero(still.all(axis=1)) + self._top).tolist()),
            dead_columns=tuple((np.flatnonzero(still.all(axis=0)) + self._left).tolist()),
            dead_pixels=int(still.sum()),
        )
