"""Anisotropic friction of the rod's vertices: Z = perp (1 - t t^T) + par t t^T.

With `wall_drag = "cylinder"` both are multiplied by the friction of a long cylinder of radius b,
its axis h away from a plane wall, over that of the free rod,

    max(1, (ln(L / 2b) + 0.84) / arcosh(h / b)),    h = b + gap + max(d - a, 0),

where d is the axis' distance from the membrane and a its least one in contact; the gap keeps the
water between them finite. The plane stands for the rim and the lumen's wall as well, and motion
towards it, which is slower still, is taken like motion along it. Only motion is slowed: a flow
along a wall drags a body at rest there with a force that stays finite, so the forces of the field
keep the free rod's friction. Sources: Jeffrey and Onishi, Q. J. Mech. Appl. Math. 34 (1981) 129;
Hunt, Gittes and Howard, Biophys. J. 67 (1994) 766.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.rod.contact import wall_distance
from rotortrack.simulate.rod.parameters import (
    EDGE_NM,
    END_WEIGHT,
    FRICTION_LENGTH_NM,
    HYDRODYNAMIC_RADIUS_NM,
    ROD_RADIUS_NM,
    WALL_DRAG,
    WALL_GAP_NM,
    ZETA_PAR_PER_NM,
    ZETA_PERP_PER_NM,
)

_COINCIDENT = 1e-9


@kernel
def drag_frames(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    tangent: NDArray[np.float64],
    zeta: NDArray[np.float64],
) -> None:
    """Write tangent and friction of each vertex.

    The tangent is the secant between the neighbours, at the ends the edge. Where the neighbours
    coincide (within 1e-9 of a segment) it is the next edge's direction, and zero, with friction
    across in all directions, if that has no length either.

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
    About 0.6 us for 51 vertices, 2 us with the wall's friction.
    """
    n = x.shape[0]
    least = _COINCIDENT * rod[EDGE_NM]
    across = rod[ZETA_PERP_PER_NM] * rod[FRICTION_LENGTH_NM]
    along = rod[ZETA_PAR_PER_NM] * rod[FRICTION_LENGTH_NM]
    for i in range(n):
        below = max(i - 1, 0)
        above = min(i + 1, n - 1)
        if not _write_direction(x, below, above, least, tangent, i):
            _write_direction(x, i, above, least, tangent, i)
        slowing = _wall_slowing(x, i, rod) if rod[WALL_DRAG] > 0.0 else 1.0
        zeta[i, 0] = across * slowing
        zeta[i, 1] = along * slowing
    for i in (0, n - 1):
        zeta[i, 0] *= rod[END_WEIGHT]
        zeta[i, 1] *= rod[END_WEIGHT]


@kernel
def _wall_slowing(x: NDArray[np.float64], i: int, rod: NDArray[np.float64]) -> float:
    """Give the friction of vertex i over that far from the membrane."""
    distance = wall_distance(math.sqrt(x[i, 0] ** 2 + x[i, 1] ** 2), x[i, 2], rod)[0]
    gap = rod[WALL_GAP_NM] + max(distance - rod[ROD_RADIUS_NM], 0.0)
    slowing: float = rod[WALL_DRAG] / math.acosh(1.0 + gap / rod[HYDRODYNAMIC_RADIUS_NM])
    return max(1.0, slowing)


@kernel
def _write_direction(
    x: NDArray[np.float64],
    start: int,
    stop: int,
    least: float,
    tangent: NDArray[np.float64],
    i: int,
) -> bool:
    """Write the unit vector from vertex start to stop; zero and False where they coincide."""
    dx = x[stop, 0] - x[start, 0]
    dy = x[stop, 1] - x[start, 1]
    dz = x[stop, 2] - x[start, 2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    inverse = 1.0 / length if length > least else 0.0
    tangent[i, 0] = dx * inverse
    tangent[i, 1] = dy * inverse
    tangent[i, 2] = dz * inverse
    return length > least
