"""The wavelet filter row by row, for kernels of five taps, which the usual settings give.

Rows are read as photo-electrons into a ring of 8 and smoothed once into rows of V1, of which a
ring of 16 is smoothed again and subtracted into rows of F: no plane of the frame's size exists.
Frames are extended by their edge values as far as the filter reaches, so that a bright background
leaves nothing at the border; :mod:`rotortrack.localise.wavelet` extends them less, as the plugin
does, and differs in the two outermost rows and columns alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.row_vectors import load_pixels, shifted, store_pixels
from rotortrack.localise.vectors import all_lanes

FIRST_COLUMN = 16
"""Place of a frame's first column in a buffered row: what lies before extends the frame."""

MARGIN = 6
"""Pixels by which a frame is extended: as far as both convolutions reach together."""

WIDE_REACH = 4
"""Rows by which the second convolution reaches beyond its centre."""
_HIDDEN_REACH = 5


@kernel
def aligned(size: int) -> NDArray[np.float32]:
    """Make zeros at an address that no vector of 16 straddles."""
    whole = np.zeros(size + 16, np.float32)
    shift = (16 - (whole.ctypes.data // 4) % 16) % 16
    return whole[shift : shift + size]


@kernel
def _read_row(
    counts: NDArray[Any],
    start: int,
    width: int,
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    place: int,
    row: NDArray[np.float32],
    at: int,
) -> None:
    """Turn a row of counts into photo-electrons, extended by its edge values on both sides."""
    vectors = width // 16 * 16
    if offset.size == 1:
        level = offset[0]
        factor = gain[0]
        for j in range(0, vectors, 16):
            store_pixels(
                row, at + FIRST_COLUMN + j, (load_pixels(counts, start + j) - level) * factor
            )
        for j in range(vectors, width):
            row[at + FIRST_COLUMN + j] = (np.float32(counts[start + j]) - level) * factor
    else:
        for j in range(0, vectors, 16):
            photons = load_pixels(counts, start + j) - load_pixels(offset, place + j)
            store_pixels(row, at + FIRST_COLUMN + j, photons * load_pixels(gain, place + j))
        for j in range(vectors, width):
            photon = np.float32(counts[start + j]) - offset[place + j]
            row[at + FIRST_COLUMN + j] = photon * gain[place + j]


@kernel
def _extend_row(row: NDArray[np.float32], at: int, width: int) -> None:
    for k in range(MARGIN):
        row[at + FIRST_COLUMN - 1 - k] = row[at + FIRST_COLUMN]
        row[at + FIRST_COLUMN + width + k] = row[at + FIRST_COLUMN + width - 1]


@kernel
def _hide(
    counts: NDArray[Any],
    start: int,
    height: int,
    width: int,
    i: int,
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    hidden: NDArray[np.bool_],
    row: NDArray[np.float32],
    at: int,
) -> None:
    """Give hidden pixels of a row the mean of the nearest pixels that are not hidden."""
    maps = offset.size > 1
    for j in range(width):
        if not hidden[i * width + j]:
            continue
        value = np.float32(0.0)
        for reach in range(1, _HIDDEN_REACH + 1):
            summed = np.float32(0.0)
            seen = 0
            for y in range(max(i - reach, 0), min(i + reach + 1, height)):
                for x in range(max(j - reach, 0), min(j + reach + 1, width)):
                    pixel = y * width + x
                    if not hidden[pixel]:
                        level = offset[pixel] if maps else offset[0]
                        factor = gain[pixel] if maps else gain[0]
                        summed += (np.float32(counts[start + pixel]) - level) * factor
                        seen += 1
            if seen > 0:
                value = summed / np.float32(seen)
                break
        row[at + FIRST_COLUMN + j] = value


@kernel
def fill_row(
    counts: NDArray[Any],
    start: int,
    height: int,
    width: int,
    padded: int,
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    hidden: NDArray[np.bool_],
    row_hides: NDArray[np.bool_],
    row: NDArray[np.float32],
    at: int,
    stride: int,
) -> None:
    """Prepare row number `padded` of the extended frame; beyond the extension all is zero."""
    if padded < 0 or padded >= height + 2 * MARGIN:
        row[at : at + stride] = np.float32(0.0)
        return
    i = min(max(padded - MARGIN, 0), height - 1)
    _read_row(counts, start + i * width, width, offset, gain, i * width, row, at)
    if row_hides[i]:
        _hide(counts, start, height, width, i, offset, gain, hidden, row, at)
    _extend_row(row, at, width)


@kernel
def smooth(
    rows: NDArray[np.float32],
    c: int,
    stride: int,
    scale: NDArray[np.float32],
    inner: float,
    centre: float,
    v1: NDArray[np.float32],
    at: int,
    columns: int,
) -> None:
    """Convolve row c of the ring of 8 with taps 1, inner, centre, inner, 1 along both axes.

    `scale` undoes the taps' scale inside the extended frame and is zero beyond it.
    """
    above2 = ((c - 2) & 7) * stride
    above = ((c - 1) & 7) * stride
    middle = (c & 7) * stride
    below = ((c + 1) & 7) * stride
    below2 = ((c + 2) & 7) * stride
    left = all_lanes(np.float32(0.0))
    here = centre * load_pixels(rows, middle) + (
        inner * (load_pixels(rows, above) + load_pixels(rows, below))
        + (load_pixels(rows, above2) + load_pixels(rows, below2))
    )
    for j in range(0, columns, 16):
        k = j + 16
        right = centre * load_pixels(rows, middle + k) + (
            inner * (load_pixels(rows, above + k) + load_pixels(rows, below + k))
            + (load_pixels(rows, above2 + k) + load_pixels(rows, below2 + k))
        )
        smoothed = centre * here + (
            inner * (shifted(left, here, 15) + shifted(here, right, 1))
            + (shifted(left, here, 14) + shifted(here, right, 2))
        )
        store_pixels(v1, at + j, smoothed * load_pixels(scale, j))
        left = here
        here = right


@kernel
def subtract_smoother(
    v1: NDArray[np.float32],
    m: int,
    stride: int,
    scale: float,
    inner: float,
    centre: float,
    f: NDArray[np.float32],
    at: int,
    columns: int,
) -> None:
    """Fill a row of F = V1 - V2; the taps of V2 lie two pixels apart."""
    above2 = ((m - 4) & 15) * stride
    above = ((m - 2) & 15) * stride
    middle = (m & 15) * stride
    below = ((m + 2) & 15) * stride
    below2 = ((m + 4) & 15) * stride
    left = centre * load_pixels(v1, middle) + (
        inner * (load_pixels(v1, above) + load_pixels(v1, below))
        + (load_pixels(v1, above2) + load_pixels(v1, below2))
    )
    here = centre * load_pixels(v1, middle + 16) + (
        inner * (load_pixels(v1, above + 16) + load_pixels(v1, below + 16))
        + (load_pixels(v1, above2 + 16) + load_pixels(v1, below2 + 16))
    )
    for j in range(16, columns, 16):
        k = j + 16
        right = centre * load_pixels(v1, middle + k) + (
            inner * (load_pixels(v1, above + k) + load_pixels(v1, below + k))
            + (load_pixels(v1, above2 + k) + load_pixels(v1, below2 + k))
        )
        smoother = centre * here + (
            inner * (shifted(left, here, 14) + shifted(here, right, 2))
            + (shifted(left, here, 12) + shifted(here, right, 4))
        )
        store_pixels(f, at + j, load_pixels(v1, middle + j) - scale * smoother)
        left = here
        here = right
