"""The noise of a frame in its finest wavelet plane F1 = I - V1.

Spots fill few tiles of that plane, so the median over tiles hardly moves when spots get brighter
or more. Plain mean and variance, spots included, are those of the plugin's own threshold.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.row_vectors import load_pixels, store_pixels, total
from rotortrack.localise.vectors import all_lanes, larger
from rotortrack.localise.wavelet_rows import FIRST_COLUMN, MARGIN, aligned, fill_row, smooth

TILE_ROWS = 8
TILE_COLUMNS = 16

_ROUNDING = np.float32(4e-6)
"""Part of a frame's level that rounding in float32 may leave in the planes of a constant frame."""

_BANDS_FROM_ROWS = 64
"""Of frames with n times as many rows, one band in n tells the noise, at most one in four."""

_QUANTISATION = np.float32(0.29)
"""Standard deviation of rounding to whole counts, 1 / sqrt(12)."""


@kernel
def frame_noise(
    counts: NDArray[Any],
    shape: tuple[int, int, int],
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    hidden: NDArray[np.bool_],
    row_hides: NDArray[np.bool_],
    taps: NDArray[np.float32],
    quantum_e: np.float32,
    every: int,
    tiles: NDArray[np.float64],
    result: NDArray[np.float64],
) -> None:
    """Measure the finest wavelet plane F1 = I - V1 of every frame.

    Parameters
    ----------
    counts
        (frame * height * width,) float32 or uint16.
    shape
        Frames, height, width.
    offset, gain
        (1,) or (height * width,) ADU and electrons per ADU.
    hidden, row_hides
        (height * width,) pixels that must not be seen, and (height,) whether a row has any.
    taps
        (5,) symmetric.
    quantum_e
        Photo-electrons of one count, 0 where counts are not whole.
    every
        Bands of TILE_ROWS rows are measured at this distance, in bands; 1 measures all rows.
    tiles
        (frame, tile) receives the mean square of each tile of the measured bands.
    result
        (frame, 3) receives the least noise that rounding leaves, and, when all rows are measured,
        mean and variance.
    """
    frames, height, width = shape
    columns = FIRST_COLUMN + (width + 15) // 16 * 16 + 16
    stride = columns + 32
    inner = taps[1] / taps[0]
    centre = taps[2] / taps[0]
    rows = aligned(8 * stride)
    v1 = aligned(stride)
    scale = aligned(stride)
    scale[FIRST_COLUMN - MARGIN : FIRST_COLUMN + width + MARGIN] = taps[0] * taps[0]
    squares = aligned(stride)
    vectors = width // 16 * 16
    for k in range(frames):
        start = k * height * width
        summed = 0.0
        squared = 0.0
        highest = all_lanes(np.float32(0.0))
        count = 0
        for newest in range(-2, height + 2):
            # Rows above and below a band are read for it, but only its own are measured.
            i = newest - 2
            measured = i >= 0 and i // TILE_ROWS % every == 0
            if not measured and (newest + 2) // TILE_ROWS % every != 0:
                continue
            padded = newest + MARGIN
            fill_row(
                counts,
                start,
                height,
                width,
                padded,
                offset,
                gain,
                hidden,
                row_hides,
                rows,
                (padded & 7) * stride,
                stride,
            )
            if not measured:
                continue
            centre_row = i + MARGIN
            smooth(rows, centre_row, stride, scale, inner, centre, v1, 0, columns)
            at = (centre_row & 7) * stride + FIRST_COLUMN
            if i % TILE_ROWS == 0:
                squares[:] = np.float32(0.0)
            row_sum = all_lanes(np.float32(0.0))
            for j in range(0, vectors, 16):
                photons = load_pixels(rows, at + j)
                fine = photons - load_pixels(v1, FIRST_COLUMN + j)
                row_sum = row_sum + fine
                highest = larger(highest, abs(photons))
                store_pixels(squares, j, load_pixels(squares, j) + fine * fine)
            summed += total(row_sum)
            for j in range(vectors, width):
                rest = rows[at + j] - v1[FIRST_COLUMN + j]
                summed += rest
                squares[j] += rest * rest
            is_whole = i % TILE_ROWS == TILE_ROWS - 1
            if is_whole or i == height - 1:
                for j in range(0, vectors, TILE_COLUMNS):
                    tile = total(load_pixels(squares, j))
                    squared += tile
                    if is_whole:
                        tiles[k, count] = tile / (TILE_ROWS * TILE_COLUMNS)
                        count += 1
                for j in range(vectors, width):
                    squared += squares[j]
        pixels = height * width
        mean = summed / pixels
        result[k, 1] = mean
        result[k, 2] = max(squared - pixels * mean * mean, 0.0) / max(pixels - 1, 1)
        store_pixels(squares, 0, highest)
        largest = np.float32(0.0)
        for lane in range(16):
            largest = max(largest, squares[lane])
        result[k, 0] = max(_QUANTISATION * quantum_e, _ROUNDING * largest)


def measure_noise(
    counts: NDArray[Any],
    shape: tuple[int, int, int],
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    hidden: NDArray[np.bool_],
    row_hides: NDArray[np.bool_],
    taps: NDArray[np.float32],
    quantum_e: float,
    *,
    all_rows: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Measure the finest wavelet plane F1 = I - V1 of every frame.

    Parameters
    ----------
    counts, shape, offset, gain, hidden, row_hides, taps, quantum_e
        As for :func:`frame_noise`.
    all_rows
        Measure all rows, for mean and variance; otherwise one band in two to four tells the noise
        of large frames as well.

    Returns
    -------
    noise, mean, variance
        (frame,) square root of the median over tiles of the mean square, never below what rounding
        leaves; and, where all rows are measured, mean and variance of the plane.
    """
    frames, height, width = shape
    columns = width // TILE_COLUMNS
    few = all_rows or columns == 0
    every = 1 if few else min(max(height // _BANDS_FROM_ROWS, 1), 4)
    tiles = np.empty((frames, -(-(height // TILE_ROWS) // every) * columns))
    result = np.empty((frames, 3))
    quantum = np.float32(quantum_e)
    frame_noise(counts, shape, offset, gain, hidden, row_hides, taps, quantum, every, tiles, result)
    least, mean, variance = result.T
    typical = np.median(tiles, axis=1) if tiles.size else variance
    return np.maximum(np.sqrt(typical), least), mean, variance


def tile_noise(
    f1: NDArray[np.float32], photons: NDArray[np.float32], quantum_e: float = 0.0
) -> float:
    """Measure the noise of a whole plane, as `wavelet_rows.frame_noise` does on the way.

    Parameters
    ----------
    f1, photons
        (height, width) finest plane, and the frame, which tells what rounding may leave.
    quantum_e
        Photo-electrons of one count, 0 where counts are not whole.
    """
    rows, columns = f1.shape[0] // TILE_ROWS, f1.shape[1] // TILE_COLUMNS
    if rows and columns:
        whole = f1[: rows * TILE_ROWS, : columns * TILE_COLUMNS].astype(np.float64)
        tiles = whole.reshape(rows, TILE_ROWS, columns, TILE_COLUMNS)
        typical = float(np.median(np.mean(tiles**2, axis=(1, 3))))
    else:
        typical = float(np.var(f1.astype(np.float64), ddof=min(f1.size - 1, 1)))
    largest = float(np.abs(photons).max(initial=0.0))
    floor = max(float(_QUANTISATION) * quantum_e, float(_ROUNDING) * largest)
    return max(math.sqrt(typical), floor)
