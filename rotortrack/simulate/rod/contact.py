"""Contact of the rod with the membrane: the block r > R, |z| < H, with a hole whose rim is round.

The signed distance d to the block is positive in the fluid, and the rod's axis keeps the rod's
radius a: penetration p = max(a - d, 0). A vertex wall pushes with k p along grad d. A segment wall
measures p at five points of each segment, 2 nm apart, so that no segment cuts a corner between its
vertices, and combines them to the power mean P = (mean p^4)^(1/4) with the energy k P^2 / 2. A
segment that lies flat has P = p at any number of points; one that a single point holds has
P = 0.67 p, and 0.9 k of stiffness if that is a vertex that two segments share. Each point shares
its force between the segment's two vertices.

The wall of the paper pushes upwards only, with k (a - height) on vertices outside the hole, however
deep they are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.rod.leash import add_leash_hessian
from rotortrack.simulate.rod.parameters import (
    EDGE_NM,
    HALF_MEMBRANE_NM,
    PORE_RADIUS_NM,
    RIM_NM,
    ROD_RADIUS_NM,
    WALL,
    WALL_STIFFNESS_PN_NM,
)

POINTS = 5
"""Points of a segment, its vertices included."""


@kernel
def wall_distance(r_nm: float, z_nm: float, rod: NDArray[np.float64]) -> tuple[float, float, float]:
    """Give the signed distance to the membrane, nm, and its gradient (r and z components).

    The distance is negative inside, where the gradient points along the shortest way out.
    """
    inwards = rod[PORE_RADIUS_NM] + rod[RIM_NM] - r_nm
    upwards = abs(z_nm) - (rod[HALF_MEMBRANE_NM] - rod[RIM_NM])
    side = 1.0 if z_nm >= 0.0 else -1.0
    if inwards > 0.0 and upwards > 0.0:
        distance = math.sqrt(inwards * inwards + upwards * upwards)
        return distance - rod[RIM_NM], -inwards / distance, side * upwards / distance
    if inwards > upwards:
        return inwards - rod[RIM_NM], -1.0, 0.0
    return upwards - rod[RIM_NM], 0.0, side


@kernel
def deepest_nm(positions_nm: NDArray[np.float64], rod: NDArray[np.float64]) -> float:
    """Give how deep the rod's axis went into the membrane, nm, negative where it stayed outside.

    Parameters
    ----------
    positions_nm
        Shapes of vertices, nm, shape (k, n, 3); segments are looked at in their quarters, too.
    rod
        Parameters of the rod, with a membrane.
    """
    deepest = -np.inf
    for k in range(positions_nm.shape[0]):
        for i in range(positions_nm.shape[1] - 1):
            for quarter in range(5):
                part = quarter / 4.0
                x = (1.0 - part) * positions_nm[k, i] + part * positions_nm[k, i + 1]
                distance = wall_distance(math.sqrt(x[0] * x[0] + x[1] * x[1]), x[2], rod)[0]
                deepest = max(deepest, -distance)
    return deepest


@kernel
def add_contact_force(
    x: NDArray[np.float64], rod: NDArray[np.float64], force: NDArray[np.float64]
) -> None:
    """Add the wall's push to `force`.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).
    rod
        Parameters of the rod; without a wall nothing is added.
    force
        Force on each vertex, pN, shape (n, 3).

    Notes
    -----
    1.5 us for 51 vertices that all touch, 2 us for a docked rod.
    """
    kind = rod[WALL]
    if kind == 0.0:
        return
    n = x.shape[0]
    stiffness = rod[WALL_STIFFNESS_PN_NM]
    if kind == 3.0:
        push = np.empty((POINTS, 6))
        for i in range(n - 1):
            side = _face(x, i, rod)
            if side != 0.0:
                low, high, _, _ = _press_face(side * x[i, 2], side * x[i + 1, 2], rod)
                force[i, 2] += side * low
                force[i + 1, 2] += side * high
                continue
            if not _touch_segment(x, i, rod, push):
                continue
            for j in range(POINTS):
                share = j / (POINTS - 1.0)
                for c in range(3):
                    part = push[j, 5] * push[j, 0] * push[j, 1 + c]
                    force[i, c] += (1.0 - share) * part
                    force[i + 1, c] += share * part
        return
    for i in range(n):
        depth, nx, ny, nz, _ = _touch(x[i, 0], x[i, 1], x[i, 2], rod)
        if depth > 0.0:
            force[i, 0] += stiffness * depth * nx
            force[i, 1] += stiffness * depth * ny
            force[i, 2] += stiffness * depth * nz


@kernel
def contact_energy(x: NDArray[np.float64], rod: NDArray[np.float64]) -> float:
    """Give the energy stored in the wall, pN nm.

    The upwards wall ends at the hole's edge like a cliff and stores none: it can do work.
    """
    kind = rod[WALL]
    total = 0.0
    if kind == 3.0:
        push = np.empty((POINTS, 6))
        for i in range(x.shape[0] - 1):
            if _touch_segment(x, i, rod, push):
                # P is homogeneous of degree 1, so that its energy is half its work.
                for j in range(POINTS):
                    total += push[j, 5] * push[j, 0] * push[j, 0]
    elif kind == 2.0:
        for i in range(x.shape[0]):
            depth = _touch(x[i, 0], x[i, 1], x[i, 2], rod)[0]
            total += rod[WALL_STIFFNESS_PN_NM] * depth * depth
    return 0.5 * total


@kernel
def add_contact_hessian(
    x: NDArray[np.float64], rod: NDArray[np.float64], blocks: NDArray[np.float64]
) -> None:
    """Add the stiffness of wall and tether, -dF/dx of each vertex, for an implicit step.

    Positive semidefinite: the stiffness along the normal, and around the axis where the wall is
    hollow. That between the two vertices of a segment is added to the vertices themselves; the true
    stiffness is at most 1.52 times the result, less than the 2 at which implicit steps grow.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).
    rod
        Parameters of the rod.
    blocks
        Stiffness of each vertex, pN/nm, shape (n, 3, 3).
    """
    add_leash_hessian(x, rod, blocks)
    kind = rod[WALL]
    if kind == 0.0:
        return
    n = x.shape[0]
    if kind == 3.0:
        push = np.empty((POINTS, 6))
        for i in range(n - 1):
            side = _face(x, i, rod)
            if side != 0.0:
                _, _, low, high = _press_face(side * x[i, 2], side * x[i + 1, 2], rod)
                blocks[i, 2, 2] += low
                blocks[i + 1, 2, 2] += high
                continue
            if not _touch_segment(x, i, rod, push):
                continue
            for j in range(POINTS):
                if push[j, 0] > 0.0:
                    share = j / (POINTS - 1.0)
                    _add_block(push[j], (1.0 - share) * push[j, 5], blocks[i])
                    _add_block(push[j], share * push[j, 5], blocks[i + 1])
        return
    point = np.empty(6)
    for i in range(n):
        point[0], point[1], point[2], point[3], point[4] = _touch(x[i, 0], x[i, 1], x[i, 2], rod)
        if point[0] > 0.0:
            _add_block(point, rod[WALL_STIFFNESS_PN_NM], blocks[i])


@kernel
def _touch(
    x: float, y: float, z: float, rod: NDArray[np.float64]
) -> tuple[float, float, float, float, float]:
    """Give penetration (0 without contact), normal, and the hollow's curvature around the axis."""
    reach = rod[HALF_MEMBRANE_NM] + rod[ROD_RADIUS_NM]
    square = x * x + y * y
    if rod[WALL] == 1.0:
        outside = square > rod[PORE_RADIUS_NM] ** 2
        return max(reach - z, 0.0) if outside else 0.0, 0.0, 0.0, 1.0, 0.0
    # Before the root is taken: above a face, and in the middle of the hole.
    core = rod[PORE_RADIUS_NM] + rod[RIM_NM]
    if square >= core * core and abs(z) >= rod[HALF_MEMBRANE_NM]:
        return max(reach - abs(z), 0.0), 0.0, 0.0, 1.0 if z >= 0.0 else -1.0, 0.0
    free = rod[PORE_RADIUS_NM] - rod[ROD_RADIUS_NM]
    if square <= free * free or abs(z) >= reach:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    r = math.sqrt(square)
    distance, along_r, along_z = wall_distance(r, z, rod)
    scale = along_r / r
    depth = max(rod[ROD_RADIUS_NM] - distance, 0.0)
    return depth, scale * x, scale * y, along_z, max(-scale, 0.0)


