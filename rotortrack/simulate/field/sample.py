"""Values of a tabulated field at one point: bicubic, so that fields and slopes are continuous.

A rotating state of a rod is the zero of a smooth function only if the field has no kinks; Newton's
method and continuation lose it at the edges of bilinear cells.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel

QUANTITIES: Final = (
    "e_applied_r",
    "e_applied_z",
    "e_equilibrium_r",
    "e_equilibrium_z",
    "u_r",
    "u_z",
    "lnc_r",
    "lnc_z",
)
"""Order of the quantities in a table: V/m, V/m, nm/us and 1/nm."""

RADIAL: Final = tuple(k for k, name in enumerate(QUANTITIES) if name.endswith("_r"))
"""Which of them are radial components, odd in r."""


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
    """Evaluate all fields at a point.

    Beyond the table they fall with the square of the distance, as those of a pore seen from afar,
    from their values where the line to the pore's centre meets the table's edge.

    Parameters
    ----------
    r_nm, z_nm
        (nr,) from 0 and (nz,), increasing; z has both signs.
    nodes
        (nr, nz, 8, 4) of :func:`hermite_nodes`.
    x, y, z
        nm.
    out
        (4, 3) receives the applied field, that of the double layer at rest, the flow and the
        gradient of ln c, Cartesian, in the units of ``QUANTITIES``.
    """
    r = math.sqrt(x * x + y * y)
    beyond = max(1.0, r / r_nm[-1], z / (z_nm[-1] if z > 0.0 else z_nm[0]))
    fall = 1.0 / (beyond * beyond)
    i, v0, v1, s0, s1 = _weights(r_nm, r / beyond)
    j, w0, w1, t0, t1 = _weights(z_nm, z / beyond)
    along_x = x / r if r > 0.0 else 0.0
    along_y = y / r if r > 0.0 else 0.0
    for q in range(4):
        for part in range(2):
            k = 2 * q + part
            a, b = nodes[i, j, k], nodes[i + 1, j, k]
            c, d = nodes[i, j + 1, k], nodes[i + 1, j + 1, k]
            low = v0 * a[0] + s0 * a[1] + v1 * b[0] + s1 * b[1]
            high = v0 * c[0] + s0 * c[1] + v1 * d[0] + s1 * d[1]
            low_slope = v0 * a[2] + s0 * a[3] + v1 * b[2] + s1 * b[3]
            high_slope = v0 * c[2] + s0 * c[3] + v1 * d[2] + s1 * d[3]
            value = fall * (w0 * low + w1 * high + t0 * low_slope + t1 * high_slope)
            if part == 0:
                out[q, 0] = value * along_x
                out[q, 1] = value * along_y
            else:
                out[q, 2] = value


@kernel
def _weights(lines: NDArray[np.float64], at: float) -> tuple[int, float, float, float, float]:
    """Cell of a point, and Hermite weights of values and slopes at its two ends."""
    low, high = 0, lines.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if lines[middle] <= at:
            low = middle
        else:
            high = middle
    size = lines[low + 1] - lines[low]
    t = (at - lines[low]) / size
    upper = t * t * (3.0 - 2.0 * t)
    rest = 1.0 - t
    return low, 1.0 - upper, upper, size * t * rest * rest, -size * t * t * rest


def hermite_nodes(
    r_nm: NDArray[np.float64], z_nm: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Add slopes to tabulated values.

    Parameters
    ----------
    r_nm, z_nm
        (nr,) from 0 and (nz,).
    values
        (nr, nz, 8) in the order of ``QUANTITIES``.

    Returns
    -------
    ndarray
        (nr, nz, 8, 4) value, slopes along r and z, and mixed slope, by central differences of
        second order. Radial components are odd in r, axial ones even. At the outer edges the slope
        across is that of the fields beyond, so that they join smoothly.
    """
    along_r = _slopes_along_r(r_nm, values)
    along_z = _slopes(z_nm, values, 1)
    # Fields beyond the table fall with the square of the distance R: R df/dR = -2 f at its edges.
    along_r[-1] = (-2.0 * values[-1] - z_nm[:, None] * along_z[-1]) / r_nm[-1]
    for edge in (0, -1):
        along_z[:, edge] = (-2.0 * values[:, edge] - r_nm[:, None] * along_r[:, edge]) / z_nm[edge]
    mixed = _slopes(z_nm, along_r, 1)
    mixed[:, [0, -1]] = _slopes_along_r(r_nm, along_z[:, [0, -1]])
    return np.ascontiguousarray(np.stack((values, along_r, along_z, mixed), axis=-1))


def _slopes_along_r(r_nm: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    slopes = _slopes(r_nm, values, 0)
    # On the axis the parabola through the mirrored neighbour tells the slope.
    slopes[0] = 0.0
    slopes[0][:, RADIAL] = values[1][:, RADIAL] / r_nm[1]
    return slopes


def _slopes(
    lines: NDArray[np.float64], values: NDArray[np.float64], axis: int
) -> NDArray[np.float64]:
    return np.asarray(np.gradient(values, lines, axis=axis, edge_order=2), np.float64)


@kernel
def sample_fields(
    r_nm: NDArray[np.float64],
    z_nm: NDArray[np.float64],
    nodes: NDArray[np.float64],
    points: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Evaluate all fields at many points, (m, 3) nm, into (m, 4, 3): see `sample_field`."""
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        sample_field(r_nm, z_nm, nodes, x, y, z, out[k])
