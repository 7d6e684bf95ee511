"""Whether two time bins show the same structure, apart from where its correlation peaks.

Under no common structure the localisations of one bin fall on the densest tenth of the other's
field with a probability of a tenth. Pairs would be no measure of that: one localisation that meets
a clump makes hundreds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rotortrack.corrections.drift.correlation import count_image

_DENSE_PART = 0.1
_LEAST_FIELD_PX = 32


def dense_pixels(
    columns: NDArray[np.int64], rows: NDArray[np.int64], shape: tuple[int, int]
) -> NDArray[np.bool_]:
    """Mark the pixels about localisations, at most the densest tenth of the field.

    Parameters
    ----------
    columns, rows
        Shape (n,), pixel of each localisation.
    shape
        (height, width) of the field, px.
    """
    image = count_image(columns, rows, shape)
    for axis in range(2):
        image = ndimage.correlate1d(image, [1.0, 2.0, 1.0], axis=axis, mode="constant")
    most = int(_DENSE_PART * _area(shape))
    occupied = image[image > 0]
    cut = np.partition(occupied, -most - 1)[-most - 1] if most < occupied.size else 0.0
    dense: NDArray[np.bool_] = image > cut
    return dense


def excess_on(
    dense: NDArray[np.bool_], columns: NDArray[np.int64], rows: NDArray[np.int64]
) -> float:
    """Count localisations on marked pixels beyond chance, in binomial standard deviations.

    Pixels outside the field are not marked; the standard deviation is at least one localisation.
    """
    height, width = dense.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    hits = int(dense[rows[inside], columns[inside]].sum())
    chance = float(dense.sum()) / _area(dense.shape)
    expected = chance * columns.size
    return float((hits - expected) / np.sqrt(max(expected * (1 - chance), 1.0)))


def _area(shape: tuple[int, ...]) -> int:
    """Pixels in which localisations could lie: a rotor alone does not fill its whole field."""
    return max(shape[0] * shape[1], _LEAST_FIELD_PX**2)
