"""How the force of field and flow on a segment changes when the segment moves.

In the mouth of a pore the flow changes within a few nm, and because a flow is no gradient of an
energy, the rod there does not just fall back into its place: it circles into it, at some rad/us.
Explicit steps would have to follow every turn. The matrix is not symmetric, hence the general
solver.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.field.sample import sample_field
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

_STEP_NM = 0.02


@kernel
def _pulls(
    rod: NDArray[np.float64], sample: NDArray[np.float64], pulls: NDArray[np.float64]
) -> None:
    """Turn sampled fields into the electric force (row 0) and the drift of the water (row 1)."""
    electric = rod[ELECTRIC_PN_NM_PER_V_M] * rod[EDGE_NM]
    for c in range(3):
        pulls[0, c] = electric * (sample[0, c] + rod[FIELD_READING] * sample[1, c])
        pulls[1, c] = rod[FLOW] * sample[2, c] + rod[DIFFUSIOPHORETIC_NM2_US] * sample[3, c]


@kernel
def write_field_stiffness(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    r_nm: NDArray[np.float64],
    z_nm: NDArray[np.float64],
    nodes: NDArray[np.float64],
    stiffness: NDArray[np.float64],
) -> None:
    """Write -dF/dm of each segment, F the force on it and m its middle.

    The direction of the segment is held. Slopes along r and z are differences over 0.02 nm; that
    around the axis follows from symmetry, as a vector without azimuthal part turns with its place.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).
    rod
        Parameters of the rod.
    r_nm, z_nm, nodes
        Table of the field.
    stiffness
        Result, pN/nm, shape (n - 1, 3, 3): component of the force, direction of the motion.

    Notes
    -----
    Three look-ups a segment: about 20 us for 51 vertices.
    """
    across = rod[ZETA_PERP_PER_NM] * rod[FRICTION_LENGTH_NM]
    along = rod[ZETA_PAR_PER_NM] * rod[FRICTION_LENGTH_NM] - across
    sample = np.empty((4, 3))
    here = np.empty((2, 3))
    there = np.empty((2, 3))
    slopes = np.empty((2, 3, 3))
    tangent = np.empty(3)
    for i in range(x.shape[0] - 1):
        square = 0.0
        for c in range(3):
            tangent[c] = x[i + 1, c] - x[i, c]
            square += tangent[c] * tangent[c]
        inverse = 1.0 / math.sqrt(square) if square > 0.0 else 0.0
        for c in range(3):
            tangent[c] *= inverse
        mx = 0.5 * (x[i, 0] + x[i + 1, 0])
        my = 0.5 * (x[i, 1] + x[i + 1, 1])
        mz = 0.5 * (x[i, 2] + x[i + 1, 2])
        r = math.sqrt(mx * mx + my * my)
        ex = mx / r if r > 0.0 else 1.0
        ey = my / r if r > 0.0 else 0.0
        sample_field(r_nm, z_nm, nodes, mx, my, mz, sample)
        _pulls(rod, sample, here)
        sample_field(r_nm, z_nm, nodes, mx + _STEP_NM * ex, my + _STEP_NM * ey, mz, sample)
        _pulls(rod, sample, there)
        for kind in range(2):
            # On the axis the radial part is zero and its slope the same in all directions.
            radial = here[kind, 0] * ex + here[kind, 1] * ey
            if r > _STEP_NM:
                around = radial / r
            else:
                around = (there[kind, 0] * ex + there[kind, 1] * ey - radial) / _STEP_NM
            for c in range(3):
                outwards = (there[kind, c] - here[kind, c]) / _STEP_NM
                slopes[kind, c, 0] = outwards * ex
                slopes[kind, c, 1] = outwards * ey
            slopes[kind, 0, 0] += around * ey * ey
            slopes[kind, 0, 1] -= around * ex * ey
            slopes[kind, 1, 0] -= around * ex * ey
            slopes[kind, 1, 1] += around * ex * ex
        sample_field(r_nm, z_nm, nodes, mx, my, mz + _STEP_NM, sample)
        _pulls(rod, sample, there)
        for kind in range(2):
            for c in range(3):
                slopes[kind, c, 2] = (there[kind, c] - here[kind, c]) / _STEP_NM
        for d in range(3):
            slip = 0.0
            for c in range(3):
                slip += tangent[c] * slopes[1, c, d]
            for c in range(3):
                drag = across * slopes[1, c, d] + along * slip * tangent[c]
                stiffness[i, c, d] = -(slopes[0, c, d] + drag)


@kernel
def add_to_halves(
    stiffness: NDArray[np.float64],
    theta: float,
    band: NDArray[np.float64],
    low: NDArray[np.float64],
) -> None:
    """Add the stiffness to both halves of a step's matrix.

    A segment moves by the mean of its vertices and shares its force between them: a quarter of its
    stiffness goes to each of the four pairs.
    """
    for i in range(stiffness.shape[0]):
        for c in range(3):
            for d in range(3):
                share = 0.25 * theta * stiffness[i, c, d]
                for row in (4 * i + c, 4 * i + 4 + c):
                    for column in (4 * i + d, 4 * i + 4 + d):
                        if column >= row:
                            band[row, column - row] += share
                        else:
                            low[column, row - column] += share
