"""Stokes flow of the water, driven by the body force beside the charged walls.

No slip on the membrane, no flow across the axis and free slip along the side of the box, no
stress on its two open ends. The matrix does not depend on the fields and is factorised once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.field.space import Array, Assembly, Space, block


class Stokes:
    """Quadratic velocities and linear pressure on one mesh.

    Parameters
    ----------
    velocity, pressure
        Spaces of degree 2 and 1.
    viscosity
        pN us/nm^2.
    no_radial, no_flow
        (node,) flags of the velocity nodes without radial flow, and without any.
    """

    def __init__(
        self,
        velocity: Space,
        pressure: Space,
        viscosity: float,
        no_radial: NDArray[np.bool_],
        no_flow: NDArray[np.bool_],
    ) -> None:
        self.velocity = velocity
        fixed = (no_radial | no_flow, no_flow, np.zeros(pressure.size, bool))
        self._assembly = Assembly([velocity, velocity, pressure], ~np.concatenate(fixed))
        eta = np.full_like(velocity.r, viscosity)
        radial = block(
            velocity, velocity,
            stiffness=eta, axes=((2.0, 0.0), (0.0, 1.0)), mass=2.0 * eta / velocity.r**2,
        )  # fmt: skip
        axial = block(velocity, velocity, stiffness=eta, axes=((1.0, 0.0), (0.0, 2.0)))
        mixed = block(velocity, velocity, stiffness=eta, axes=((0.0, 0.0), (1.0, 0.0)))
        along_r, along_z = np.zeros((2, 2, *velocity.r.shape))
        along_r[0] = along_z[1] = -1.0
        push_r = block(velocity, pressure, advection=along_r, mass=-1.0 / velocity.r)
        push_z = block(velocity, pressure, advection=along_z)
        matrix = self._assembly.matrix(
            {
                (0, 0): radial,
                (1, 1): axial,
                (0, 1): mixed,
                (1, 0): mixed.transpose(0, 2, 1),
                (0, 2): push_r,
                (2, 0): push_r.transpose(0, 2, 1),
                (1, 2): push_z,
                (2, 1): push_z.transpose(0, 2, 1),
            }
        )
        self.unknowns = int(self._assembly.free.sum())
        self._factor = self._assembly.factorise(matrix)

    def solve(self, force: Array) -> tuple[Array, Array, Array]:
        """Solve for the flow.

        Parameters
        ----------
        force
            (2, cell, point) pN/nm^3.

        Returns
        -------
        u_r, u_z
            (node,) nm/us.
        pressure
            (node of the linear space,) pN/nm^2, less the excess osmotic pressure.
        """
        parts = [self.velocity.vector(part) for part in force]
        free = self._assembly.free
        right = np.concatenate((*parts, np.zeros(free.size - 2 * self.velocity.size)))
        solution = np.zeros(free.size)
        solution[free] = self._factor.solve(right[free])
        u_r, u_z, pressure = (solution[part] for part in self._assembly.slices)
        return u_r, u_z, pressure
