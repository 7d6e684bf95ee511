"""Mean and variance of every pixel over a film of steady light, or of none.

Lamps flicker and offsets wander. The light of a flat is taken as one pattern times the level of
each frame, an offset's drift as one number added to each frame: both are fitted and only what they
leave is noise. What is left of slower changes of the pattern shows as a variance above that of
successive frames.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import CameraError
from rotortrack.kernels import kernel

Map = NDArray[np.float32]
Floats = NDArray[np.float64]

_CHUNK: Final = 512
"""Pixels whose sums stay in the nearest cache while the frames of a block pass."""

_D, _DD, _AD, _EE, _BE = range(5)


@dataclass(frozen=True)
class FilmStatistics:
    """What a film tells of every pixel.

    Attributes
    ----------
    frames, skipped
        Frames used, and those left out: black, full or lost ones, and copies of the one before.
    mean, variance
        (y, x) mean count (ADU) and variance (ADU^2) over frames, each freed of what all pixels
        share: the level of a flat, the wandering offset of a dark film. NaN where the film has no
        number.
    successive
        (y, x) variance by differences of successive frames, blind to slow changes (ADU^2).
    largest, constant
        (y, x) largest count, and whether it never was another one.
    levels
        Mean of each used frame over pixels, for flats above the offset (ADU).
    """

    frames: int
    skipped: int
    mean: Map
    variance: Map
    successive: Map
    largest: NDArray[Any]
    constant: NDArray[np.bool_]
    levels: Floats


def film_statistics(
    blocks: Iterable[NDArray[Any]], *, offset_adu: NDArray[np.floating[Any]] | None = None
) -> FilmStatistics:
    """Sum up a film block by block; the memory does not grow with its length.

    Without an offset the film is a dark one and `x_t = o + m_t + noise`, with `m_t` the mean of all
    pixels in frame t. With an offset it is a flat and `x_t - o = a_t f + noise`, with `a_t` the
    mean of all pixels in frame t above the offset and f fitted by least squares.

    Parameters
    ----------
    blocks
        Frames in order, each block (frame, y, x); how they are cut changes no bit of the result.
    offset_adu
        (y, x) offset of every pixel.

    Raises
    ------
    CameraError
        Fewer than three frames can be used, or a flat is no brighter than the offset.

    Notes
    -----
    Counts of up to 16 bits and the first frame that is subtracted from them are whole numbers; sums
    are float64. Costs some 2 ns a pixel and frame.
    """
    sums: _Sums | None = None
    for block in blocks:
        if not len(block):
            continue
        if sums is None:
            sums = _Sums(block, offset_adu)
        sums.add(block)
    if sums is None:
        raise CameraError("a film without frames tells nothing of a camera: give one with frames")
    return sums.statistics()


class _Sums:
    """Sums over the frames so far."""

    def __init__(self, block: NDArray[Any], offset_adu: NDArray[np.floating[Any]] | None) -> None:
        self._size = block.shape[1:]
        pixels = block[0].size
        self._is_flat = offset_adu is not None
        start = block[0] if offset_adu is None else offset_adu
        self._reference = np.nan_to_num(
            np.asarray(start, np.float64).ravel(), posinf=0.0, neginf=0.0
        )
        self._reference_mean = float(self._reference.mean())
        self._sums = np.zeros((5, pixels))
        self._last = np.zeros(pixels)
        self._last_frame: NDArray[Any] | None = None
        self._largest = np.full(pixels, _limit(block.dtype, "min"), block.dtype)
        self._smallest = np.full(pixels, _limit(block.dtype, "max"), block.dtype)
        self._lost = np.zeros(pixels, np.bool_)
        self._levels: list[float] = []
        self._skipped = 0

    def add(self, block: NDArray[Any]) -> None:
        counts = self._with_pictures(block).reshape(-1, len(self._lost))
        if not len(counts):
            return
        if counts.dtype.kind == "f":
            missing = ~np.isfinite(counts)
            if missing.any():
                self._lost |= missing.any(axis=0)
                counts = np.where(missing, self._reference, counts).astype(counts.dtype)
        np.maximum(self._largest, counts.max(axis=0), out=self._largest)
        np.minimum(self._smallest, counts.min(axis=0), out=self._smallest)
        # Frame by frame, so that the order of summation is that of any other block size.
        means = [float(np.mean(frame, dtype=np.float64)) for frame in counts]
        levels = np.array(means) - self._reference_mean
        before = self._levels[-1] if self._levels else 0.0
        steps = np.diff(levels, prepend=before)
        compared = np.ones(len(levels))
        if not self._levels:
            compared[0] = steps[0] = 0.0
        nothing, ones = np.zeros(len(levels)), np.ones(len(levels))
        _add(
            counts if counts.dtype == np.uint16 else counts.astype(np.float64, copy=False),
            self._reference,
            nothing if self._is_flat else levels,
            levels if self._is_flat else ones,
            steps if self._is_flat else nothing,
            compared,
            self._last,
            self._sums,
        )
        self._levels.extend(levels.tolist())

    def _with_pictures(self, block: NDArray[Any]) -> NDArray[Any]:
        """Leave out frames in which all pixels are alike and copies of the frame before."""
        kept = []
        for frame in block:
            copied = self._last_frame is not None and np.array_equal(frame, self._last_frame)
            low, high = _range(frame)
            kept.append(bool(low < high) and not copied)
            self._last_frame = frame
        # The frame outlives its block, which would be held by a view.
        self._last_frame = block[-1].copy()
        self._skipped += len(kept) - sum(kept)
        return block if all(kept) else block[np.array(kept)]

    def statistics(self) -> FilmStatistics:
        levels = np.array(self._levels)
        n = len(levels)
        if n < 3:
            raise CameraError(
                f"{n} of {n + self._skipped} frames can be used, the others are black, full, "
                "without numbers or copies: give a film with a picture in every frame"
            )
        sums, pixels = self._sums, len(self._lost)
        mean = sums[_D] / n
        if self._is_flat:
            if not levels.mean() > 0:
                raise CameraError(
                    f"the film is {-levels.mean():.4g} ADU darker than the dark one: give the "
                    "dark film first and the flats after it"
                )
            squares = float(levels @ levels)
            pattern = sums[_AD] / squares
            rest = sums[_DD] - sums[_AD] * pattern
            change = float(np.sum(np.diff(levels) ** 2))
            successive = sums[_EE] - 2 * pattern * sums[_BE] + pattern**2 * change
            # A bright pixel takes part in the level that is fitted to it.
            share = np.clip(mean / (pixels * levels.mean()), 0.0, 0.5)
        else:
            rest = sums[_DD] - mean * sums[_D]
            successive = sums[_EE]
            share = np.full(pixels, 1 / pixels if pixels > 1 else 0.0)
            mean = mean + levels.mean()
        scale = 1 / ((n - 1) * (1 - share))
        return FilmStatistics(
            frames=n,
            skipped=self._skipped,
            mean=self._map(self._reference + mean),
            variance=self._map(np.maximum(rest, 0.0) * scale),
            successive=self._map(np.maximum(successive, 0.0) * scale / 2),
            largest=self._largest.reshape(self._size),
            constant=(self._largest == self._smallest).reshape(self._size),
            levels=levels if self._is_flat else levels + self._reference_mean,
        )

    def _map(self, values: Floats) -> Map:
        return np.where(self._lost, math.nan, values).astype(np.float32).reshape(self._size)


def _limit(dtype: np.dtype[Any], end: Literal["min", "max"]) -> float:
    if dtype.kind == "f":
        return math.inf if end == "max" else -math.inf
    return int(getattr(np.iinfo(dtype), end))


def _range(frame: NDArray[Any]) -> tuple[float, float]:
    finite = frame[np.isfinite(frame)] if frame.dtype.kind == "f" else frame
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)


@kernel
def _add(
    counts: NDArray[Any],
    reference: Floats,
    shift: Floats,
    level: Floats,
    step: Floats,
    compared: Floats,
    last: Floats,
    sums: Floats,
) -> None:
    """Add frames (frame, pixel) to the sums: d, d^2, a d, e^2, b e.

    d is a count less reference and shift, e its step from the frame before, a and b the level of
    the frame and its step.
    """
    frames, pixels = counts.shape
    for start in range(0, pixels, _CHUNK):
        part = slice(start, min(start + _CHUNK, pixels))
        d, origin = last[part], reference[part]
        e = np.empty(len(d))
        of_d, of_dd, of_ad = sums[_D, part], sums[_DD, part], sums[_AD, part]
        of_ee, of_be = sums[_EE, part], sums[_BE, part]
        for t in range(frames):
            row = counts[t, part]
            # Few arrays a loop: more of them would need so many checks for overlap that the
            # compiler gives up vector instructions.
            away, factor = shift[t], compared[t]
            for p in range(len(d)):
                value = row[p] - origin[p] - away
                e[p] = (value - d[p]) * factor
                d[p] = value
            for p in range(len(d)):
                of_d[p] += d[p]
                of_dd[p] += d[p] * d[p]
            factor = level[t]
            for p in range(len(d)):
                of_ad[p] += factor * d[p]
            factor = step[t]
            for p in range(len(d)):
                of_ee[p] += e[p] * e[p]
                of_be[p] += factor * e[p]
