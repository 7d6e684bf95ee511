"""Cross-correlation of two renderings of the same field, coarse over all lags, fine near one.

Both render an averaged shifted histogram with two shifts: every localisation adds the stencil
``[1 2 1]^T [1 2 1]`` about its pixel. The stencil commutes with the correlation, so plain counts
are correlated and the result is convolved once with ``[1 4 6 4 1]`` per axis.

The coarse correlation is a Fourier transform of the field in camera pixels. The fine one is
counted directly for the few lags that are needed, from sorted pixels that hold localisations:
its memory grows with the localisations and not with the area, and it is exact.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy import ndimage

from rotortrack.kernels import kernel

WINDOW_HALF = 5
"""Half width of the window in which a peak is refined (11 x 11)."""
_STENCIL_REACH = 2
FINE_REACH = WINDOW_HALF + _STENCIL_REACH
"""Largest lag, from the expected one, of counted pairs."""
_STENCIL = np.array([1.0, 4.0, 6.0, 4.0, 1.0])


class CoarseCorrelation:
    """Correlate renderings in camera pixels with the rendering of a reference.

    Parameters
    ----------
    columns, rows
        Shape (n,), pixel of each localisation of the reference, from 0.
    shape
        (height, width) of the field, px.
    largest_lag
        Lags up to this many pixels per axis come back.
    """

    def __init__(
        self,
        columns: NDArray[np.int64],
        rows: NDArray[np.int64],
        shape: tuple[int, int],
        largest_lag: int,
    ) -> None:
        self._shape = shape
        self._largest_lag = largest_lag
        # Zeros as wide as the largest lag keep opposite edges of the field from meeting.
        reach = largest_lag + _STENCIL_REACH
        self._padded = tuple(scipy.fft.next_fast_len(n + reach, real=True) for n in shape)
        self._reference = self._transform(columns, rows)

    def __call__(self, columns: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Correlate with the pixels of other localisations.

        Returns
        -------
        Shape (2 L + 1, 2 L + 1): element (L + j, L + i) counts pairs where the reference lies i
        columns and j rows beyond the other.
        """
        spectrum = self._reference * np.conj(self._transform(columns, rows))
        pairs = scipy.fft.irfft2(spectrum, s=self._padded, overwrite_x=True)
        reach = self._largest_lag + _STENCIL_REACH
        near_y = np.arange(-reach, reach + 1) % self._padded[0]
        near_x = np.arange(-reach, reach + 1) % self._padded[1]
        return apply_stencil(pairs[np.ix_(near_y, near_x)])

    def _transform(
        self, columns: NDArray[np.int64], rows: NDArray[np.int64]
    ) -> NDArray[np.complex128]:
        image = count_image(columns, rows, self._shape)
        return np.asarray(scipy.fft.rfft2(image, s=self._padded))


def count_image(
    columns: NDArray[np.int64], rows: NDArray[np.int64], shape: tuple[int, int]
) -> NDArray[np.float64]:
    """Count localisations per pixel of a (height, width) field."""
    counts = np.bincount(rows * shape[1] + columns, minlength=shape[0] * shape[1])
    return counts.reshape(shape).astype(np.float64)


def apply_stencil(pairs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn pair counts into the correlation of two renderings; two pixels are lost per side."""
    blurred = ndimage.correlate1d(pairs, _STENCIL, axis=-1, mode="constant")
    blurred = ndimage.correlate1d(blurred, _STENCIL, axis=-2, mode="constant")
    inner = slice(_STENCIL_REACH, -_STENCIL_REACH)
    return np.asarray(blurred[..., inner, inner], dtype=np.float64)


@kernel
def count_pairs(
    reference_keys: NDArray[np.int64],
    reference_counts: NDArray[np.int64],
    keys: NDArray[np.int64],
    counts: NDArray[np.int64],
    groups: NDArray[np.int64],
    n_groups: int,
    stride: int,
    lag: int,
) -> NDArray[np.float64]:
    """Count pairs of localisations for every lag near a given one, group by group.

    A key is ``row * stride + column`` of an occupied fine pixel; the stride is so wide that keys
    of neighbouring rows cannot be confused at the lags asked for.

    Parameters
    ----------
    reference_keys, reference_counts
        Shape (m,), ascending keys and localisations per pixel of the reference.
    keys, counts, groups
        Shape (n,), the same of the other rendering, and the group of each pixel.
    n_groups, stride
        Number of groups; keys per row.
    lag
        Key difference of the middle lag, reference minus other.

    Returns
    -------
    Shape (n_groups, 15, 15), lags by row and column.

    Notes
    -----
    O(15 (m + n) + pairs of pixels within reach); a pixel counts once however many localisations
    it holds, so dense rotors cost no more than their area.
    """
    side = 2 * FINE_REACH + 1
    pairs = np.zeros((n_groups, side, side))
    for j in range(side):
        shift = lag + (j - FINE_REACH) * stride - FINE_REACH
        low = 0
        for i in range(keys.size):
            first = keys[i] + shift
            while low < reference_keys.size and reference_keys[low] < first:
                low += 1
            k = low
            while k < reference_keys.size and reference_keys[k] < first + side:
                pairs[groups[i], j, reference_keys[k] - first] += counts[i] * reference_counts[k]
                k += 1
    return pairs
