"""Bending of the discrete elastic rod: energy, force and the sharpest joint.

With edges e_i = x_{i+1} - x_i of length l, the curvature at inner vertex i is

    kb_i = 2 e_{i-1} x e_i / (l^2 + e_{i-1} . e_i),    |kb_i| = 2 tan(theta_i / 2),

and the energy is E = B/(2l) sum |kb_i|^2. The force is its gradient,

    F_j = -(B/l) sum_i (grad_j kb_i)^T kb_i
    grad_{i-1} kb_i = (2 [e_i] + kb_i e_i^T) / (l^2 + e_{i-1} . e_i)
    grad_{i+1} kb_i = (2 [e_{i-1}] - kb_i e_{i-1}^T) / (l^2 + e_{i-1} . e_i).

The paper prints a plus in the last line and 2 B in place of B. Source: Bergou et al., Discrete
elastic rods, ACM Trans. Graph. 27 (2008) 63.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import RodError
from rotortrack.kernels import kernel
from rotortrack.simulate.rod.parameters import BENDING_PN_NM2, BENDING_SIGN, EDGE_NM

SHARPEST_DEG = 150.0
"""Turn of a joint beyond which the chain no longer stands for a rod."""

_SHARPEST = 1.0 + math.cos(math.radians(SHARPEST_DEG))

_FLOOR = 1e-6
"""Least value of 1 + cos(theta), so that a folded joint gives a finite force."""


@kernel
def add_bending_force(
    x: NDArray[np.float64], rod: NDArray[np.float64], force: NDArray[np.float64]
) -> int:
    """Add the bending force to `force`.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).
    rod
        Parameters of the rod.
    force
        Force on each vertex, pN, shape (n, 3).

    Returns
    -------
    int
        The last joint that turns by more than SHARPEST_DEG, at a finite force; -1 without one.

    Notes
    -----
    About 0.7 us for 51 vertices.
    """
    edge2 = rod[EDGE_NM] * rod[EDGE_NM]
    scale = rod[BENDING_PN_NM2] / rod[EDGE_NM]
    sign = rod[BENDING_SIGN]
    folded = -1
    for i in range(1, x.shape[0] - 1):
        ax = x[i, 0] - x[i - 1, 0]
        ay = x[i, 1] - x[i - 1, 1]
        az = x[i, 2] - x[i - 1, 2]
        bx = x[i + 1, 0] - x[i, 0]
        by = x[i + 1, 1] - x[i, 1]
        bz = x[i + 1, 2] - x[i, 2]
        weight = edge2 + ax * bx + ay * by + az * bz
        if weight < _SHARPEST * edge2:
            folded = i
            weight = max(weight, _FLOOR * edge2)
        inverse = 1.0 / weight
        kx = 2.0 * inverse * (ay * bz - az * by)
        ky = 2.0 * inverse * (az * bx - ax * bz)
        kz = 2.0 * inverse * (ax * by - ay * bx)
        square = kx * kx + ky * ky + kz * kz
        factor = scale * inverse
        below_x = factor * (2.0 * (by * kz - bz * ky) - square * bx)
        below_y = factor * (2.0 * (bz * kx - bx * kz) - square * by)
        below_z = factor * (2.0 * (bx * ky - by * kx) - square * bz)
        above_x = factor * (2.0 * (ay * kz - az * ky) - sign * square * ax)
        above_y = factor * (2.0 * (az * kx - ax * kz) - sign * square * ay)
        above_z = factor * (2.0 * (ax * ky - ay * kx) - sign * square * az)
        force[i - 1, 0] += below_x
        force[i - 1, 1] += below_y
        force[i - 1, 2] += below_z
        force[i + 1, 0] += above_x
        force[i + 1, 1] += above_y
        force[i + 1, 2] += above_z
        force[i, 0] -= below_x + above_x
        force[i, 1] -= below_y + above_y
        force[i, 2] -= below_z + above_z
    return folded


@kernel
def bending_energy(x: NDArray[np.float64], rod: NDArray[np.float64]) -> float:
    """Give the bending energy, pN nm, of vertices x, nm, shape (n, 3).

    In the doubled reading it is the energy whose gradient is that force; the printed force is no
    gradient of anything.
    """
    edge2 = rod[EDGE_NM] * rod[EDGE_NM]
    total = 0.0
    for i in range(1, x.shape[0] - 1):
        ax = x[i, 0] - x[i - 1, 0]
        ay = x[i, 1] - x[i - 1, 1]
        az = x[i, 2] - x[i - 1, 2]
        bx = x[i + 1, 0] - x[i, 0]
        by = x[i + 1, 1] - x[i, 1]
        bz = x[i + 1, 2] - x[i, 2]
        weight = max(edge2 + ax * bx + ay * by + az * bz, _FLOOR * edge2)
        kx = ay * bz - az * by
        ky = az * bx - ax * bz
        kz = ax * by - ay * bx
        total += 4.0 * (kx * kx + ky * ky + kz * kz) / (weight * weight)
    scale: float = 0.5 * rod[BENDING_PN_NM2] / rod[EDGE_NM]
    return scale * total


@kernel
def joint_stiffness(
    x: NDArray[np.float64], rod: NDArray[np.float64], stiffness: NDArray[np.float64]
) -> None:
    """Write each joint's share of the bending stiffness K0 that an implicit step takes.

    K0 = D^T diag(stiffness) D for each component, with D the second difference. A share is
    B/l^3 (3 s^2 - 2 s) with s = sec^2(theta/2): exact across a straight rod, and in the plane of a
    bent joint, whose Hessian grows with the fourth power of the secant.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).
    rod
        Parameters of the rod.
    stiffness
        Share of each vertex, pN/nm, shape (n,); 0 at the ends.
    """
    edge2 = rod[EDGE_NM] * rod[EDGE_NM]
    scale = rod[BENDING_PN_NM2] / (edge2 * rod[EDGE_NM])
    n = x.shape[0]
    stiffness[0] = 0.0
    stiffness[n - 1] = 0.0
    for i in range(1, n - 1):
        dot = edge2
        for c in range(3):
            dot += (x[i, c] - x[i - 1, c]) * (x[i + 1, c] - x[i, c])
        secant2 = 2.0 * edge2 / max(dot, _SHARPEST * edge2)
        stiffness[i] = scale * secant2 * (3.0 * secant2 - 2.0)


def check_shape(positions_nm: NDArray[np.float64]) -> None:
    """Refuse vertices that are no rod.

    Parameters
    ----------
    positions_nm
        Vertices, nm, shape (n, 3).

    Raises
    ------
    RodError
        A vertex is not finite, two neighbours coincide, or a joint turns by more than
        SHARPEST_DEG; the sentence names the first such vertex.
    """
    finite = np.isfinite(positions_nm).all(axis=1)
    if not finite.all():
        raise RodError(f"vertex {int(np.argmin(finite))} of the rod is not at a finite place")
    edges = np.diff(positions_nm, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    if not lengths.all():
        first = int(np.argmin(lengths))
        raise RodError(f"vertices {first} and {first + 1} of the rod coincide: move them apart")
    cosines = np.einsum("ij,ij->i", edges[:-1], edges[1:]) / (lengths[:-1] * lengths[1:])
    folded = cosines < _SHARPEST - 1.0
    if folded.any():
        joint = int(np.argmax(folded)) + 1
        angle = math.degrees(math.acos(max(cosines[joint - 1], -1.0)))
        raise RodError(
            f"the rod turns by {angle:.0f} degrees at vertex {joint}, more than the "
            f"{SHARPEST_DEG:.0f} that its vertices can follow: raise n_vertices, or weaken forces"
        )
