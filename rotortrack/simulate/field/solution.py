"""A solved field and its values at any point of the fluid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rotortrack.errors import InputError, UsageError
from rotortrack.simulate.field.mesh import Floats
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.pnp import Ions, Scales
from rotortrack.simulate.field.space import Space, physical_slopes, reference_q2

_SLOPES = {
    "e_applied": "applied",
    "e_equilibrium": "equilibrium",
    "lnc": "salt",
}

FIELD_QUANTITIES = (
    "e_applied_r",
    "e_applied_z",
    "e_equilibrium_r",
    "e_equilibrium_z",
    "u_r",
    "u_z",
    "lnc_r",
    "lnc_z",
    "potential",
    "potential_applied",
    "potential_equilibrium",
    "cation_mm",
    "anion_mm",
    "lnc",
)
"""E in V/m, u in nm/us, slopes of ln c in 1/nm, potentials in V."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldSolution:
    """Potential, ions and flow around a pore.

    The potential is the sum of two parts. With the same salt on both sides the equilibrium part is
    that without voltage, and the applied part the rest: the second scales with small voltages, the
    first does not change. With a salt gradient no such state exists; there the applied part is v =
    (psi+ - psi-)/2, the potential outside the double layers, and the equilibrium part their excess.
    ln c is that of the neutral salt in equilibrium with the ions, smooth through double layers.

    Attributes
    ----------
    current_a, flow_m3_s
        Current and volume flow, positive from trans to cis.
    current_error_rel, flow_error_rel
        Estimates of their relative errors from meshes of three kinds (see :mod:`~.solve`). What the
        size of the box changes is not in them.
    voltage_v
        Potential of the trans solution against the cis one, V: found, if no current flows.
    unknowns, iterations, seconds
        Of the finer mesh; time of all meshes.
    """

    options: FieldOptions
    space: Space
    scales: Scales
    rest: Ions | None
    ions: Ions
    velocity: Floats
    voltage_v: float
    current_a: float
    flow_m3_s: float
    current_error_rel: float
    flow_error_rel: float
    unknowns: int
    iterations: int
    seconds: float

    def nodal(self, name: str) -> Floats:
        """Values (n2,) at the mesh's nodes of "phi", "applied", "equilibrium", "salt"; kT/e."""
        ions = self.ions
        if name == "phi":
            return ions.phi
        if name == "salt":
            return ions.salt
        applied = ions.virtual if self.rest is None else ions.phi - self.rest.phi
        return applied if name == "applied" else ions.phi - applied

    def evaluate(self, quantity: str, r_nm: ArrayLike, z_nm: ArrayLike) -> Floats:
        """Value of one of :data:`FIELD_QUANTITIES` at points of the fluid; walls belong to it.

        Raises
        ------
        UsageError
            Unknown quantity.
        InputError
            A point lies in the membrane or outside the solved volume.
        """
        return self.evaluate_all((quantity,), r_nm, z_nm)[quantity]

    def evaluate_all(
        self, quantities: tuple[str, ...], r_nm: ArrayLike, z_nm: ArrayLike
    ) -> dict[str, Floats]:
        """Values of several quantities; the search for the cells is shared."""
        unknown = [name for name in quantities if name not in FIELD_QUANTITIES]
        if unknown:
            raise UsageError(
                f"no field quantity {unknown[0]!r}; known are {', '.join(FIELD_QUANTITIES)}"
            )
        r, z = np.broadcast_arrays(np.asarray(r_nm, float), np.asarray(z_nm, float))
        nodes, value, by_r, by_z = self._located(np.stack([r.ravel(), z.ravel()]))
        thermal = self.scales.thermal_v
        results: dict[str, Floats] = {}
        for name in quantities:
            stem, _, part = name.rpartition("_")
            if stem in _SLOPES:
                slope = by_r if part == "r" else by_z
                values = self.nodal(_SLOPES[stem])[nodes]
                factor = 1.0 if stem == "lnc" else -thermal * 1e9
                out = factor * np.sum(slope * values, axis=1)
                if part == "r":
                    out[r.ravel() == 0] = 0.0
            elif stem == "u":
                out = np.sum(value * self.velocity[0 if part == "r" else 1][nodes], axis=1)
            else:
                out = self._scalar(name, nodes, value)
            results[name] = out.reshape(r.shape)
        return results

    def _scalar(self, name: str, nodes: np.ndarray, value: Floats) -> Floats:
        def at(nodal: Floats) -> Floats:
            return np.asarray(np.sum(value * nodal[nodes], axis=1))

        ions, scales = self.ions, self.scales
        if name == "cation_mm":
            return scales.salt_mm * np.exp(at(ions.plus - ions.phi))
        if name == "anion_mm":
            return scales.salt_mm * np.exp(at(ions.minus + ions.phi))
        if name == "lnc":
            return at(ions.salt) + float(np.log(scales.salt_mm))
        part = {"potential": "phi"}.get(name, name.removeprefix("potential_"))
        return scales.thermal_v * at(self.nodal(part))

    def _located(self, points: Floats) -> tuple[np.ndarray, Floats, Floats, Floats]:
        space, grid = self.space, self.space.grid
        if not np.isfinite(points).all():
            raise InputError("field points must be finite numbers")
        sharp = points if grid.rim is None else grid.rim.undisplaced(points)
        i = _cell(grid.r_nm, sharp[0])
        j = _cell(grid.z_nm, sharp[1])
        inside = grid.solid[i, j]
        if inside.any():
            # A point on a wall may have been counted to the membrane's cell behind it.
            tiny = 1e-7 * grid.r_nm[-1]
            for axis, lines, index in ((0, grid.r_nm, i), (1, grid.z_nm, j)):
                low = inside & (sharp[axis] - lines[index] < tiny) & (index > 0)
                index[low] -= 1
                inside = grid.solid[i, j]
                high = inside & (lines[index + 1] - sharp[axis] < tiny) & (index + 2 < lines.size)
                index[high] += 1
                inside = grid.solid[i, j]
        outside = (points[0] < 0) | (points[0] > grid.r_nm[-1] * (1 + 1e-9))
        outside |= np.abs(points[1]) > grid.z_nm[-1] * (1 + 1e-9)
        if (inside | outside).any():
            r, z = points[:, np.flatnonzero(inside | outside)[0]]
            raise InputError(
                f"point r = {r:g} nm, z = {z:g} nm is in the membrane or outside the solved volume"
            )
        cells = space.cell_of[i, j]
        nodes = space.nodes2[cells]
        # Cells are rectangles of the sharp geometry; find how their local axes lie from corners.
        corner = space.sharp[:, nodes[:, 0]]
        ahead, aside = space.sharp[:, nodes[:, 1]] - corner, space.sharp[:, nodes[:, 3]] - corner
        offset = sharp - corner
        determinant = ahead[0] * aside[1] - ahead[1] * aside[0]
        local = np.stack(
            [
                (offset[0] * aside[1] - offset[1] * aside[0]) / determinant,
                (ahead[0] * offset[1] - ahead[1] * offset[0]) / determinant,
            ]
        )
        value, slopes = reference_q2(np.clip(local, 0.0, 1.0))
        jacobian = np.einsum("kpn,pnl->pkl", space.points[:, nodes], slopes)
        by_r, by_z = physical_slopes(jacobian, slopes)
        return nodes, value, by_r, by_z


def _cell(lines: Floats, at: Floats) -> np.ndarray:
    return np.clip(np.searchsorted(lines, at, side="right") - 1, 0, lines.size - 2)