@kernel
def _face(x: NDArray[np.float64], i: int, rod: NDArray[np.float64]) -> float:
    """Give the side, 1 or -1, of a segment that can touch nothing but a flat face, otherwise 0."""
    half = rod[HALF_MEMBRANE_NM]
    clear = rod[PORE_RADIUS_NM] + rod[RIM_NM] + rod[EDGE_NM]
    for j in range(i, i + 2):
        if x[j, 0] * x[j, 0] + x[j, 1] * x[j, 1] < clear * clear:
            return 0.0
    if min(x[i, 2], x[i + 1, 2]) >= half:
        return 1.0
    return -1.0 if max(x[i, 2], x[i + 1, 2]) <= -half else 0.0


@kernel
def _press_face(
    low_nm: float, high_nm: float, rod: NDArray[np.float64]
) -> tuple[float, float, float, float]:
    """Give push and stiffness of both ends of a segment at these heights, as `_touch_segment`."""
    low = rod[HALF_MEMBRANE_NM] + rod[ROD_RADIUS_NM] - low_nm
    high = rod[HALF_MEMBRANE_NM] + rod[ROD_RADIUS_NM] - high_nm
    deepest = max(low, high)
    if deepest <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    inverse = 1.0 / deepest
    mean = 0.0
    push_low = push_high = stiff_low = stiff_high = 0.0
    for j in range(POINTS):
        share = j / (POINTS - 1.0)
        depth = max(low + share * (high - low), 0.0)
        weight = (depth * inverse) ** 2
        mean += weight * weight / POINTS
        stiff_low += (1.0 - share) * weight
        stiff_high += share * weight
        push_low += (1.0 - share) * weight * depth
        push_high += share * weight * depth
    scale = rod[WALL_STIFFNESS_PN_NM] / (math.sqrt(mean) * POINTS)
    return scale * push_low, scale * push_high, scale * stiff_low, scale * stiff_high


