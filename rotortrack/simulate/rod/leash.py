"""The tether of the rod: the 50-nm double strand that hangs from its middle into the pore.

It is drawn into the pore before the rod arrives, so its far end is held at the pore's centre. A
harmonic tether is slack up to its length and a spring beyond. A worm-like one pulls with

    F = kT/Lp (1/(4 (1 - u)^2) - 1/4 + u),    u = distance / length,

continued as a straight line from u = 0.95 on. Source: Marko and Siggia, Macromolecules 28 (1995)
8759.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.rod.parameters import (
    LEASH,
    LEASH_AT,
    LEASH_LENGTH_NM,
    LEASH_PN,
    LEASH_PN_NM,
)

_STRAIGHT = 0.95
"""Part of the length beyond which the worm-like law goes on as a straight line."""


@kernel
def leash_pull(distance_nm: float, rod: NDArray[np.float64]) -> tuple[float, float]:
    """Give the tether's pull, pN, at a distance of its ends, and its stiffness, pN/nm."""
    length = rod[LEASH_LENGTH_NM]
    if rod[LEASH] == 1.0:
        beyond = max(distance_nm - length, 0.0)
        return rod[LEASH_PN_NM] * beyond, rod[LEASH_PN_NM] if beyond > 0.0 else 0.0
    reach = distance_nm / length
    slack = 1.0 - min(reach, _STRAIGHT)
    stiffness = rod[LEASH_PN] * (0.5 / slack**3 + 1.0) / length
    pull = rod[LEASH_PN] * (0.25 / slack**2 - 0.25 + min(reach, _STRAIGHT))
    return pull + stiffness * max(reach - _STRAIGHT, 0.0) * length, stiffness


@kernel
def add_leash_force(
    x: NDArray[np.float64], rod: NDArray[np.float64], force: NDArray[np.float64]
) -> None:
    """Add the tether's pull to `force`, pN, shape (n, 3), of vertices x, nm; none by default."""
    if rod[LEASH] == 0.0:
        return
    i = int(rod[LEASH_AT])
    distance = math.sqrt(x[i, 0] ** 2 + x[i, 1] ** 2 + x[i, 2] ** 2)
    if distance == 0.0:
        return
    pull = leash_pull(distance, rod)[0] / distance
    for c in range(3):
        force[i, c] -= pull * x[i, c]


@kernel
def add_leash_hessian(
    x: NDArray[np.float64], rod: NDArray[np.float64], blocks: NDArray[np.float64]
) -> None:
    """Add the tether's stiffness, pN/nm, to the block of its vertex, shape (n, 3, 3)."""
    if rod[LEASH] == 0.0:
        return
    i = int(rod[LEASH_AT])
    distance = math.sqrt(x[i, 0] ** 2 + x[i, 1] ** 2 + x[i, 2] ** 2)
    pull, along = leash_pull(distance, rod)
    across = pull / distance if distance > 0.0 else along
    for c in range(3):
        blocks[i, c, c] += across
        for d in range(3):
            if distance > 0.0:
                blocks[i, c, d] += (along - across) * x[i, c] * x[i, d] / distance**2
