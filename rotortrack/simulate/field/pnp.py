"""Poisson-Nernst-Planck: potential and salt around the charged pore.

Unknowns are the potential phi and the quasi-potentials psi+ = ln c+ + phi, psi- = ln c- - phi, all
in thermal voltages. Concentrations are positive by construction, and the quasi-potentials have no
double layer, so that Newton's method needs no continuation in charge, salt or voltage.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import FieldError
from rotortrack.simulate.field.physics import Physics
from rotortrack.simulate.field.space import Array, Assembly, Space, block

_LARGEST_STEP: Final = 3.0
"""Thermal voltages by which one Newton step may change an unknown."""

_CONVERGED: Final = 1e-9
_MOST_STEPS: Final = 60


@dataclass(frozen=True)
class State:
    """Nodal values of the three unknowns, thermal voltages.

    Attributes
    ----------
    phi, psi_plus, psi_minus
        (node,).
    """

    phi: Array
    psi_plus: Array
    psi_minus: Array


class PoissonNernstPlanck:
    """The equations on one mesh.

    Parameters
    ----------
    space
        Quadratic elements.
    physics
        Coefficients.
    wall
        (node,) integral of each shape function over the charged wall, weighted by r.
    trans, cis
        (node,) flags of the nodes on the two ends of the box.
    """

    def __init__(
        self,
        space: Space,
        physics: Physics,
        wall: Array,
        trans: NDArray[np.bool_],
        cis: NDArray[np.bool_],
    ) -> None:
        self.space = space
        self.physics = physics
        self._wall = wall * physics.wall_per_nm
        self._trans, self._cis = trans, cis
        ends = trans | cis
        self._poisson = Assembly([space], ~ends)
        self._coupled = Assembly([space] * 3, np.tile(~ends, 3))

    def start(self, blend: Array) -> tuple[State, int]:
        """Solve for the potential at rest, the salt going from side to side as `blend` does.

        With equal salt on both sides this is the equilibrium.

        Parameters
        ----------
        blend
            (node,) 1 on the trans side, 0 on the cis side.

        Returns
        -------
        state
            Without any voltage.
        steps
            Newton steps taken.
        """
        physics = self.physics
        salt = np.log(physics.cis) + (np.log(physics.trans) - np.log(physics.cis)) * blend
        phi = np.zeros(self.space.size)
        ones = np.ones_like(self.space.r)
        stiffness = block(self.space, self.space, stiffness=ones)
        for step in range(1, _MOST_STEPS + 1):
            state = State(phi, salt, salt)
            plus, minus = self.concentrations(state)
            mass = block(self.space, self.space, mass=physics.charge_nm2 * (plus + minus))
            matrix = self._poisson.matrix({(0, 0): stiffness + mass})
            residual = self._charge_balance(state, plus, minus)
            change = np.zeros_like(phi)
            free = self._poisson.free
            change[free] = self._poisson.factorise(matrix).solve(-residual[free])
            largest = float(np.abs(change).max())
            phi = phi + change * min(1.0, _LARGEST_STEP / max(largest, _LARGEST_STEP))
            if largest < _CONVERGED:
                return State(phi, salt, salt), step
        raise FieldError(_not_converged("potential at rest"))

    def biased(self, state: State, trans_potential: float, blend: Array) -> State:
        """Add a potential of the trans side as a first guess; the ends get their exact values."""
        lift = trans_potential * blend
        phi = state.phi + lift
        return State(phi, state.psi_plus + lift, state.psi_minus - lift)

    def solve(self, state: State, flow: Array) -> tuple[State, int]:
        """Solve all three equations in a given flow by Newton's method.

        Parameters
        ----------
        state
            First guess, exact on the ends.
        flow
            (2, cell, point) nm/us.

        Returns
        -------
        state
        steps
            Newton steps taken.
        """
        space, physics = self.space, self.physics
        free = self._coupled.free
        stiffness = block(space, space, stiffness=np.ones_like(space.r))
        size = space.size
        for step in range(1, _MOST_STEPS + 1):
            plus, minus = self.concentrations(state)
            slope_plus = space.gradient(state.psi_plus) - flow / physics.cation_nm2_us
            slope_minus = space.gradient(state.psi_minus) - flow / physics.anion_nm2_us
            k = physics.charge_nm2
            mass_plus = block(space, space, mass=k * plus)
            mass_minus = block(space, space, mass=k * minus)
            drift_plus = block(space, space, advection=plus * slope_plus)
            drift_minus = block(space, space, advection=minus * slope_minus)
            matrix = self._coupled.matrix(
                {
                    (0, 0): stiffness + mass_plus + mass_minus,
                    (0, 1): -mass_plus,
                    (0, 2): mass_minus,
                    (1, 0): -drift_plus,
                    (1, 1): block(space, space, stiffness=plus) + drift_plus,
                    (2, 0): drift_minus,
                    (2, 2): block(space, space, stiffness=minus) + drift_minus,
                }
            )
            residual = np.concatenate(
                (
                    self._charge_balance(state, plus, minus),
                    space.vector(flux=plus * slope_plus),
                    space.vector(flux=minus * slope_minus),
                )
            )
            change = np.zeros_like(residual)
            change[free] = self._coupled.factorise(matrix).solve(-residual[free])
            largest = float(np.abs(change).max())
            if not np.isfinite(largest):
                break
            change *= min(1.0, _LARGEST_STEP / max(largest, _LARGEST_STEP))
            state = State(
                state.phi + change[:size],
                state.psi_plus + change[size : 2 * size],
                state.psi_minus + change[2 * size :],
            )
            if largest < _CONVERGED:
                return state, step
        raise FieldError(_not_converged("potential and salt"))

    def concentrations(self, state: State) -> tuple[Array, Array]:
        """Give c+ and c- at the quadrature points."""
        phi = self.space.at_points(state.phi)
        plus = np.exp(self.space.at_points(state.psi_plus) - phi)
        minus = np.exp(self.space.at_points(state.psi_minus) + phi)
        return plus, minus

    def body_force(self, state: State) -> Array:
        """Give the force on the water, (2, cell, point), pN/nm^3.

        The electric force less the gradient of the excess osmotic pressure: what is left is zero in
        neutral water and at rest, and its two terms are electro- and diffusioosmosis.
        """
        salt = (state.psi_plus + state.psi_minus) / 2.0
        virtual = (state.psi_plus - state.psi_minus) / 2.0
        layer = self.space.at_points(state.phi - virtual)
        neutral = 2.0 * self.physics.osmotic_pn_nm2 * np.exp(self.space.at_points(salt))
        electric = neutral * np.sinh(layer) * self.space.gradient(virtual)
        # cosh(x) - 1 without cancellation
        return electric - neutral * 2.0 * np.sinh(layer / 2.0) ** 2 * self.space.gradient(salt)

    def current_a(self, state: State, flow: Array) -> float:
        """Give the electric current from trans to cis, A.

        The flux through the trans end is tested with the shape functions that do not vanish there,
        which conserves charge exactly on any mesh.
        """
        plus, minus = self.concentrations(state)
        space, physics = self.space, self.physics
        slope_plus = space.gradient(state.psi_plus) - flow / physics.cation_nm2_us
        slope_minus = space.gradient(state.psi_minus) - flow / physics.anion_nm2_us
        cations = space.vector(flux=plus * slope_plus)[self._trans].sum()
        anions = space.vector(flux=minus * slope_minus)[self._trans].sum()
        net = physics.cation_nm2_us * cations - physics.anion_nm2_us * anions
        return float(2.0 * np.pi * net * physics.ampere)

    def _charge_balance(self, state: State, plus: Array, minus: Array) -> Array:
        source = -self.physics.charge_nm2 * (plus - minus)
        return self.space.vector(source, self.space.gradient(state.phi)) - self._wall


def _not_converged(what: str) -> str:
    return (
        f"the {what} did not converge in {_MOST_STEPS} steps: give a lower voltage_v or less "
        "surface charge"
    )
