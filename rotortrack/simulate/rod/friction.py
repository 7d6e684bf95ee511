"""Anisotropic friction of the rod's vertices: Z = perp (1 - t t^T) + par t t^T."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.rod.parameters import (
    END_WEIGHT,
    FRICTION_LENGTH_NM,
    ZETA_PAR_PER_NM,
    ZETA_PERP_PER_NM,
)


@kernel
def drag_frames(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    tangent: NDArray[np.float64],
    zeta: NDArray[np.float64],
) -> None:
    """Write tangent and friction of each vertex.

    The tangent is the secant between the neighbours, at the ends the edge. Where the neighbours
    coincide it is the next edge's direction, and zero, with friction across in all directions, if
    that has no length either.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).
    rod
        Parameters of the rod.
    tangent
        Unit tangents, shape (n, 3).
    zeta
        Friction across and along the rod, pN us/nm, shape (n, 2).

    Notes
    -----
    About 0.5 us for 51 vertices.
    """
    n = x.shape[0]
    across = rod[ZETA_PERP_PER_NM] * rod[FRICTION_LENGTH_NM]
    along = rod[ZETA_PAR_PER_NM] * rod[FRICTION_LENGTH_NM]
    for i in range(n):
        below = max(i - 1, 0)
        above = min(i + 1, n - 1)
        if not _write_direction(x, below, above, tangent, i) and below < i < above:
            _write_direction(x, i, above, tangent, i)
        zeta[i, 0] = across
        zeta[i, 1] = along
    for i in (0, n - 1):
        zeta[i, 0] *= rod[END_WEIGHT]
        zeta[i, 1] *= rod[END_WEIGHT]


@kernel
def _write_direction(
    x: NDArray[np.float64], start: int, stop: int, tangent: NDArray[np.float64], i: int
) -> bool:
    """Write the unit vector from vertex start to stop; zero and False where they coincide."""
    dx = x[stop, 0] - x[start, 0]
    dy = x[stop, 1] - x[start, 1]
    dz = x[stop, 2] - x[start, 2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    # One division serves all components; a zero vector stays zero.
    inverse = 1.0 / length if length > 0.0 else 0.0
    tangent[i, 0] = dx * inverse
    tangent[i, 1] = dy * inverse
    tangent[i, 2] = dz * inverse
    return length > 0.0