@kernel
def _touch_segment(
    x: NDArray[np.float64], i: int, rod: NDArray[np.float64], push: NDArray[np.float64]
) -> bool:
    """Write penetration, normal, curvature and stiffness of a segment's points; False without."""
    reach = rod[HALF_MEMBRANE_NM] + rod[ROD_RADIUS_NM]
    if min(x[i, 2], x[i + 1, 2]) >= reach or max(x[i, 2], x[i + 1, 2]) <= -reach:
        return False
    deepest = 0.0
    for j in range(POINTS):
        share = j / (POINTS - 1.0)
        push[j, 0], push[j, 1], push[j, 2], push[j, 3], push[j, 4] = _touch(
            x[i, 0] + share * (x[i + 1, 0] - x[i, 0]),
            x[i, 1] + share * (x[i + 1, 1] - x[i, 1]),
            x[i, 2] + share * (x[i + 1, 2] - x[i, 2]),
            rod,
        )
        deepest = max(deepest, push[j, 0])
    if deepest == 0.0:
        return False
    inverse = 1.0 / deepest
    mean = 0.0
    for j in range(POINTS):
        push[j, 5] = (push[j, 0] * inverse) ** 2
        mean += push[j, 5] * push[j, 5]
    mean /= POINTS
    # P dP/dp_j = p_j (p_j / deepest)^2 mean^(2/4 - 1) / POINTS
    scale = rod[WALL_STIFFNESS_PN_NM] / (math.sqrt(mean) * POINTS)
    for j in range(POINTS):
        push[j, 5] *= scale
    return True


@kernel
def _add_block(point: NDArray[np.float64], stiffness: float, block: NDArray[np.float64]) -> None:
    """Add k (n n^T + p c phi phi^T), phi around the axis, of one point to a vertex's block."""
    for c in range(3):
        for d in range(3):
            block[c, d] += stiffness * point[1 + c] * point[1 + d]
    level = point[1] * point[1] + point[2] * point[2]
    if point[4] > 0.0 and level > 0.0:
        around = stiffness * point[0] * point[4] / level
        block[0, 0] += around * point[2] * point[2]
        block[0, 1] -= around * point[1] * point[2]
        block[1, 0] -= around * point[1] * point[2]
        block[1, 1] += around * point[1] * point[1]
