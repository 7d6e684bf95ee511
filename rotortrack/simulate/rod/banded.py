"""Symmetric banded linear systems of half-bandwidth 8: LDL^T without pivoting.

Row j of a band holds A[j, j], A[j, j + 1], ..., A[j, j + 8] and then zeros up to `WIDTH`, so that
every inner loop has the same length. After the last row stand `HALF_BAND` more, which only exist
to be written to. A right-hand side is as long as the band.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel

HALF_BAND = 8
WIDTH = 16


@kernel
def factor(band: NDArray[np.float64], size: int) -> int:
    """Factor A = L D L^T in place.

    Pivots are not sought: the matrices of a rod are saddle-point matrices whose every leading
    block is one too (positive definite in the displacements, full rank in the tensions), for which
    the factors exist in this order.

    Parameters
    ----------
    band
        Shape (size + HALF_BAND, WIDTH): A on entry, D and the rows of L^T on return.
    size
        Number of unknowns.

    Returns
    -------
    int
        Number of negative pivots, which is the number of tensions; -1 when a pivot is zero or not
        finite.

    Notes
    -----
    Costs 64 multiplications an unknown.
    """
    negative = 0
    for j in range(size):
        row = band[j]
        pivot = row[0]
        if not (pivot != 0.0 and abs(pivot) < np.inf):
            return -1
        if pivot < 0.0:
            negative += 1
        inverse = 1.0 / pivot
        for i in range(1, HALF_BAND + 1):
            ratio = row[i] * inverse
            below = band[j + i]
            for k in range(HALF_BAND):
                below[k] -= ratio * row[i + k]
        for i in range(1, HALF_BAND + 1):
            row[i] *= inverse
        row[0] = inverse
    return negative


@kernel
def solve(band: NDArray[np.float64], size: int, values: NDArray[np.float64]) -> None:
    """Solve A x = b in place with a band from `factor`.

    Parameters
    ----------
    band, size
        As `factor` left them.
    values
        b on entry, x on return, shape (size + HALF_BAND,); what stands behind `size` is lost.
    """
    for j in range(size, size + HALF_BAND):
        values[j] = 0.0
    for j in range(size):
        row = band[j]
        value = values[j]
        for k in range(1, HALF_BAND + 1):
            values[j + k] -= row[k] * value
    for j in range(size, size + HALF_BAND):
        values[j] = 0.0
    for j in range(size - 1, -1, -1):
        row = band[j]
        value = values[j] * row[0]
        for k in range(1, HALF_BAND + 1):
            value -= row[k] * values[j + k]
        values[j] = value


@kernel
def factor_general(band: NDArray[np.float64], low: NDArray[np.float64], size: int) -> int:
    """Factor A = L U in place, for a matrix of symmetric shape and unsymmetric values.

    Pivots are not sought here either: the matrices are those of `factor` with something small and
    unsymmetric added.

    Parameters
    ----------
    band
        As in `factor`: the upper half of A on entry; on return the inverse pivots and the rows of U
        over them.
    low
        Of the same shape, the lower half: row j holds at k > 0 A[j + k, j]; on return L D.
    size
        Number of unknowns.

    Returns
    -------
    int
        Number of negative pivots; -1 when a pivot is zero or not finite.

    Notes
    -----
    Costs 128 multiplications an unknown.
    """
    negative = 0
    for j in range(size):
        row = band[j]
        column = low[j]
        pivot = row[0]
        if not (pivot != 0.0 and abs(pivot) < np.inf):
            return -1
        if pivot < 0.0:
            negative += 1
        inverse = 1.0 / pivot
        for i in range(1, HALF_BAND + 1):
            row[i] *= inverse
        for i in range(1, HALF_BAND + 1):
            left = column[i]
            right = row[i]
            below = band[j + i]
            beside = low[j + i]
            for k in range(HALF_BAND):
                below[k] -= left * row[i + k]
                beside[k] -= right * column[i + k]
        row[0] = inverse
    return negative


@kernel
def solve_general(
    band: NDArray[np.float64], low: NDArray[np.float64], size: int, values: NDArray[np.float64]
) -> None:
    """Solve A x = b in place with the halves from `factor_general`; as `solve` otherwise."""
    for j in range(size, size + HALF_BAND):
        values[j] = 0.0
    for j in range(size):
        column = low[j]
        value = values[j] * band[j, 0]
        values[j] = value
        for k in range(1, HALF_BAND + 1):
            values[j + k] -= column[k] * value
    for j in range(size, size + HALF_BAND):
        values[j] = 0.0
    for j in range(size - 1, -1, -1):
        row = band[j]
        value = values[j]
        for k in range(1, HALF_BAND + 1):
            value -= row[k] * values[j + k]
        values[j] = value
