"""Values of a tabulated field at one point."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel


@kernel
def sample_field(
    r_nm: NDArray[np.float64],
    z_nm: NDArray[np.float64],
    nodes: NDArray[np.float64],
    x: float,
    y: float,
    z: float,
    out: NDArray[np.float64],
) -> None:
    """Write applied E, equilibrium E, flow and grad ln c to `out` (4, 3), bilinear."""
    r = math.sqrt(x * x + y * y)
    i: int = min(max(int(np.searchsorted(r_nm, r)) - 1, 0), r_nm.size - 2)
    j: int = min(max(int(np.searchsorted(z_nm, z)) - 1, 0), z_nm.size - 2)
    u = (r - r_nm[i]) / (r_nm[i + 1] - r_nm[i])
    v = (z - z_nm[j]) / (z_nm[j + 1] - z_nm[j])
    cx = x / r if r > 0.0 else 0.0
    cy = y / r if r > 0.0 else 0.0
    for q in range(4):
        for k in range(2):
            low = (1 - u) * nodes[i, j, 2 * q + k, 0] + u * nodes[i + 1, j, 2 * q + k, 0]
            high = (1 - u) * nodes[i, j + 1, 2 * q + k, 0] + u * nodes[i + 1, j + 1, 2 * q + k, 0]
            value = (1 - v) * low + v * high
            if k == 0:
                out[q, 0] = value * cx
                out[q, 1] = value * cy
            else:
                out[q, 2] = value
