"""Forces on the rod's vertices: bending, field, flow, salt gradient, membrane and tether.

Field and flow act at the middle of each segment, half on each of its vertices:

    F = -lambda_eff rho l E + Z (lambda_flow u + M grad ln c)
    Z = zeta_perp l (1 - t t^T) + zeta_par l t t^T,    t along the segment.

E and u point from trans to cis out of the pore of a negatively charged wall at positive voltage,
so the field pulls the rod in and the flow carries it off. (The paper's balance "0 = Z v + F" has a
slip: with F_eof = +Z u the rod must move with the flow, Z v = F.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.field.sample import sample_field
from rotortrack.simulate.rod.contact import add_contact_force
from rotortrack.simulate.rod.elasticity import add_bending_force
from rotortrack.simulate.rod.leash import add_leash_force
from rotortrack.simulate.rod.parameters import (
    DIFFUSIOPHORETIC_NM2_US,
    EDGE_NM,
    ELECTRIC_PN_NM_PER_V_M,
    FIELD_READING,
    FLOW,
    FRICTION_LENGTH_NM,
    ZETA_PAR_PER_NM,
    ZETA_PERP_PER_NM,
)

NO_NODES = (np.zeros(0), np.zeros(0), np.zeros((0, 0, 8, 4)))
"""Table arrays r_nm, z_nm, nodes of a scene without a field."""


@kernel
def total_force(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    r_nm: NDArray[np.float64],
    z_nm: NDArray[np.float64],
    nodes: NDArray[np.float64],
    force: NDArray[np.float64],
) -> int:
    """Write the sum of all forces but those that keep the lengths.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).
    rod
        Parameters of the rod.
    r_nm, z_nm, nodes
        Table of the field, as in `sample_field`; of size 0 without one, and then never looked up.
    force
        Force on each vertex, pN, shape (n, 3).

    Returns
    -------
    int
        A joint that folds more sharply than the chain can follow, -1 without.

    Notes
    -----
    About 8 us for 51 vertices, nine tenths of it the table; 1 us without a field.
    """
    force[:] = 0.0
    folded = add_bending_force(x, rod, force)
    add_field_force(x, rod, r_nm, z_nm, nodes, force)
    add_contact_force(x, rod, force)
    add_leash_force(x, rod, force)
    return folded


@kernel
def add_field_force(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    r_nm: NDArray[np.float64],
    z_nm: NDArray[np.float64],
    nodes: NDArray[np.float64],
    force: NDArray[np.float64],
) -> None:
    """Add the forces of field, flow and salt gradient to `force`; see `total_force`."""
    electric = rod[ELECTRIC_PN_NM_PER_V_M] * rod[EDGE_NM]
    flow = rod[FLOW]
    mobility = rod[DIFFUSIOPHORETIC_NM2_US]
    if nodes.size == 0 or (electric == 0.0 and flow == 0.0 and mobility == 0.0):
        return
    across = rod[ZETA_PERP_PER_NM] * rod[FRICTION_LENGTH_NM]
    along = rod[ZETA_PAR_PER_NM] * rod[FRICTION_LENGTH_NM]
    equilibrium = rod[FIELD_READING]
    sample = np.empty((4, 3))
    drift = np.empty(3)
    edge = np.empty(3)
    for i in range(x.shape[0] - 1):
        square = 0.0
        for c in range(3):
            edge[c] = x[i + 1, c] - x[i, c]
            square += edge[c] * edge[c]
        sample_field(
            r_nm,
            z_nm,
            nodes,
            0.5 * (x[i, 0] + x[i + 1, 0]),
            0.5 * (x[i, 1] + x[i + 1, 1]),
            0.5 * (x[i, 2] + x[i + 1, 2]),
            sample,
        )
        projected = 0.0
        for c in range(3):
            drift[c] = flow * sample[2, c] + mobility * sample[3, c]
            projected += edge[c] * drift[c]
        # Of a segment without length no direction is along.
        slip = (along - across) * projected / square if square > 0.0 else 0.0
        for c in range(3):
            field = sample[0, c] + equilibrium * sample[1, c]
            half = 0.5 * (electric * field + across * drift[c] + slip * edge[c])
            force[i, c] += half
            force[i + 1, c] += half
