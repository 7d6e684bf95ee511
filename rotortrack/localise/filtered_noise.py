"""The noise of the filtered plane F, measured on F itself.

Noise that is not white, as in smoothed, interpolated or compressed movies, passes the filter with
another gain than white noise, so that no other plane tells how strong it is in F. What holds spots
is left out: bands of rows are cut into cells, and a cell counts unless it or one beside it holds a
pixel far above the quiet cells of its neighbourhood. Comparing with the neighbourhood keeps the
bright part of an uneven background, where noise is stronger, from being taken for spots.
"""

from __future__ import annotations

import functools
import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.row_vectors import load_pixels, store_pixels
from rotortrack.localise.vectors import all_lanes, larger
from rotortrack.localise.wavelet_rows import (
    FIRST_COLUMN,
    MARGIN,
    WIDE_REACH,
    aligned,
    fill_row,
    smooth,
    subtract_smoother,
)

BAND_ROWS: Final = 16
CELL_COLUMNS: Final = 8

_FEWEST_BANDS: Final = 4
_LARGEST_STEP: Final = 4
"""Bands begin at most this many bands apart, and closer where there would be fewer than four."""

_FEWEST_CELLS: Final = 18
_FEWEST_CELLS_ABREAST: Final = 6

_GROUP_CELLS: Final = 8
_OUTLIER: Final = 4.1
"""A pixel this many times the second quietest cell of a group belongs to a spot."""

_FEWEST_QUIET: Final = 0.2
"""Where fewer of the cells pass for quiet, most of these hold spots too, only fainter ones."""

_ROUNDING: Final = 4e-6
"""Part of a frame's level that rounding in float32 may leave in the planes of a constant frame."""

_QUANTISATION: Final = 0.29
"""Standard deviation of rounding to whole counts, 1 / sqrt(12)."""


