"""Which runs of a scan ended in the same shape, up to a turn, the rod's direction or a mirror.

A scan starts rods from chosen places, so that how many of them end in a shape tells of the choice
and not of nature: each shape of a cell of the grid counts once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

CELL: Final = ("lambda_eff", "flow_ratio")
"""Columns of the table of runs that name a cell of the grid."""


def shape_distance_nm(first: Floats, second: Floats, *, mirrored: bool = True) -> float:
    """Give the rms distance of two shapes' vertices after the best turn about the pore's axis.

    min_phi sqrt(mean |z_1 - e^{i phi} z_2|^2 + mean (h_1 - h_2)^2), with z the place in the plane
    and h the height; the best turn is the argument of sum z_1 conj(z_2).

    Parameters
    ----------
    first, second
        Vertices, nm, shape (n, 3).
    mirrored
        Whether the mirror image is the same shape.

    Returns
    -------
    float
        The least over both directions along the rod; nan where a vertex is not known.
    """
    z, h = first[:, 0] + 1j * first[:, 1], first[:, 2]
    found = []
    for other in (second, second[::-1]):
        w = other[:, 0] + 1j * other[:, 1]
        squares = float(np.mean(np.abs(z) ** 2 + np.abs(w) ** 2 + (h - other[:, 2]) ** 2))
        for image in (w, w.conj()) if mirrored else (w,):
            overlap = 2.0 * abs(np.mean(z * image.conj()))
            found.append(np.sqrt(max(squares - float(overlap), 0.0)))
    return float(np.min(found))


def label_attractors(runs: pd.DataFrame, shape_nm: Floats, same_nm: float) -> NDArray[np.int64]:
    """Give each final shape of a scan a number, each cell of the grid by itself.

    Parameters
    ----------
    runs
        Table of schema `RUNS`.
    shape_nm
        Final positions of the vertices, shape (runs, n, 3).
    same_nm
        Shapes closer than this are one, directly or by way of others.

    Returns
    -------
    ndarray
        Shape (runs,); equal numbers, from 0, are equal shapes.
    """
    labels = np.zeros(len(runs), np.int64)
    used = 0
    cells = runs.groupby(list(CELL), sort=True).indices
    for members in cells.values():
        n = len(members)
        near = np.eye(n, dtype=bool)
        for i in range(n):
            for j in range(i):
                apart = shape_distance_nm(shape_nm[members[i]], shape_nm[members[j]])
                near[i, j] = apart < same_nm
        count, found = connected_components(near, directed=False)
        labels[members] = used + found
        used += int(count)
    return labels
