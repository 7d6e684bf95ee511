"""Candidate pixels: local maxima of the filtered plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel


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
