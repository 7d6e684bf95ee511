"""Finite-element spaces on a mesh: shape functions, weights and numbering from scikit-fem.

Matrices are put together here by batched products over all cells, several times faster than form by
form. Every integral carries the weight r of the axisymmetric volume (2 pi left out).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray
from skfem import Basis, ElementQuad1, ElementQuad2, MeshQuad
from skfem.quadrature import get_quadrature
from skfem.refdom import RefLine, RefQuad

from rotortrack.simulate.field.mesh import Floats, Grid

Indices = NDArray[np.int64]
_ORDER = 7
"""Polynomials up to this order are integrated exactly: 4 x 4 Gauss points."""


class Space:
    """Q2 and Q1 functions on a mesh, with what their integrals need.

    Attributes
    ----------
    nodes2, nodes1
        Numbers (cells, 9) and (cells, 4) of the functions of each cell.
    n2, n1
        How many there are.
    points
        Positions (2, n2) of the Q2 nodes, nm.
    value, by_r, by_z
        Q2 functions and their slopes at the quadrature points, (cells, points, 9).
    value1
        Q1 functions there, (points, 4).
    weight
        Weight of each point, r included, (cells, points), nm3.
    radius
        r of each point, nm.
    """

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        mesh = MeshQuad.init_tensor(grid.r_nm, grid.z_nm)
        centre = mesh.p[:, mesh.t].mean(axis=1)
        i = np.searchsorted(grid.r_nm, centre[0]) - 1
        j = np.searchsorted(grid.z_nm, centre[1]) - 1
        fluid = ~grid.solid[i, j]
        self.mesh = mesh.remove_elements(np.flatnonzero(~fluid))
        # Dropping vertices keeps the order of the cells that stay.
        self.cell_of = np.full(grid.solid.shape, -1)
        self.cell_of[i[fluid], j[fluid]] = np.arange(fluid.sum())
        basis2 = Basis(self.mesh, ElementQuad2(), intorder=2)
        basis1 = Basis(self.mesh, ElementQuad1(), intorder=2)
        self._basis = basis2
        self.nodes2: Indices = np.ascontiguousarray(basis2.element_dofs.T, dtype=np.int64)
        self.nodes1: Indices = np.ascontiguousarray(basis1.element_dofs.T, dtype=np.int64)
        self.n2, self.n1 = int(basis2.N), int(basis1.N)
        self.sharp = np.asarray(basis2.doflocs, dtype=float)
        self.points = self.sharp if grid.rim is None else grid.rim.displaced(self.sharp)
        self.points1 = np.asarray(basis1.doflocs, dtype=float)

        local, weights = get_quadrature(RefQuad, _ORDER)
        shape, slopes = reference_q2(local)
        jacobian = np.einsum("kcn,qnl->cqkl", self.points[:, self.nodes2], slopes)
        determinant = (
            jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0]
        )
        self.by_r, self.by_z = physical_slopes(jacobian, slopes)
        self.value = np.broadcast_to(shape, self.by_r.shape)
        element1 = ElementQuad1()
        self.value1 = np.stack([element1.lbasis(local, n)[0] for n in range(4)], axis=-1)
        self.radius = np.einsum("cn,qn->cq", self.points[0][self.nodes2], shape)
        self.height = np.einsum("cn,qn->cq", self.points[1][self.nodes2], shape)
        self.weight = np.abs(determinant) * weights * self.radius
        self._facets = self._named_facets()

    def _named_facets(self) -> dict[str, Indices]:
        facets = self.mesh.boundary_facets()
        r, z = self.mesh.p[:, self.mesh.facets[:, facets]].mean(axis=1)
        grid = self.grid
        tiny = 1e-9 * (grid.r_nm[-1] + grid.z_nm[-1] - grid.z_nm[0])
        axis, side = r < tiny, r > grid.r_nm[-1] - tiny
        trans, cis = z < grid.z_nm[0] + tiny, z > grid.z_nm[-1] - tiny
        named = {"axis": axis, "side": side, "trans": trans, "cis": cis}
        named["wall"] = ~(axis | side | trans | cis)
        return {name: facets[chosen] for name, chosen in named.items()}

    def boundary(self, *names: str) -> Indices:
        """Numbers of the Q2 nodes on the named parts of the boundary."""
        none = np.zeros(0, dtype=np.int64)
        return np.unique(np.concatenate([none, *(self._edges(name).ravel() for name in names)]))

    def _edges(self, name: str) -> Indices:
        facets = self._facets[name]
        ends = self._basis.nodal_dofs[0][self.mesh.facets[:, facets]]
        return np.stack([ends[0], self._basis.facet_dofs[0][facets], ends[1]], axis=1)

    def boundary_weight(self, name: str) -> Floats:
        """Integrals of r times each Q2 function over a part of the boundary, (n2,), nm2."""
        edges = self._edges(name)
        at, weights = get_quadrature(RefLine, _ORDER)
        t = at[0]
        shape = np.stack([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], axis=-1)
        slope = np.stack([4 * t - 3, 4 - 8 * t, 4 * t - 1], axis=-1)
        position = self.points[:, edges]
        length = np.hypot(*np.einsum("ken,qn->keq", position, slope))
        radius = np.einsum("en,qn->eq", position[0], shape)
        parts = np.einsum("eq,qn->en", length * radius * weights, shape)
        return np.asarray(np.bincount(edges.ravel(), parts.ravel(), minlength=self.n2), float)

    def at_points(self, nodal: Floats) -> Floats:
        """Values (cells, points) of a Q2 function given by its nodes."""
        return np.asarray(nodal[self.nodes2] @ self.value[0].T)

    def slopes(self, nodal: Floats) -> tuple[Floats, Floats]:
        """Its slopes by r and by z, each (cells, points)."""
        local = nodal[self.nodes2][:, :, None]
        return (self.by_r @ local)[..., 0], (self.by_z @ local)[..., 0]

    def products(self, left: Floats, coefficient: Floats, right: Floats) -> Floats:
        """Integrals (cells, n, m) of left_n coefficient right_m."""
        weighted = left * (coefficient * self.weight)[..., None]
        return np.asarray(np.swapaxes(weighted, 1, 2) @ right)

    def loads(self, coefficient: Floats, test: Floats) -> Floats:
        """Integrals (cells, n) of coefficient test_n."""
        return np.asarray(((coefficient * self.weight)[:, None, :] @ test)[:, 0, :])

    def gather(self, local: Floats) -> Floats:
        """Sum (cells, 9) contributions of the cells into (n2,)."""
        return np.asarray(
            np.bincount(self.nodes2.ravel(), local.ravel(), minlength=self.n2), dtype=float
        )


def reference_q2(local: Floats) -> tuple[Floats, Floats]:
    """Q2 functions (points, 9) and slopes (points, 9, 2) at local coordinates (2, points)."""
    element = ElementQuad2()
    pairs = [element.lbasis(local, n) for n in range(9)]
    return (
        np.stack([np.broadcast_to(pair[0], local.shape[1:]) for pair in pairs], axis=-1),
        np.stack([np.asarray(pair[1]).T for pair in pairs], axis=-2),
    )


def physical_slopes(jacobian: Floats, slopes: Floats) -> tuple[Floats, Floats]:
    """Slopes by r and z (..., 9) from those in the cell (..., 9, 2) and d(r, z)/d(local)."""
    (a, b), (c, d) = np.moveaxis(jacobian, (-2, -1), (0, 1))[..., None]
    determinant = a * d - b * c
    first, second = slopes[..., 0], slopes[..., 1]
    return (d * first - c * second) / determinant, (a * second - b * first) / determinant


def sparse_sum(
    rows: Indices, columns: Indices, values: Floats, free: NDArray[np.bool_]
) -> scipy.sparse.csc_matrix[Any]:
    """Sum local matrices (cells, n, m) into a sparse one; held unknowns keep a unit diagonal."""
    n = free.size
    row = np.broadcast_to(rows[:, :, None], values.shape).ravel()
    column = np.broadcast_to(columns[:, None, :], values.shape).ravel()
    keep = free[row] & free[column]
    held = np.flatnonzero(~free)
    return scipy.sparse.csc_matrix(
        (
            np.concatenate([values.ravel()[keep], np.ones(held.size)]),
            (np.concatenate([row[keep], held]), np.concatenate([column[keep], held])),
        ),
        shape=(n, n),
    )


def factorised(matrix: scipy.sparse.csc_matrix[Any]) -> scipy.sparse.linalg.SuperLU:
    """Factorise a matrix of symmetric pattern: 4 times faster so than with the default order.

    The low threshold keeps pivots on the diagonal; leaving it costs Stokes' equations ten times the
    memory, staying on it not one digit that counts (residuals near 1e-11).
    """
    return scipy.sparse.linalg.splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.001,
        options={"SymmetricMode": True},
    )
