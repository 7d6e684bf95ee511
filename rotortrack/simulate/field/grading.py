"""Lines that grow apart in geometric progression, for meshes and tables alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Grading:
    """How fine a grid is.

    Attributes
    ----------
    finest_nm
        Distance of lines at the rim and on the walls.
    ratio
        Growth of the distance away from them.
    widest_nm
        Largest distance.
    """

    finest_nm: float
    ratio: float
    widest_nm: float = 40.0


def graded(length: float, grading: Grading) -> NDArray[np.float64]:
    """Divide (0, length) into cells that grow from the finest at 0.

    Returns
    -------
    ndarray
        Lines from 0 to `length`, both included.
    """
    sizes = [min(grading.finest_nm, length)]
    while sum(sizes) < length:
        sizes.append(min(sizes[-1] * grading.ratio, grading.widest_nm))
    lines = np.concatenate(([0.0], np.cumsum(sizes)))
    return lines * (length / lines[-1])


def graded_both(length: float, grading: Grading) -> NDArray[np.float64]:
    """Divide (0, length) into cells that grow from both ends to the middle."""
    half = graded(length / 2.0, grading)
    return np.concatenate((half, length - half[-2::-1]))
