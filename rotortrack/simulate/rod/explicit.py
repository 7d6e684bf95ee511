"""Explicit Euler steps of the rod, plain and by the paper's rule, for comparison.

Both move by dt times the velocity of the constrained rod and then bring the links back to their
length. The plain one has a fixed step. The paper's chooses each step so that no vertex moves by
more than 20 pm, which knows nothing of stability: where the rod moves slowly the steps grow beyond
what bending allows, the shape shakes, and only the shaking holds the steps back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.rod.implicit import Room, Shape
from rotortrack.simulate.rod.parameters import (
    BENDING_PN_NM2,
    EDGE_NM,
    FRICTION_LENGTH_NM,
    ZETA_PERP_PER_NM,
)
from rotortrack.simulate.rod.projection import constrained_velocity, project_lengths


def longest_stable_step_us(rod: NDArray[np.float64]) -> float:
    """Longest explicit step that does not amplify bending: 2 zeta l^3 / (16 B), us.

    zeta is the drag of an inner vertex. The stiffest mode is the zigzag; 0.415 ns for 51 vertices
    on 450 nm.
    """
    drag = rod[ZETA_PERP_PER_NM] * rod[FRICTION_LENGTH_NM]
    return float(drag * rod[EDGE_NM] ** 3 / (8.0 * rod[BENDING_PN_NM2]))


@kernel
def explicit_step(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    shape: Shape,
    dt_us: float,
    cap_nm: float,
    room: Room,
    moved: NDArray[np.float64],
) -> float:
    """Write the shape after an explicit Euler step to `moved` and return the step taken, us.

    Order 1 in time; needs steps below `longest_stable_step_us`.

    Parameters
    ----------
    x, rod, shape
        Vertices (n, 3) in nm; the rod's parameters; what `look` found at x.
    dt_us, cap_nm
        Longest step and largest displacement of a vertex in it.
    room, moved
        Memory, whose `tri[2]` is left with the last correction of lengths; result (n, 3).

    Returns
    -------
    float
        The step; -1 where the links cannot be brought back to their length.

    Notes
    -----
    About 5 us for 51 vertices.
    """
    constrained_velocity(
        x, shape.force, shape.tangent, shape.drag, room.directions, room.tri, moved
    )
    fastest = 0.0
    for i in range(x.shape[0]):
        speed = np.sqrt(moved[i, 0] ** 2 + moved[i, 1] ** 2 + moved[i, 2] ** 2)
        fastest = max(fastest, speed)
    step = min(dt_us, cap_nm / fastest) if fastest > 0.0 else dt_us
    for i in range(x.shape[0]):
        for c in range(3):
            moved[i, c] = x[i, c] + step * moved[i, c]
    solves = project_lengths(
        moved, rod[EDGE_NM], shape.tangent, shape.drag, room.directions, room.tri
    )
    return step if solves >= 0 else -1.0
