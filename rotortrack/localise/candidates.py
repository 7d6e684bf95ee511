"""Candidate pixels: local maxima of the filtered plane."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.row_vectors import load_pixels, store_pixels
from rotortrack.localise.vectors import bits
from rotortrack.localise.wavelet_rows import (
    FIRST_COLUMN,
    MARGIN,
    WIDE_REACH,
    aligned,
    fill_row,
    smooth,
    subtract_smoother,
)


@kernel
def local_maxima(
    plane: NDArray[np.float32], threshold: np.float32, connectivity: int, border: int
) -> NDArray[np.int32]:
    """Find the pixels at or above a threshold that no neighbour exceeds.

    Pixels of a plateau are all found. Pixels closer to the edge than `border`, whose fit window
    would leave the frame, are not looked at.

    Parameters
    ----------
    plane
        (height, width) filtered frame.
    threshold
        Smallest value of a candidate.
    connectivity
        4 or 8 neighbours.
    border
        Margin in pixels.

    Returns
    -------
    ndarray, shape (n, 2)
        Row and column of each candidate, in raster order.
    """
    height, width = plane.shape
    found = np.empty((max(height * width, 1), 2), np.int32)
    count = 0
    for i in range(border, height - border):
        for j in range(border, width - border):
            value = plane[i, j]
            # Written so that NaN is never a candidate.
            if not value >= threshold:
                continue
            highest = True
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    if connectivity == 4 and di != 0 and dj != 0:
                        continue
                    row = i + di
                    column = j + dj
                    if 0 <= row < height and 0 <= column < width and plane[row, column] > value:
                        highest = False
            if highest:
                found[count, 0] = i
                found[count, 1] = j
                count += 1
    return found[:count].copy()


@kernel
def frame_maxima(
    counts: NDArray[Any],
    shape: tuple[int, int, int],
    first_frame: int,
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    hidden: NDArray[np.bool_],
    row_hides: NDArray[np.bool_],
    taps: NDArray[np.float32],
    thresholds: NDArray[np.float32],
    eight: bool,
    border: int,
    found: NDArray[np.int32],
) -> tuple[int, int]:
    """Find the pixels of F at or above a frame's threshold that no neighbour exceeds.

    Parameters
    ----------
    counts, shape, offset, gain, hidden, row_hides, taps
        As for :func:`frame_noise`.
    first_frame
        Where to begin.
    thresholds
        (frame,) photons, positive.
    eight
        8 neighbours instead of 4.
    border
        Margin in pixels that is not searched.
    found
        (n, 3) receives frame, row and column.

    Returns
    -------
    tuple of int
        The frame that did not fit into `found` any more (the number of frames when all did), and
        the number of rows filled.
    """
    frames, height, width = shape
    columns = FIRST_COLUMN + (width + 15) // 16 * 16 + 16
    stride = columns + 32
    inner = taps[1] / taps[0]
    centre = taps[2] / taps[0]
    rows = aligned(8 * stride)
    v1 = aligned(16 * stride)
    f = aligned(4 * stride)
    scale = aligned(stride)
    scale[FIRST_COLUMN - MARGIN : FIRST_COLUMN + width + MARGIN] = taps[0] * taps[0]
    nothing = np.float32(-np.inf)
    count = 0
    for k in range(first_frame, frames):
        start = k * height * width
        count_before = count
        f[:] = nothing
        threshold = thresholds[k]
        for newest in range(-2, height + MARGIN + WIDE_REACH + 3):
            fill_row(
                counts,
                start,
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
            if c < 0:
                continue
            to = (c & 15) * stride
            if c < height + 2 * MARGIN:
                smooth(rows, c, stride, scale, inner, centre, v1, to, columns)
            else:
                v1[to : to + stride] = np.float32(0.0)
            m = c - WIDE_REACH
            i = m - MARGIN
            if i < 0:
                continue
            to = (i & 3) * stride
            if i < height:
                subtract_smoother(
                    v1, m, stride, taps[0] * taps[0], inner, centre, f, to, columns - 16
                )
                store_pixels(f, to + FIRST_COLUMN + width, nothing)
            else:
                f[to : to + stride] = nothing
            row = i - 1
            if row < border or row >= height - border:
                continue
            middle = (row & 3) * stride + FIRST_COLUMN
            above = ((row - 1) & 3) * stride + FIRST_COLUMN
            below = ((row + 1) & 3) * stride + FIRST_COLUMN
            for j in range(0, width, 16):
                value = load_pixels(f, middle + j)
                hit = value >= threshold
                if bits(hit) == 0:
                    continue
                hit = hit & (value >= load_pixels(f, middle + j - 1))
                hit = hit & (value >= load_pixels(f, middle + j + 1))
                hit = hit & (value >= load_pixels(f, above + j))
                hit = hit & (value >= load_pixels(f, below + j))
                if eight:
                    hit = hit & (value >= load_pixels(f, above + j - 1))
                    hit = hit & (value >= load_pixels(f, above + j + 1))
                    hit = hit & (value >= load_pixels(f, below + j - 1))
                    hit = hit & (value >= load_pixels(f, below + j + 1))
                lanes = bits(hit)
                column = j
                while lanes != 0:
                    if lanes & 1 and border <= column < width - border:
                        if count == found.shape[0]:
                            return k, count_before
                        found[count, 0] = k
                        found[count, 1] = row
                        found[count, 2] = column
                        count += 1
                    lanes >>= 1
                    column += 1
    return frames, count
