"""The linearly implicit step of the rod: displacements and tensions in one banded solve.

Bending limits an explicit step to fractions of a nanosecond, as the rate of its stiffest mode grows
with the fourth power of the number of vertices. Here the stiff part of the force is taken at the
end of the step to first order, F(x + d) = F(x) - K d, and the links are kept by tensions T:

    (Z / dt + theta K) d + J^T T = F(x)
    J d                          = 0

K is the stiffness in bending of a straight rod with each joint's share raised by its angle
(`joint_stiffness`), the pull of stretched links across them, the contact's Hessian, and the slope
of the field's force, which alone is not symmetric.
Unknowns are ordered d_0, T_0, d_1, T_1, ..., so the matrix is a band of half-width 8.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.rod.banded import (
    HALF_BAND,
    WIDTH,
    factor,
    factor_general,
    solve,
    solve_general,
)
from rotortrack.simulate.rod.contact import add_contact_hessian
from rotortrack.simulate.rod.elasticity import joint_stiffness
from rotortrack.simulate.rod.field_stiffness import add_to_halves
from rotortrack.simulate.rod.forces import total_force
from rotortrack.simulate.rod.friction import drag_frames
from rotortrack.simulate.rod.parameters import EDGE_NM
from rotortrack.simulate.rod.projection import link_directions, project_lengths


class Shape(NamedTuple):
    """What a step has to know at the shape from which it sets out.

    force (n, 3) in pN; tangent (n, 3); drag (n, 2) across and along, pN us/nm; stiffness in pN/nm:
    of the joints (n,), and of the contact (n, 3, 3).
    """

    force: NDArray[np.float64]
    tangent: NDArray[np.float64]
    drag: NDArray[np.float64]
    bending: NDArray[np.float64]
    contact: NDArray[np.float64]


class Room(NamedTuple):
    """Memory for the linear algebra of one rod; `tri` row 2 and `tension` are results as well."""

    band: NDArray[np.float64]
    values: NDArray[np.float64]
    directions: NDArray[np.float64]
    tri: NDArray[np.float64]
    tension: NDArray[np.float64]
    low: NDArray[np.float64]
    field: NDArray[np.float64]


@kernel
def new_shape(n: int) -> Shape:
    """Make room for what is known at one shape of n vertices."""
    return Shape(
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.zeros((n, 2)),
        np.zeros(n),
        np.zeros((n, 3, 3)),
    )


@kernel
def new_room(n: int, in_field: bool = False) -> Room:
    """Make room for the linear algebra of n vertices; no link is under tension.

    In a field there is room for its stiffness too, `field` (n - 1, 3, 3) in pN/nm, which whoever
    steps keeps up to date.
    """
    size = 4 * n - 1 + HALF_BAND
    links = n - 1 if in_field else 0
    return Room(
        np.zeros((size, WIDTH)),
        np.zeros(size),
        np.zeros((n - 1, 3)),
        np.zeros((3, n - 1)),
        np.zeros(n - 1),
        np.zeros((size if in_field else 0, WIDTH)),
        np.zeros((links, 3, 3)),
    )


@kernel
def look(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    r_nm: NDArray[np.float64],
    z_nm: NDArray[np.float64],
    nodes: NDArray[np.float64],
    shape: Shape,
) -> int:
    """Write forces, friction and stiffness at x, (n, 3) in nm; return a folded joint or -1."""
    folded = total_force(x, rod, r_nm, z_nm, nodes, shape.force)
    drag_frames(x, rod, shape.tangent, shape.drag)
    joint_stiffness(x, rod, shape.bending)
    shape.contact[:] = 0.0
    add_contact_hessian(x, rod, shape.contact)
    return folded


@kernel
def assemble(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    shape: Shape,
    dt_us: float,
    theta: float,
    room: Room,
) -> None:
    """Write the symmetric part of the matrix, all but the field's, and the right-hand side."""
    n = x.shape[0]
    band = room.band
    directions = room.directions
    band[:] = 0.0
    link_directions(x, directions)
    rate = 1.0 / dt_us
    for i in range(n):
        across = shape.drag[i, 0] * rate
        along = shape.drag[i, 1] * rate - across
        for c in range(3):
            row = band[4 * i + c]
            slope = along * shape.tangent[i, c]
            for d in range(c, 3):
                row[d - c] = slope * shape.tangent[i, d] + theta * shape.contact[i, c, d]
            row[0] += across
            room.values[4 * i + c] = shape.force[i, c]
    for i in range(1, n - 1):
        share = theta * shape.bending[i]
        for c in range(3):
            j = 4 * (i - 1) + c
            band[j, 0] += share
            band[j, 4] -= 2.0 * share
            band[j, 8] += share
            band[j + 4, 0] += 4.0 * share
            band[j + 4, 4] -= 2.0 * share
            band[j + 8, 0] += share
    edge = rod[EDGE_NM]
    for i in range(n - 1):
        pull = theta * max(room.tension[i], 0.0) / edge
        for c in range(3):
            j = 4 * i + c
            band[j, 3 - c] = -directions[i, c]
            band[4 * i + 3, 1 + c] = directions[i, c]
            band[j, 0] += pull
            band[j, 4] -= pull
            band[j + 4, 0] += pull
        room.values[4 * i + 3] = 0.0


