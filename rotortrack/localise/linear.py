"""Small symmetric systems inside kernels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel


@kernel
def cholesky(matrix: NDArray[np.float64], size: int) -> bool:
    """Replace the lower triangle of a positive definite matrix by its Cholesky factor.

    Returns
    -------
    bool
        False when the matrix is not numerically positive definite.
    """
    for a in range(size):
        for b in range(a + 1):
            total = matrix[a, b]
            for c in range(b):
                total -= matrix[a, c] * matrix[b, c]
            if a == b:
                if not total > 1e-14 * matrix[a, a]:
                    return False
                matrix[a, a] = math.sqrt(total)
            else:
                matrix[a, b] = total / matrix[b, b]
    return True


@kernel
def solve_factored(factor: NDArray[np.float64], right: NDArray[np.float64], size: int) -> None:
    """Solve ``L L^T x = right`` in place for a factor of :func:`cholesky`."""
    for a in range(size):
        total = right[a]
        for c in range(a):
            total -= factor[a, c] * right[c]
        right[a] = total / factor[a, a]
    for a in range(size - 1, -1, -1):
        total = right[a]
        for c in range(a + 1, size):
            total -= factor[c, a] * right[c]
        right[a] = total / factor[a, a]


@kernel
def invert(matrix: NDArray[np.float64], inverse: NDArray[np.float64]) -> bool:
    """Invert a symmetric positive definite matrix given by its lower triangle.

    The matrix is scaled to a unit diagonal first, because its rows differ by many orders of
    magnitude (pixels against photons).

    Parameters
    ----------
    matrix, inverse
        (n, n); `matrix` is overwritten, `inverse` is filled on success.

    Returns
    -------
    bool
        False when the matrix is not numerically positive definite.
    """
    size = matrix.shape[0]
    scale = np.empty(size)
    for a in range(size):
        if not matrix[a, a] > 0.0:
            return False
        scale[a] = 1.0 / math.sqrt(matrix[a, a])
    for a in range(size):
        for b in range(a + 1):
            matrix[a, b] *= scale[a] * scale[b]
    if not cholesky(matrix, size):
        return False
    column = np.empty(size)
    for b in range(size):
        column[:] = 0.0
        column[b] = 1.0
        solve_factored(matrix, column, size)
        for a in range(size):
            inverse[a, b] = column[a] * scale[a] * scale[b]
    return True
