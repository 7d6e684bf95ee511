"""The rod's numbers in one vector, so that every kernel has one signature.

Units inside the rod: nm, us, pN. Then 1 mPa s = 1e-3 pN us/nm^2 and 1 m/s = 1e3 nm/us.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import RodError
from rotortrack.simulate.rod.options import RodOptions

BOLTZMANN_PN_NM_K = 1.380649e-2
"""Boltzmann constant, pN nm/K."""

BARE_LINE_CHARGE_C_M = 12 * 1.602176634e-19 / 0.34e-9
"""Six helices of two charges per 0.34 nm: 5.65e-9 C/m, printed as 5.7e-9."""

# Positions in the vector.
BENDING_PN_NM2 = 0
"""Stiffness B that the force shows: Lp kT, or twice that in the printed readings."""
EDGE_NM = 1
"""Length l of a segment."""
BENDING_SIGN = 2
"""Sign of the term kb e^T in the gradient of kb_i at vertex i + 1: -1, printed +1."""
ZETA_PERP_PER_NM = 3
"""Friction across a length of the rod, pN us/nm^2."""
ZETA_PAR_PER_NM = 4
"""Friction along a length of the rod, pN us/nm^2."""
FRICTION_LENGTH_NM = 5
"""Length whose friction one inner vertex, or one segment in a flow, carries."""
END_WEIGHT = 6
"""Friction of an end vertex over that of an inner one."""
ELECTRIC_PN_NM_PER_V_M = 7
"""Force per length and field on the rod, pN/nm per V/m, negative as the charge."""
FLOW = 8
"""Factor lambda_flow of the drag in the flow."""
FIELD_READING = 9
"""0 applied field, 1 total field."""
DIFFUSIOPHORETIC_NM2_US = 10
"""Mobility M of the drift M grad(ln c)."""
WALL = 11
"""0 none, 1 upwards only, 2 signed distance for vertices, 3 signed distance for segments."""
ROD_RADIUS_NM = 12
WALL_STIFFNESS_PN_NM = 13
PORE_RADIUS_NM = 14
HALF_MEMBRANE_NM = 15
RIM_NM = 16
"""Radius of the pore's rim, 0 for a sharp one."""
LEASH = 17
"""0 none, 1 harmonic, 2 worm-like."""
LEASH_AT = 18
"""Index of the vertex from which the tether starts."""
LEASH_LENGTH_NM = 19
LEASH_PN_NM = 20
"""Stiffness of a harmonic tether."""
LEASH_PN = 21
"""Force scale kT/Lp of a worm-like tether."""
WALL_DRAG = 22
"""ln(L/d) + 0.84 of the rod far from the wall; 0 without the wall's friction."""
HYDRODYNAMIC_RADIUS_NM = 23
WALL_GAP_NM = 24
"""Water between rod and membrane in contact."""
PARAMETERS = 25
"""Length of the vector."""

_LEASH = {"none": 0.0, "harmonic": 1.0, "worm_like": 2.0}


class Pore(Protocol):
    """What the rod must know of a field besides its values: the membrane's shape."""

    @property
    def pore_radius_nm(self) -> float:
        """Radius of the pore."""

    @property
    def membrane_nm(self) -> float:
        """Thickness of the membrane."""

    @property
    def rim_radius_nm(self) -> float:
        """Radius of the pore's rim."""


