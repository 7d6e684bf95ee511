"""Rigid links: the tensions that keep their lengths, and the return to them after a step.

Both solve the same tridiagonal system J Z^-1 J^T, in which J are the directions of the links and
Z^-1 is the mobility of the vertices, so that deterministic forces, random ones and corrections of
length all move the rod in the same metric.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel

LENGTH_TOLERANCE = 1e-9
"""Largest relative error of a link after a projection."""

MAXIMUM_SOLVES = 30


@kernel
def add_mobile(
    tangent: NDArray[np.float64],
    drag: NDArray[np.float64],
    i: int,
    factor: float,
    force: NDArray[np.float64],
    moved: NDArray[np.float64],
) -> None:
    """Add factor Z_i^-1 force to `moved`, where Z_i = perp (1 - t t) + par t t.

    Parameters
    ----------
    tangent, drag
        Tangents (n, 3) and drag coefficients across and along them (n, 2).
    i
        The vertex.
    factor, force, moved
        What is added where, shapes (), (3,), (3,).
    """
    across = factor / drag[i, 0]
    along = (factor / drag[i, 1] - across) * (
        tangent[i, 0] * force[0] + tangent[i, 1] * force[1] + tangent[i, 2] * force[2]
    )
    for c in range(3):
        moved[c] += across * force[c] + along * tangent[i, c]


@kernel
def link_directions(x: NDArray[np.float64], directions: NDArray[np.float64]) -> None:
    """Write the unit vectors of the links, shape (n - 1, 3)."""
    for i in range(x.shape[0] - 1):
        square = 0.0
        for c in range(3):
            directions[i, c] = x[i + 1, c] - x[i, c]
            square += directions[i, c] ** 2
        inverse = 1.0 / math.sqrt(square)
        for c in range(3):
            directions[i, c] *= inverse


@kernel
def mobility_matrix(
    directions: NDArray[np.float64],
    tangent: NDArray[np.float64],
    drag: NDArray[np.float64],
    tri: NDArray[np.float64],
) -> None:
    """Write J Z^-1 J^T: diagonal to tri[0], the one beside it to tri[1]."""
    links = directions.shape[0]
    for i in range(links):
        tri[0, i] = 0.0
    for i in range(links + 1):
        across = 1.0 / drag[i, 0]
        along = 1.0 / drag[i, 1] - across
        before = 0.0
        after = 0.0
        if i > 0:
            for c in range(3):
                before += tangent[i, c] * directions[i - 1, c]
            tri[0, i - 1] += across + along * before * before
        if i < links:
            for c in range(3):
                after += tangent[i, c] * directions[i, c]
            tri[0, i] += across + along * after * after
        if 0 < i < links:
            dot = 0.0
            for c in range(3):
                dot += directions[i - 1, c] * directions[i, c]
            tri[1, i - 1] = -(across * dot + along * before * after)


@kernel
def _solve_tridiagonal(tri: NDArray[np.float64], size: int) -> None:
    """Solve the symmetric system tri[0], tri[1] for the right-hand side tri[2], in place."""
    for i in range(1, size):
        ratio = tri[1, i - 1] / tri[0, i - 1]
        tri[0, i] -= ratio * tri[1, i - 1]
        tri[2, i] -= ratio * tri[2, i - 1]
    tri[2, size - 1] /= tri[0, size - 1]
    for i in range(size - 2, -1, -1):
        tri[2, i] = (tri[2, i] - tri[1, i] * tri[2, i + 1]) / tri[0, i]


@kernel
def constrained_velocity(
    x: NDArray[np.float64],
    force: NDArray[np.float64],
    tangent: NDArray[np.float64],
    drag: NDArray[np.float64],
    directions: NDArray[np.float64],
    tri: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> None:
    """Velocities v = Z^-1 (F - J^T T) of a rod whose links keep their lengths, J v = 0.

    Parameters
    ----------
    x, force
        Vertices, nm, and the forces on them, pN, shape (n, 3).
    tangent, drag
        As from `drag_frames`.
    directions, tri
        Room for (n - 1, 3) and (3, n - 1) numbers; on return tri[2] holds the tensions, pN,
        positive where a link is pulled.
    velocity
        Result, nm/us, shape (n, 3).
    """
    n = x.shape[0]
    link_directions(x, directions)
    for i in range(n):
        velocity[i] = 0.0
        add_mobile(tangent, drag, i, 1.0, force[i], velocity[i])
    mobility_matrix(directions, tangent, drag, tri)
    for i in range(n - 1):
        tri[2, i] = 0.0
        for c in range(3):
            tri[2, i] += directions[i, c] * (velocity[i + 1, c] - velocity[i, c])
    _solve_tridiagonal(tri, n - 1)
    _push_links(directions, tangent, drag, tri[2], velocity)


@kernel
def _push_links(
    directions: NDArray[np.float64],
    tangent: NDArray[np.float64],
    drag: NDArray[np.float64],
    tension: NDArray[np.float64],
    moved: NDArray[np.float64],
) -> None:
    """Add Z^-1 times the pull of the links, which draws the ends of each together."""
    for i in range(directions.shape[0]):
        add_mobile(tangent, drag, i, tension[i], directions[i], moved[i])
        add_mobile(tangent, drag, i + 1, -tension[i], directions[i], moved[i + 1])


@kernel
def project_lengths(
    x: NDArray[np.float64],
    edge_nm: float,
    tangent: NDArray[np.float64],
    drag: NDArray[np.float64],
    directions: NDArray[np.float64],
    tri: NDArray[np.float64],
) -> int:
    """Bring all links back to their length, along themselves, in the metric of the drag.

    Newton's method on |x_{i+1} - x_i| = l: each pass is one tridiagonal solve and squares the
    error, so a step that stretches links by 1e-4 of their length needs one or two.

    Parameters
    ----------
    x
        Vertices (n, 3), changed in place.
    edge_nm
        Length l of every link.
    tangent, drag
        Of the shape from which the step set out, as from `drag_frames`.
    directions, tri
        Room as in `constrained_velocity`.

    Returns
    -------
    int
        Tridiagonal solves used; -1 when `MAXIMUM_SOLVES` do not reach `LENGTH_TOLERANCE`.
    """
    n = x.shape[0]
    for solves in range(MAXIMUM_SOLVES):
        worst = 0.0
        link_directions(x, directions)
        for i in range(n - 1):
            length = 0.0
            for c in range(3):
                length += directions[i, c] * (x[i + 1, c] - x[i, c])
            tri[2, i] = length - edge_nm
            worst = max(worst, abs(tri[2, i]))
        if worst <= LENGTH_TOLERANCE * edge_nm:
            return solves
        if not worst < 0.5 * edge_nm:
            return -1
        mobility_matrix(directions, tangent, drag, tri)
        _solve_tridiagonal(tri, n - 1)
        _push_links(directions, tangent, drag, tri[2], x)
    return -1
