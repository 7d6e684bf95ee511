"""Slow flow driven by the ions: Stokes' equations, factorised once.

The body force is the excess-only split: with s and v of :class:`~.pnp.Ions` and theta = phi - v,

    f = kT n [2 e^s sinh(theta) grad v - 2 e^s (cosh(theta) - 1) grad s],

electro- and diffusio-osmosis. It equals the force of the field on the charge up to a gradient,
which the pressure takes up, and it vanishes in neutral liquid and at equilibrium.
"""

from __future__ import annotations

import math

import numpy as np

from rotortrack.simulate.field.mesh import Floats
from rotortrack.simulate.field.pnp import PER_NM3_PER_MM, Ions, Scales
from rotortrack.simulate.field.space import Space, factorised, sparse_sum


class Stokes:
    """No slip on `no_slip`; u_r = 0 on the axis and on `no_radial`; no stress where open.

    `no_radial` holds the side of the box, a slip wall; a pipe adds its two ends, where a fully
    developed profile has no zero tangential stress.
    """

    def __init__(
        self,
        space: Space,
        scales: Scales,
        *,
        no_slip: tuple[str, ...] = ("wall",),
        no_radial: tuple[str, ...] = ("axis", "side"),
    ) -> None:
        self.space, self.scales = space, scales
        n2 = space.n2
        free = np.ones(2 * n2 + space.n1, dtype=bool)
        free[space.boundary(*no_slip)] = False
        free[n2 + space.boundary(*no_slip)] = False
        free[space.boundary(*no_radial)] = False
        self.free = free
        # The axis of a refined mesh has points within 1e-9 of r = 0, never at it.
        hoop = 1 / space.radius
        ones = np.ones_like(hoop)
        rr = space.products(space.by_r, ones, space.by_r)
        zz = space.products(space.by_z, ones, space.by_z)
        rz = space.products(space.by_z, ones, space.by_r)
        nodes = np.concatenate([space.nodes2, n2 + space.nodes2, 2 * n2 + space.nodes1], axis=1)
        matrix = np.zeros((nodes.shape[0], 22, 22))
        matrix[:, :9, :9] = 2 * rr + zz + 2 * space.products(space.value, hoop**2, space.value)
        matrix[:, 9:18, 9:18] = rr + 2 * zz
        matrix[:, :9, 9:18] = rz
        matrix[:, 9:18, :9] = np.swapaxes(rz, 1, 2)
        pressure = np.broadcast_to(space.value1, (*ones.shape, 4))
        matrix[:, :9, 18:] = -space.products(space.by_r, ones, pressure) - space.products(
            space.value, hoop, pressure
        )
        matrix[:, 9:18, 18:] = -space.products(space.by_z, ones, pressure)
        matrix[:, 18:, :18] = np.swapaxes(matrix[:, :18, 18:], 1, 2)
        self.factors = factorised(sparse_sum(nodes, nodes, matrix, free))

    @property
    def unknowns(self) -> int:
        """How many numbers describe flow and pressure."""
        return self.free.size

    def solve(self, force_r: Floats, force_z: Floats) -> Floats:
        """Nodal velocity (2, n2), nm/us, for a force (cells, points), pN/nm3."""
        space = self.space
        load = np.zeros(self.free.size)
        load[: space.n2] = space.gather(space.loads(force_r, space.value))
        load[space.n2 : 2 * space.n2] = space.gather(space.loads(force_z, space.value))
        load[~self.free] = 0
        solved = np.asarray(self.factors.solve(load / self.scales.viscosity))
        return solved[: 2 * space.n2].reshape(2, -1)

    def flow_rate(self, velocity: Floats) -> float:
        """Volume per time through the cis end along z, nm3/us; conserved by the Q1 pressures."""
        return 2 * math.pi * float(self.space.boundary_weight("cis") @ velocity[1])

    def sampled(self, velocity: Floats) -> tuple[Floats, Floats]:
        """Velocity at the quadrature points."""
        return self.space.at_points(velocity[0]), self.space.at_points(velocity[1])


def excess_force(space: Space, scales: Scales, ions: Ions) -> tuple[Floats, Floats]:
    """Body force of the ions at the quadrature points, pN/nm3."""
    salt, virtual = ions.salt, ions.virtual
    theta = space.at_points(ions.phi - virtual)
    pressure = 2 * scales.energy_pn_nm * scales.salt_mm * PER_NM3_PER_MM
    density = pressure * np.exp(space.at_points(salt))
    electric = density * np.sinh(theta)
    osmotic = 2 * density * np.sinh(theta / 2) ** 2
    virtual_r, virtual_z = space.slopes(virtual)
    salt_r, salt_z = space.slopes(salt)
    return electric * virtual_r - osmotic * salt_r, electric * virtual_z - osmotic * salt_z
