"""Compiled part of single linkage: union-find over occupied grid cells.

Equals, for every pair of points, "join when their distance is at most d" followed to the end
(connected components); see `tests/unit/rotors/test_cluster.py` for that computation in plain form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel


@kernel
def _root(parent: NDArray[np.int64], cell: int) -> int:
    while parent[cell] != cell:
        parent[cell] = parent[parent[cell]]
        cell = parent[cell]
    return cell


@kernel
def _bounds(values: NDArray[np.float64], starts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Smallest and largest value of every cell."""
    bounds = np.empty((starts.size - 1, 2))
    for cell in range(starts.size - 1):
        low = high = values[starts[cell]]
        for i in range(starts[cell] + 1, starts[cell + 1]):
            low = min(low, values[i])
            high = max(high, values[i])
        bounds[cell, 0] = low
        bounds[cell, 1] = high
    return bounds


@kernel
def _touch(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    starts: NDArray[np.int64],
    x_bounds: NDArray[np.float64],
    y_bounds: NDArray[np.float64],
    a: int,
    b: int,
    reach2: float,
) -> bool:
    """Whether any point of cell `a` lies within the distance of any point of cell `b`."""
    for i in range(starts[a], starts[a + 1]):
        # Few points of a cell come near the other cell's box, which spares most of the pairs.
        box_x = max(x_bounds[b, 0] - x[i], x[i] - x_bounds[b, 1], 0.0)
        box_y = max(y_bounds[b, 0] - y[i], y[i] - y_bounds[b, 1], 0.0)
        if box_x * box_x + box_y * box_y > reach2:
            continue
        for j in range(starts[b], starts[b + 1]):
            dx = x[i] - x[j]
            dy = y[i] - y[j]
            if dx * dx + dy * dy <= reach2:
                return True
    return False


@kernel
def join_cells(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    starts: NDArray[np.int64],
    keys: NDArray[np.int64],
    width: int,
    reach2: float,
) -> NDArray[np.int64]:
    """Root cell of every occupied cell after all cells that touch have been joined.

    Parameters
    ----------
    x, y
        Points sorted by cell, shape (n,).
    starts
        First point of every cell, then n, shape (cells + 1,).
    keys
        Row times `width` plus column of every cell, ascending, shape (cells,).
    width
        Columns of the grid with at least four empty ones between the ends of adjacent rows.
    reach2
        Largest squared distance that joins.
    """
    cells = keys.size
    x_bounds = _bounds(x, starts)
    y_bounds = _bounds(y, starts)
    parent = np.arange(cells)
    # Adjacent cells first: afterwards most pairs two cells apart are joined already and need no
    # test of their points.
    for ring in range(1, 3):
        for rows in range(ring + 1):
            first = 0
            for cell in range(cells):
                lowest = keys[cell] + rows * width - ring
                while first < cells and keys[first] < lowest:
                    first += 1
                other = first
                while other < cells and keys[other] <= lowest + 2 * ring:
                    columns = abs(keys[other] - lowest - ring)
                    if other > cell and max(rows, columns) == ring:
                        a = _root(parent, cell)
                        b = _root(parent, other)
                        if a != b and _touch(x, y, starts, x_bounds, y_bounds, cell, other, reach2):
                            parent[max(a, b)] = min(a, b)
                    other += 1
    for cell in range(cells):
        parent[cell] = _root(parent, cell)
    return parent
