"""The forces that balance on each vertex of a rod at one shape, and the power that they take.

At low Reynolds number the drag balances everything else: Z v = electric + flow + salt + bending +
contact + tether + tension. The paper draws this balance for one segment in its Fig. 3h.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.rod.contact import add_contact_force
from rotortrack.simulate.rod.elasticity import add_bending_force
from rotortrack.simulate.rod.forces import NO_NODES, add_field_force
from rotortrack.simulate.rod.friction import drag_frames
from rotortrack.simulate.rod.leash import add_leash_force
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import (
    DIFFUSIOPHORETIC_NM2_US,
    ELECTRIC_PN_NM_PER_V_M,
    FLOW,
    rod_parameters,
)
from rotortrack.simulate.rod.projection import constrained_velocity

if TYPE_CHECKING:
    from rotortrack.simulate.field.table import FieldTable

Array = NDArray[np.float64]

_OF_FIELD: Final = {
    "electric": ELECTRIC_PN_NM_PER_V_M,
    "flow": FLOW,
    "salt": DIFFUSIOPHORETIC_NM2_US,
}
"""The parameter that scales each part of the field's force."""


@dataclass(frozen=True)
class ForceBalance:
    """Forces on each vertex, pN, and how it moves; all shapes (n, 3).

    Attributes
    ----------
    electric, flow, salt
        Of the electric field, the water's flow and the salt gradient.
    bending, contact, leash
        Of the rod's stiffness, the membrane and the tether.
    tension
        Of the links that keep their lengths.
    net
        Sum of all, balanced by the drag.
    velocity_nm_us
        Z^-1 net.
    """

    electric: Array
    flow: Array
    salt: Array
    bending: Array
    contact: Array
    leash: Array
    tension: Array
    net: Array
    velocity_nm_us: Array

    @property
    def driving(self) -> Array:
        """Sum of the parts that put energy in: field, flow and salt."""
        return self.electric + self.flow + self.salt

    def power_pn_nm_us(self, part: str) -> float:
        """Power of one part of the forces, pN nm/us; that of ``net`` is what the drag takes."""
        return float(np.sum(getattr(self, part) * self.velocity_nm_us))


def force_balance(x: Array, rod: RodOptions, field: FieldTable | None = None) -> ForceBalance:
    """Take the forces at one shape apart.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).
    rod
        What the rod is.
    field
        Field of a pore; without it there is neither field, flow nor membrane.

    Returns
    -------
    ForceBalance
    """
    x = np.ascontiguousarray(x, np.float64)
    parameters = rod_parameters(rod, field)
    table = NO_NODES if field is None else (field.r_nm, field.z_nm, field.nodes)
    parts = {name: np.zeros_like(x) for name in (*_OF_FIELD, "bending", "contact", "leash")}
    for name in _OF_FIELD:
        alone = parameters.copy()
        for other, index in _OF_FIELD.items():
            if other != name:
                alone[index] = 0.0
        add_field_force(x, alone, *table, parts[name])
    add_bending_force(x, parameters, parts["bending"])
    add_contact_force(x, parameters, parts["contact"])
    add_leash_force(x, parameters, parts["leash"])
    tangent, zeta = np.empty_like(x), np.empty((len(x), 2))
    drag_frames(x, parameters, tangent, zeta)
    velocity, directions = np.empty_like(x), np.empty((len(x) - 1, 3))
    without = sum(parts.values(), np.zeros_like(x))
    constrained_velocity(x, without, tangent, zeta, directions, np.empty((3, len(x) - 1)), velocity)
    along = np.sum(velocity * tangent, axis=1, keepdims=True) * tangent
    net = zeta[:, :1] * (velocity - along) + zeta[:, 1:] * along
    return ForceBalance(**parts, tension=net - without, net=net, velocity_nm_us=velocity)