@kernel
def _add_field(room: Room, size: int, theta: float) -> None:
    """Copy the assembled half to the other side and add the field's stiffness to both."""
    for j in range(size):
        for k in range(1, HALF_BAND + 1):
            room.low[j, k] = room.band[j, k]
    for j in range(size, size + HALF_BAND):
        for k in range(WIDTH):
            room.low[j, k] = 0.0
    add_to_halves(room.field, theta, room.band, room.low)


@kernel
def implicit_step(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    shape: Shape,
    dt_us: float,
    theta: float,
    room: Room,
    moved: NDArray[np.float64],
) -> bool:
    """Write the shape after dt to `moved`, links at their length; False where that fails.

    Order 1 in time. Stable at any step in bending, contact, the pull of stretched links and, where
    the room holds its stiffness, in the field; the push of compressed links is explicit.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).
    rod
        Parameters of the rod.
    shape
        As from `look` at x. Whoever adds a force of their own adds it to `shape.force`: it then
        moves the rod through the same constrained mobility as all others.
    dt_us, theta
        Step; how much of the stiff forces is taken at its end (1: all, 1/2: as much as at its
        beginning, which keeps the equilibrium variance of linear modes under noise).
    room
        Memory. Its `tension` holds the tensions of earlier steps, pN, that stiffen the rod across
        its links; the step's own are left in `values[3::4]` (positive where a link is pulled).
    moved
        Result, shape (n, 3).

    Notes
    -----
    About 15 us for 51 vertices, 20 us in a field.
    """
    n = x.shape[0]
    size = 4 * n - 1
    assemble(x, rod, shape, dt_us, theta, room)
    # Other signs of the pivots mean a step longer than it takes an unstable shape to grow e-fold,
    # after which the equations would hold the rod where it cannot stay.
    if room.field.shape[0] > 0:
        _add_field(room, size, theta)
        if factor_general(room.band, room.low, size) != n - 1:
            return False
        solve_general(room.band, room.low, size, room.values)
    else:
        if factor(room.band, size) != n - 1:
            return False
        solve(room.band, size, room.values)
    for i in range(n):
        for c in range(3):
            moved[i, c] = x[i, c] + room.values[4 * i + c]
    edge = rod[EDGE_NM]
    return project_lengths(moved, edge, shape.tangent, shape.drag, room.directions, room.tri) >= 0


@kernel
def keep_tensions(room: Room) -> None:
    """Let the tensions of the last solve stiffen the rod in the steps to come."""
    for i in range(room.tension.shape[0]):
        value = room.values[4 * i + 3]
        room.tension[i] = value if math.isfinite(value) else 0.0
