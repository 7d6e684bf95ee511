"""A solved field: nodal values on the refined tensor grid, and their evaluation anywhere in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import FieldError
from rotortrack.simulate.field.mesh import Mesh
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.space import Array, Space

NODAL: Final = ("phi", "phi_rest", "psi_plus", "psi_minus", "u_r", "u_z")


@dataclass(frozen=True)
class FieldSolution:
    """Potential, salt and flow around a pore.

    Attributes
    ----------
    options
        What was solved.
    mesh
        Cells of the solution.
    nodal
        By name of ``NODAL``: (2 columns + 1, 2 rows + 1) values at corners, edge middles and
        centres of the cells, nan within the membrane; potentials in thermal voltages, flow in
        nm/us.
    thermal_v
        Thermal voltage, V.
    trans_potential_v
        Potential of the trans solution; differs from ``voltage_v`` where the electrical condition
        is not a fixed potential.
    current_a, flow_m3_s
        Electric current and flow of water from trans to cis.
    current_error_rel, flow_error_rel
        Their relative errors as told by a coarser mesh.
    unknowns
        Of the finest mesh: potential, salt and flow.
    newton_steps, flow_passes
        Newton steps, and passes between salt and flow, on the finest mesh.
    seconds
        Wall time of all meshes.
    """

    options: FieldOptions
    mesh: Mesh
    nodal: dict[str, Array]
    thermal_v: float
    trans_potential_v: float
    current_a: float
    flow_m3_s: float
    current_error_rel: float
    flow_error_rel: float
    unknowns: int
    newton_steps: int
    flow_passes: int
    seconds: float

    @property
    def in_equilibrium_split(self) -> bool:
        """Whether the field at rest is an equilibrium that can be subtracted as such."""
        return self.options.cis_mm == self.options.trans_mm

    def evaluate(self, quantity: str, r_nm: Array, z_nm: Array) -> Array:
        """Evaluate a quantity at points in the water.

        Parameters
        ----------
        quantity
            ``potential_v``, ``cation_mm``, ``anion_mm``, ``u_r`` and ``u_z`` (nm/us),
            ``e_applied_r``, ``e_applied_z``, ``e_equilibrium_r``, ``e_equilibrium_z`` (V/m),
            ``lnc_r`` and ``lnc_z`` (1/nm), the gradient of the logarithm of the salt outside the
            double layer.
        r_nm, z_nm
            Coordinates, of one shape.

        Returns
        -------
        ndarray
            nan at points within the membrane.

        Raises
        ------
        FieldError
            Unknown quantity, or a point outside the box.
        """
        r, z = np.broadcast_arrays(np.asarray(r_nm, np.float64), np.asarray(z_nm, np.float64))
        if quantity in {"u_r", "u_z"}:
            return self._at(quantity, r, z)[0]
        if quantity == "potential_v":
            return self._at("phi", r, z)[0] * self.thermal_v
        unit_mm = (self.options.cis_mm + self.options.trans_mm) / 2.0
        if quantity == "cation_mm":
            return np.exp(self._at("psi_plus", r, z)[0] - self._at("phi", r, z)[0]) * unit_mm
        if quantity == "anion_mm":
            return np.exp(self._at("psi_minus", r, z)[0] + self._at("phi", r, z)[0]) * unit_mm
        name, _, axis = quantity.rpartition("_")
        if axis not in {"r", "z"} or name not in {"e_applied", "e_equilibrium", "lnc"}:
            raise FieldError(f"{quantity!r} is not a quantity of a solved field")
        part = 1 if axis == "r" else 2
        if name == "lnc":
            return (self._at("psi_plus", r, z)[part] + self._at("psi_minus", r, z)[part]) / 2.0
        volts_per_m = -self.thermal_v * 1e9
        phi = self._at("phi", r, z)[part]
        if self.in_equilibrium_split:
            rest = self._at("phi_rest", r, z)[part]
        else:
            # No equilibrium exists between unequal salts: the double layer's own potential is what
            # the virtual neutral water beside each point does not have.
            virtual = self._at("psi_plus", r, z)[part] - self._at("psi_minus", r, z)[part]
            rest = phi - virtual / 2.0
        return (phi - rest if name == "e_applied" else rest) * volts_per_m

    def _at(self, name: str, r: Array, z: Array) -> tuple[Array, Array, Array]:
        """Value and derivatives along r and z of the quadratic polynomial of each point's cell."""
        i, along_r = _place(self.mesh.r_nm, r, "r")
        j, along_z = _place(self.mesh.z_nm, z, "z")
        i, j = self._into_water(i, j, along_r, along_z)
        values, slopes = [], []
        for lines, at, s in ((self.mesh.r_nm, i, along_r), (self.mesh.z_nm, j, along_z)):
            size = lines[at + 1] - lines[at]
            t = np.where(s == -1.0, 1.0, np.where(s == 2.0, 0.0, s))
            values.append(((1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)))
            slopes.append(((4 * t - 3) / size, (4 - 8 * t) / size, (4 * t - 1) / size))
        grid = self.nodal[name]
        total = [np.zeros(r.shape) for _ in range(3)]
        for a in range(3):
            for b in range(3):
                node = grid[2 * i + a, 2 * j + b]
                total[0] += node * values[0][a] * values[1][b]
                total[1] += node * slopes[0][a] * values[1][b]
                total[2] += node * values[0][a] * slopes[1][b]
        return total[0], total[1], total[2]

    def _into_water(
        self, i: NDArray[np.int64], j: NDArray[np.int64], along_r: Array, along_z: Array
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Take the fluid cell of points that lie on a face of the membrane.

        Moves the cell index and marks the place in it by -1 (upper end) or 2 (lower end).
        """
        fluid = self.mesh.fluid
        columns, rows = fluid.shape
        for axis, along, most in ((0, along_r, columns), (1, along_z, rows)):
            for edge, step, mark in ((0.0, -1, -1.0), (1.0, 1, 2.0)):
                at = [i, j]
                at[axis] = np.clip(at[axis] + step, 0, most - 1)
                moved = ~fluid[i, j] & (np.abs(along - edge) < 1e-9) & fluid[at[0], at[1]]
                along[moved] = mark
                i, j = np.where(moved, at[0], i), np.where(moved, at[1], j)
        return i, j


def nodal_grid(mesh: Mesh, space: Space, values: Array) -> Array:
    """Sort nodal values into the refined tensor grid, nan within the membrane."""
    grid = np.full((2 * mesh.r_nm.size - 1, 2 * mesh.z_nm.size - 1), np.nan)
    places = []
    for lines, at in ((mesh.r_nm, space.r_of), (mesh.z_nm, space.z_of)):
        fine = np.empty(2 * lines.size - 1)
        fine[::2] = lines
        fine[1::2] = (lines[1:] + lines[:-1]) / 2.0
        right = np.clip(np.searchsorted(fine, at), 1, fine.size - 1)
        places.append(np.where(at - fine[right - 1] < fine[right] - at, right - 1, right))
    grid[places[0], places[1]] = values
    return grid


def _place(lines: Array, at: Array, name: str) -> tuple[NDArray[np.int64], Array]:
    if np.any((at < lines[0]) | (at > lines[-1])):
        raise FieldError(
            f"{name}_nm lies outside the solved box of {lines[0]:g} to {lines[-1]:g} nm: solve a "
            "larger box (box_radius_nm, box_height_nm) or use the field's table"
        )
    cell = np.clip(np.searchsorted(lines, at, side="right") - 1, 0, lines.size - 2)
    return cell, (at - lines[cell]) / (lines[cell + 1] - lines[cell])
