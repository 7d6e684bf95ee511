"""Finite elements on the graded mesh, weighted by r, with matrices summed cell by cell.

scikit-fem supplies shape functions, their gradients at the quadrature points and the numbering of
unknowns. A matrix is then one batched product over cells, since every coefficient of the equations
is an array over cells and quadrature points.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
import skfem
from numpy.typing import NDArray

from rotortrack.simulate.field.mesh import Mesh

_ORDER = 6
"""Degree of the polynomials that the quadrature integrates exactly."""

Array = NDArray[np.float64]


class Space:
    """Continuous elements of one degree on all cells of fluid.

    Attributes
    ----------
    value
        (cell, point, function) shape functions at the quadrature points.
    grad
        (2, cell, point, function) their derivatives along r and z.
    weight
        (cell, point) quadrature weight times r.
    r, z
        (cell, point) coordinates.
    dofs
        (cell, function) numbers of the unknowns.
    size
        Number of unknowns.
    """

    def __init__(self, quads: skfem.MeshQuad, degree: int) -> None:
        element = {1: skfem.ElementQuad1, 2: skfem.ElementQuad2}[degree]()
        basis = skfem.Basis(quads, element, intorder=_ORDER)
        fields = [function[0] for function in basis.basis]
        self._basis = basis
        shape = basis.dx.shape
        self.value = np.stack([np.broadcast_to(f.value, shape) for f in fields], axis=-1)
        self.grad = np.stack([np.broadcast_to(f.grad, (2, *shape)) for f in fields], axis=-1)
        self.r, self.z = np.asarray(basis.global_coordinates())
        self.weight = np.asarray(basis.dx) * self.r
        self.dofs: NDArray[np.int64] = np.asarray(basis.element_dofs).T.astype(np.int64)
        self.size = int(basis.N)
        places: Array = np.asarray(basis.doflocs)
        self.r_of, self.z_of = places

    def at_points(self, values: Array) -> Array:
        """Evaluate at the quadrature points, (cell, point)."""
        return np.einsum("cpf,cf->cp", self.value, values[self.dofs], optimize=True)

    def gradient(self, values: Array) -> Array:
        """Differentiate at the quadrature points, (2, cell, point)."""
        return np.einsum("dcpf,cf->dcp", self.grad, values[self.dofs], optimize=True)

    def vector(self, source: Array | None = None, flux: Array | None = None) -> Array:
        """Integrate source * w + flux . grad w for all test functions w.

        Parameters
        ----------
        source, flux
            (cell, point) and (2, cell, point).
        """
        local = np.zeros(self.dofs.shape)
        if source is not None:
            local += np.einsum("cp,cpf->cf", self.weight * source, self.value, optimize=True)
        if flux is not None:
            local += np.einsum("dcp,dcpf->cf", self.weight * flux, self.grad, optimize=True)
        return np.bincount(self.dofs.ravel(), local.ravel(), self.size)

    def on_facets(self, facets: NDArray[np.int64]) -> Array:
        """Integrate w over facets, weighted by r."""
        basis = skfem.FacetBasis(self._basis.mesh, self._basis.elem, facets=facets, intorder=_ORDER)
        weight = np.asarray(basis.dx) * np.asarray(basis.global_coordinates())[0]
        result = np.zeros(self.size)
        for function, dofs in zip(basis.basis, basis.element_dofs, strict=True):
            np.add.at(result, dofs, np.sum(weight * function[0].value, axis=1))
        return result


def quads_of(mesh: Mesh) -> skfem.MeshQuad:
    """Turn the fluid's cells into quadrilaterals of scikit-fem."""
    columns, rows = mesh.fluid.shape
    numbers = np.arange((columns + 1) * (rows + 1)).reshape(columns + 1, rows + 1)
    corners = np.stack(
        [part[mesh.fluid] for part in (
            numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:],
        )]
    )  # fmt: skip
    used, cells = np.unique(corners, return_inverse=True)
    places = np.stack((mesh.r_nm[used // (rows + 1)], mesh.z_nm[used % (rows + 1)]))
    return skfem.MeshQuad(places, cells.reshape(corners.shape))


def block(
    test: Space,
    trial: Space,
    *,
    stiffness: Array | None = None,
    axes: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 0.0), (0.0, 1.0)),
    advection: Array | None = None,
    mass: Array | None = None,
) -> Array:
    """Integrate stiffness grad w . axes grad t + (grad w . advection) t + mass w t, by cells.

    Parameters
    ----------
    stiffness, mass
        (cell, point).
    axes
        Which derivative of w meets which of t.
    advection
        (2, cell, point).

    Returns
    -------
    ndarray
        (cell, test function, trial function).
    """
    result = np.zeros((len(test.dofs), test.dofs.shape[1], trial.dofs.shape[1]))
    if stiffness is not None:
        weight = (test.weight * stiffness)[:, :, np.newaxis]
        for wide, factors in zip(test.grad, axes, strict=True):
            meets = sum(f * narrow for f, narrow in zip(factors, trial.grad, strict=True) if f)
            if np.ndim(meets):
                result += np.matmul((weight * wide).transpose(0, 2, 1), meets)
    rows = None
    if advection is not None:
        rows = np.einsum("dcp,dcpf->cpf", test.weight * advection, test.grad, optimize=True)
    if mass is not None:
        massive = (test.weight * mass)[:, :, np.newaxis] * test.value
        rows = massive if rows is None else rows + massive
    if rows is not None:
        result += np.matmul(rows.transpose(0, 2, 1), trial.value)
    return result


class Assembly:
    """Sums cell matrices of several coupled unknowns into one sparse matrix.

    Parameters
    ----------
    spaces
        One for each unknown, in their order.
    free
        Flags of the unknowns that are not prescribed, over all unknowns.
    """

    def __init__(self, spaces: list[Space], free: NDArray[np.bool_]) -> None:
        offsets = np.cumsum([0, *(space.size for space in spaces)])
        self.slices = [slice(a, b) for a, b in itertools.pairwise(offsets)]
        self.free = free
        self._dofs = [space.dofs + start for space, start in zip(spaces, offsets[:-1], strict=True)]
        self._size = int(offsets[-1])

    def matrix(self, blocks: dict[tuple[int, int], Array]) -> Any:
        """Sum (cell, i, j) blocks by pair of unknowns; CSC matrix over all unknowns."""
        rows, columns, values = [], [], []
        for (a, b), local in blocks.items():
            rows.append(np.broadcast_to(self._dofs[a][:, :, np.newaxis], local.shape).ravel())
            columns.append(np.broadcast_to(self._dofs[b][:, np.newaxis, :], local.shape).ravel())
            values.append(local.ravel())
        shape = self._size, self._size
        parts = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        return scipy.sparse.coo_matrix(parts, shape=shape).tocsc()

    def factorise(self, matrix: Any) -> Any:
        """Factorise the free part."""
        kept = matrix[self.free][:, self.free]
        # The pattern is symmetric, and pivoting off the diagonal would fill the factors beyond use.
        return scipy.sparse.linalg.splu(
            kept.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            options={"SymmetricMode": True},
            diag_pivot_thresh=0.0,
        )