def rod_parameters(rod: RodOptions, pore: Pore | None) -> NDArray[np.float64]:
    """Gather all numbers of a rod, in nm, us and pN.

    Parameters
    ----------
    rod
        The rod's options.
    pore
        Field table or anything else with the membrane's shape; without it there is no membrane
        and no tether.

    Returns
    -------
    ndarray
        (PARAMETERS,) float64, to be indexed by the constants of this module.

    Raises
    ------
    RodError
        The rod is thicker than the pore, or too short for the friction of slender bodies.
    """
    values = np.zeros(PARAMETERS)
    edge_nm = rod.length_nm / (rod.n_vertices - 1)
    energy_pn_nm = BOLTZMANN_PN_NM_K * rod.temperature_k
    doubling = 1.0 if rod.bending == "energy" else 2.0
    values[BENDING_PN_NM2] = doubling * rod.persistence_length_nm * energy_pn_nm
    values[EDGE_NM] = edge_nm
    values[BENDING_SIGN] = 1.0 if rod.bending == "printed" else -1.0
    values[ZETA_PERP_PER_NM] = friction_prefactor(rod) * rod.viscosity_mpa_s * 1e-3
    values[ZETA_PAR_PER_NM] = values[ZETA_PERP_PER_NM] / 2.0
    values[FRICTION_LENGTH_NM] = rod.friction_length_nm or edge_nm
    values[END_WEIGHT] = 0.5 if rod.end_weight == "half" else 1.0
    # 1 C/m times 1 V/m is 1 N/m, which is 1e3 pN/nm.
    values[ELECTRIC_PN_NM_PER_V_M] = -rod.lambda_eff * BARE_LINE_CHARGE_C_M * 1e3
    values[FLOW] = rod.flow_ratio * rod.lambda_eff
    values[FIELD_READING] = 1.0 if rod.electric_field == "total" else 0.0
    values[DIFFUSIOPHORETIC_NM2_US] = rod.diffusiophoretic_mobility_nm2_us
    if pore is None:
        return values
    if rod.wall != "none":
        segments = 3.0 if rod.contact == "segments" else 2.0
        values[WALL] = 1.0 if rod.wall == "z_only" else segments
    values[ROD_RADIUS_NM] = rod.rod_radius_nm
    values[WALL_STIFFNESS_PN_NM] = rod.wall_stiffness_pn_nm
    values[PORE_RADIUS_NM] = pore.pore_radius_nm
    values[HALF_MEMBRANE_NM] = pore.membrane_nm / 2.0
    values[RIM_NM] = pore.rim_radius_nm
    if values[WALL] > 1.0 and rod.rod_radius_nm >= pore.pore_radius_nm:
        raise RodError(
            f"rod_radius_nm {rod.rod_radius_nm:g} must be below the pore's radius of "
            f"{pore.pore_radius_nm:g} nm: give a thinner rod or a wider pore"
        )
    if rod.wall_drag == "cylinder":
        values[WALL_DRAG] = _slenderness(rod)
    values[HYDRODYNAMIC_RADIUS_NM] = rod.bundle_diameter_nm / 2.0
    values[WALL_GAP_NM] = rod.wall_gap_nm
    values[LEASH] = _LEASH[rod.leash]
    values[LEASH_AT] = {
        "first": 0,
        "middle": (rod.n_vertices - 1) // 2,
        "last": rod.n_vertices - 1,
    }[rod.leash_at]
    values[LEASH_LENGTH_NM] = rod.leash_length_nm
    values[LEASH_PN_NM] = rod.leash_stiffness_pn_nm
    values[LEASH_PN] = energy_pn_nm / rod.leash_persistence_nm
    return values


def friction_prefactor(rod: RodOptions) -> float:
    """Give the friction across the rod per length and viscosity, pi in the paper's Note 2.

    Raises
    ------
    RodError
        The rod is too short for slender-body friction.
    """
    if rod.friction == "resistive":
        return rod.friction_prefactor
    return 4.0 * math.pi / _slenderness(rod)


def _slenderness(rod: RodOptions) -> float:
    if rod.length_nm < 2.0 * rod.bundle_diameter_nm:
        raise RodError(
            f"bundle_diameter_nm {rod.bundle_diameter_nm:g} is no slender body at length_nm "
            f"{rod.length_nm:g}: give friction = 'resistive', wall_drag = 'none', or a longer rod"
        )
    return math.log(rod.length_nm / rod.bundle_diameter_nm) + 0.84
