"""Solve potential, salt and flow together on two meshes, whose difference tells the error."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rotortrack.errors import FieldError
from rotortrack.simulate.field.grading import Grading
from rotortrack.simulate.field.mesh import Mesh, make_mesh
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.physics import physics_of
from rotortrack.simulate.field.pnp import PoissonNernstPlanck, State
from rotortrack.simulate.field.solution import FieldSolution, nodal_grid
from rotortrack.simulate.field.space import Array, Space, quads_of
from rotortrack.simulate.field.stokes import Stokes

GRADINGS: Final = {
    "fast": (Grading(0.7, 1.7), Grading(0.35, 1.7)),
    "default": (Grading(0.2, 1.4), Grading(0.1, 1.4)),
    "careful": (Grading(0.1, 1.25), Grading(0.05, 1.25)),
}
"""The coarse and the fine mesh of each accuracy."""

_FLOW_CONVERGED: Final = 1e-6
_MOST_PASSES: Final = 40
_NO_CURRENT: Final = 1e-6
"""Largest remaining current, as a part of that of one thermal voltage."""


def solve_field(
    options: FieldOptions, gradings: tuple[Grading, Grading] | None = None
) -> FieldSolution:
    """Solve the Poisson-Nernst-Planck-Stokes equations around a charged pore.

    Parameters
    ----------
    options
        Pore, salt, voltage and accuracy.
    gradings
        Coarse and fine mesh instead of those of ``options.accuracy``.

    Returns
    -------
    FieldSolution
        On the fine mesh.

    Raises
    ------
    FieldError
        The equations did not converge.
    ConfigurationError
        The box does not hold the pore.
    """
    began = time.perf_counter()
    coarse, fine = gradings or GRADINGS[options.accuracy]
    first = solve_on(options, make_mesh(options, coarse))
    second = solve_on(options, make_mesh(options, fine))
    shrinkage = fine.finest_nm / coarse.finest_nm
    # The rim makes the flow converge no faster than the size of the cells there.
    factor = shrinkage / (1.0 - shrinkage)
    return replace(
        second,
        current_error_rel=factor * _relative(first.current_a, second.current_a),
        flow_error_rel=factor * _relative(first.flow_m3_s, second.flow_m3_s),
        seconds=time.perf_counter() - began,
    )


def solve_on(options: FieldOptions, mesh: Mesh) -> FieldSolution:
    """Solve on one mesh; errors are unknown (nan)."""
    began = time.perf_counter()
    solver = _Solver(options, mesh)
    potential, state = solver.electrical()
    state = solver.converge(state)
    grid = {
        "phi": state.phi,
        "phi_rest": solver.rest.phi,
        "psi_plus": state.psi_plus,
        "psi_minus": state.psi_minus,
        "u_r": solver.flow.u_r,
        "u_z": solver.flow.u_z,
    }
    thermal_v = solver.physics.thermal_v
    return FieldSolution(
        options=options,
        mesh=mesh,
        nodal={name: nodal_grid(mesh, solver.space, values) for name, values in grid.items()},
        thermal_v=thermal_v,
        trans_potential_v=potential * thermal_v,
        current_a=solver.pnp.current_a(state, solver.flow.at_points),
        flow_m3_s=solver.flow_m3_s(),
        current_error_rel=float("nan"),
        flow_error_rel=float("nan"),
        unknowns=3 * solver.space.size + solver.stokes.unknowns,
        newton_steps=solver.newton_steps,
        flow_passes=solver.flow_passes,
        seconds=time.perf_counter() - began,
    )


@dataclass(frozen=True)
class _Flow:
    """Nodal velocities, and both at the quadrature points, nm/us."""

    u_r: Array
    u_z: Array
    at_points: Array


class _Solver:
    """The coupled equations on one mesh."""

    def __init__(self, options: FieldOptions, mesh: Mesh) -> None:
        self.options = options
        self.physics = physics = physics_of(options)
        quads = quads_of(mesh)
        self.space = space = Space(quads, 2)
        radius, half = options.pore_radius_nm, options.membrane_nm / 2.0
        r, z = space.r_of, space.z_of
        near = 1e-9 * options.box_height_nm
        trans, cis = z < mesh.z_nm[0] + near, z > mesh.z_nm[-1] - near
        side, axis = r > mesh.r_nm[-1] - near, r < near
        wall = (r > radius - near) & (np.abs(z) < half + near)
        facets = quads.facets_satisfying(
            lambda x: (x[0] > radius - near) & (np.abs(x[1]) < half + near), boundaries_only=True
        )
        # The side of the box cuts the membrane nowhere: no facet lies there.
        self.pnp = PoissonNernstPlanck(space, physics, space.on_facets(facets), trans, cis)
        pressure = Space(quads, 1)
        self.stokes = Stokes(space, pressure, physics.viscosity_pn_us_nm2, axis | side, wall)
        self._lumen = (space.r < radius) & (np.abs(space.z) < half)
        self._blend = np.clip((half - z) / (2.0 * half), 0.0, 1.0)
        self.rest, self.newton_steps = self.pnp.start(self._blend)
        still = np.zeros(space.size)
        self.flow = _Flow(still, still, np.zeros((2, *space.r.shape)))
        self.flow_passes = 0

    def electrical(self) -> tuple[float, State]:
        """Find the potential of the trans side (thermal voltages) and a first guess with it."""
        voltage = self.options.voltage_v / self.physics.thermal_v
        if self.options.electrical == "shorted_agcl":
            voltage += float(np.log(self.physics.trans / self.physics.cis))
        if self.options.electrical != "zero_current":
            return voltage, self._guess(voltage)
        tried = [0.0, 1.0]
        currents = [self._current(v) for v in tried]
        scale = abs(currents[1] - currents[0])
        while abs(currents[-1]) > _NO_CURRENT * scale:
            if len(tried) > _MOST_PASSES:
                raise FieldError("no potential without current was found: give less unequal salts")
            slope = (currents[-1] - currents[-2]) / (tried[-1] - tried[-2])
            tried.append(tried[-1] - currents[-1] / slope)
            currents.append(self._current(tried[-1]))
        return tried[-1], self._guess(tried[-1])

    def converge(self, state: State) -> State:
        """Alternate between salt and flow until neither changes."""
        for _ in range(_MOST_PASSES):
            state, steps = self.pnp.solve(state, self.flow.at_points)
            self.newton_steps += steps
            self.flow_passes += 1
            u_r, u_z, _ = self.stokes.solve(self.pnp.body_force(state))
            at_points = np.stack((self.space.at_points(u_r), self.space.at_points(u_z)))
            change = float(np.abs(at_points - self.flow.at_points).max())
            fastest = float(np.abs(at_points).max())
            self.flow = _Flow(u_r, u_z, at_points)
            if change <= _FLOW_CONVERGED * fastest:
                return state
        raise FieldError(
            f"salt and flow did not settle in {_MOST_PASSES} passes: give a lower voltage_v"
        )

    def flow_m3_s(self) -> float:
        """Average the flow over the lumen: the same through any cross-section of the pore."""
        weighted = (self.space.weight * self.flow.at_points[1])[self._lumen].sum()
        nm3_us = 2.0 * np.pi * weighted / self.options.membrane_nm
        return float(nm3_us * 1e-21)

    def _guess(self, voltage: float) -> State:
        return self.pnp.biased(self.rest, voltage, self._blend)

    def _current(self, voltage: float) -> float:
        state = self.converge(self._guess(voltage))
        return self.pnp.current_a(state, self.flow.at_points)


def _relative(coarse: float, fine: float) -> float:
    """Difference over the fine value; 0 where both are 0."""
    return abs(fine - coarse) / abs(fine) if fine else abs(coarse)