@kernel
def filtered_noise(
    counts: NDArray[Any],
    shape: tuple[int, int, int],
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    hidden: NDArray[np.bool_],
    row_hides: NDArray[np.bool_],
    taps: NDArray[np.float32],
    layout: tuple[int, int, int],
    quantum: float,
    result: NDArray[np.float64],
) -> None:
    """Measure the noise of F = V1 - V2 of every frame.

    Parameters
    ----------
    counts, shape, offset, gain, hidden, row_hides, taps
        As for :func:`rotortrack.localise.noise.frame_noise`.
    layout
        Of :func:`bands_of` for the frames' height.
    quantum
        What one count becomes in F (photo-electrons of a count times the filter's gain for white
        noise), 0 where counts are not whole.
    result
        (frame,) receives the standard deviation, never below what rounding leaves; negative where
        hardly a cell is free of spots, and its absolute value is an upper bound.
    """
    frames, height, width = shape
    columns = FIRST_COLUMN + (width + 15) // 16 * 16 + 16
    stride = columns + 32
    inner = taps[1] / taps[0]
    centre = taps[2] / taps[0]
    squared_scale = taps[0] * taps[0]
    rows = aligned(8 * stride)
    v1 = aligned(16 * stride)
    f = aligned(stride)
    scale = aligned(stride)
    scale[FIRST_COLUMN - MARGIN : FIRST_COLUMN + width + MARGIN] = squared_scale
    tops = aligned(stride)
    squares = aligned(stride)
    levels = aligned(16)
    band_rows, step, bands = layout
    cells = max(width // CELL_COLUMNS, 1)
    cell_columns = min(width, CELL_COLUMNS)
    cell_tops = np.empty((bands, cells))
    cell_squares = np.empty((bands, cells))
    for k in range(frames):
        level = all_lanes(np.float32(0.0))
        for band in range(bands):
            first = (step - band_rows) // 2 + band * step
            tops[:] = np.float32(0.0)
            squares[:] = np.float32(0.0)
            for newest in range(first, first + band_rows + 2 * MARGIN):
                fill_row(
                    counts,
                    k * height * width,
                    height,
                    width,
                    newest,
                    offset,
                    gain,
                    hidden,
                    row_hides,
                    rows,
                    (newest & 7) * stride,
                    stride,
                )
                c = newest - 2
                if c < first + 2:
                    continue
                smooth(rows, c, stride, scale, inner, centre, v1, (c & 15) * stride, columns)
                m = c - WIDE_REACH
                if m < first + MARGIN:
                    continue
                subtract_smoother(v1, m, stride, squared_scale, inner, centre, f, 0, columns - 16)
                at = (m & 7) * stride + FIRST_COLUMN
                for j in range(0, width, 16):
                    value = load_pixels(f, FIRST_COLUMN + j)
                    store_pixels(tops, j, larger(load_pixels(tops, j), abs(value)))
                    store_pixels(squares, j, load_pixels(squares, j) + value * value)
                    # Beyond its width a row holds its edge values or zeros: no new level.
                    level = larger(level, abs(load_pixels(rows, at + j)))
            for cell in range(cells):
                top, square = 0.0, 0.0
                for j in range(cell * cell_columns, (cell + 1) * cell_columns):
                    top = max(top, float(tops[j]))
                    square += squares[j]
                cell_tops[band, cell] = top
                cell_squares[band, cell] = square / (cell_columns * band_rows)
        store_pixels(levels, 0, level)
        highest = 0.0
        for lane in range(16):
            highest = max(highest, float(levels[lane]))
        rounding = _ROUNDING * highest
        noise = noise_of_cells(cell_tops, cell_squares, rounding)
        least = max(rounding, _QUANTISATION * quantum)
        result[k] = max(noise, least) if noise >= 0.0 else min(noise, -least)


def bands_of(height: int) -> tuple[int, int, int]:
    """Give the rows of a band, the rows from one band's first to the next's, and how many fit."""
    rows = min(BAND_ROWS, height)
    bands_apart = height // (BAND_ROWS * _FEWEST_BANDS)
    step = rows * max(1, min(_LARGEST_STEP, bands_apart))
    return rows, step, height // step


@kernel
def noise_of_cells(
    tops: NDArray[np.float64], squares: NDArray[np.float64], rounding: float
) -> float:
    """Give the root of the mean square over the cells without spots.

    Parameters
    ----------
    tops, squares
        (band, cell) largest absolute value and mean square of each cell.
    rounding
        Cells of no more than this are constant and tell nothing of the noise.

    Returns
    -------
    float
        Standard deviation; 0 when all cells are constant. Negative when hardly a cell is free of
        spots, since the value is an upper bound for most of the frame.
    """
    bands, cells = squares.shape
    groups = max(cells // _GROUP_CELLS, 1)
    least = rounding * rounding
    summed, kept, telling = 0.0, 0, 0
    quiet_summed, quiet_groups = 0.0, 0
    for band in range(bands):
        for group in range(groups):
            first = group * cells // groups
            last = (group + 1) * cells // groups
            quietest = np.inf
            second = np.inf
            for cell in range(first, last):
                square = squares[band, cell]
                if square > least:
                    telling += 1
                    if square < quietest:
                        second = quietest
                        quietest = square
                    elif square < second:
                        second = square
            if quietest == np.inf:
                continue
            quiet = quietest if second == np.inf else second
            quiet_summed += quiet
            quiet_groups += 1
            limit = _OUTLIER * math.sqrt(quiet)
            for cell in range(first, last):
                top = tops[band, cell]
                if cell > 0:
                    top = max(top, tops[band, cell - 1])
                if cell + 1 < cells:
                    top = max(top, tops[band, cell + 1])
                if squares[band, cell] > least and top < limit:
                    summed += squares[band, cell]
                    kept += 1
    if telling == 0:
        return 0.0
    if kept == 0:
        return -math.sqrt(quiet_summed / quiet_groups)
    noise = math.sqrt(summed / kept)
    return noise if kept >= _FEWEST_QUIET * telling else -noise


def plane_noise(f: NDArray[np.float32], photons: NDArray[np.float32], quantum: float) -> float:
    """Measure the noise of a whole plane, as :func:`filtered_noise` does on the way.

    Parameters
    ----------
    f, photons
        (height, width) filtered plane, and the frame, which tells what rounding may leave.
    quantum
        What one count becomes in F.

    Returns
    -------
    float
        Negative where hardly a cell is free of spots, as in :func:`filtered_noise`.
    """
    height, width = f.shape
    band_rows, step, bands = bands_of(height)
    cells, columns = max(width // CELL_COLUMNS, 1), min(width, CELL_COLUMNS)
    starts = (step - band_rows) // 2 + step * np.arange(bands)
    chosen = starts[:, np.newaxis] + np.arange(band_rows)
    shape = bands, band_rows, cells, columns
    values = f[chosen, : cells * columns].astype(np.float64).reshape(shape)
    rounding = _ROUNDING * float(np.abs(photons[chosen]).max())
    noise = noise_of_cells(
        np.abs(values).max(axis=(1, 3)), np.mean(values**2, axis=(1, 3)), rounding
    )
    least = max(rounding, _QUANTISATION * quantum)
    return max(noise, least) if noise >= 0.0 else min(noise, -least)


def has_quiet_cells(height: int, width: int) -> bool:
    """Whether a frame is large enough that its spots leave cells of F alone.

    A spot reaches 10 pixels in F. In smaller frames it would be taken for the noise, which then
    is better told from F1, where a spot reaches half as far, as if it were white.
    """
    cells = width // CELL_COLUMNS
    bands = bands_of(height)[2]
    return cells >= _FEWEST_CELLS_ABREAST and bands * cells >= _FEWEST_CELLS


@functools.cache
def white_noise_gains(taps: bytes) -> tuple[float, float]:
    """Give the standard deviations in F and in F1 of white noise of standard deviation 1.

    Parameters
    ----------
    taps
        Bytes of the float32 kernel.
    """
    kernel = np.frombuffer(taps, np.float32).astype(np.float64)
    wide = np.zeros(2 * kernel.size - 1)
    wide[::2] = kernel
    both = np.convolve(kernel, wide)
    v1 = np.outer(kernel, kernel)
    f = -np.outer(both, both)
    pad = (both.size - kernel.size) // 2
    inner = slice(pad, pad + kernel.size)
    f[inner, inner] += v1
    f1 = -v1
    f1[kernel.size // 2, kernel.size // 2] += 1.0
    return float(np.sqrt(np.sum(f**2))), float(np.sqrt(np.sum(f1**2)))
