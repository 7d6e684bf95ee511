"""While a run goes on: whether the rod is through the pore, lost, or settled.

A rod that turns steadily is at rest in a rotating frame. So its shape is compared every
`WINDOW_US` with the one a window ago, turned by the angle in between. What is left, d, shrinks by a
constant ratio q a window when the rod settles, and the rest of its way is then d q / (1 - q).
A rod on its way out of an unstable state has q above 1 and is let go on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.rod.parameters import HALF_MEMBRANE_NM, PORE_RADIUS_NM

WINDOW_US = 10.0
"""Time between two looks at the shape."""

SETTLED_NM = 0.01
"""A rod that has less than this way to go has settled."""

UNMOVED_NM = 1e-6
"""A rod that deforms less than this in a window has settled, whatever the ratio."""

LOST_RADII = 4.0
"""A rod farther than this many pore radii from the mouth, and receding, is lost."""

UNDECIDED = 0
SETTLED = 1
THROUGH = 2
LOST = 3


class Watch(NamedTuple):
    """What is remembered of the last look.

    before (n, 3); numbers: time of the look in us, angle in rad, deformation in nm, length of the
    last window in us, distance from the mouth in nm, times in a row that the rod seemed settled.
    """

    before: NDArray[np.float64]
    numbers: NDArray[np.float64]


@kernel
def copy_shape(x: NDArray[np.float64], target: NDArray[np.float64]) -> None:
    """Copy vertices, (n, 3); a loop, as numba takes seconds to compile the assignment."""
    for i in range(x.shape[0]):
        for c in range(3):
            target[i, c] = x[i, c]


@kernel
def new_watch(x: NDArray[np.float64]) -> Watch:
    """Begin to watch a rod at x, shape (n, 3) in nm."""
    numbers = np.zeros(6)
    numbers[2] = np.nan
    numbers[4] = np.inf
    before = np.empty(x.shape)
    copy_shape(x, before)
    return Watch(before, numbers)


@kernel
def turn_between(
    x: NDArray[np.float64], y: NDArray[np.float64], drag: NDArray[np.float64]
) -> float:
    """Angle about the z axis from one shape to another, weighted by friction, in (-pi, pi].

    Exact for a rigid rotation of any shape; for small displacements the integral of
    sum w (r x v)_z / sum w r^2, the rate of the free rotation with the same torque.
    """
    sine = 0.0
    cosine = 0.0
    for i in range(x.shape[0]):
        sine += drag[i, 0] * (x[i, 0] * y[i, 1] - x[i, 1] * y[i, 0])
        cosine += drag[i, 0] * (x[i, 0] * y[i, 0] + x[i, 1] * y[i, 1])
    return math.atan2(sine, cosine)


@kernel
def _distance_from_mouth(x: NDArray[np.float64], rod: NDArray[np.float64]) -> float:
    nearest = np.inf
    for i in range(x.shape[0]):
        height = x[i, 2] - rod[HALF_MEMBRANE_NM]
        nearest = min(nearest, x[i, 0] ** 2 + x[i, 1] ** 2 + height**2)
    return math.sqrt(nearest)


@kernel
def is_through(x: NDArray[np.float64], rod: NDArray[np.float64]) -> bool:
    """Whether more than half of the vertices are below the membrane's trans face."""
    below = 0
    for i in range(x.shape[0]):
        if x[i, 2] < -rod[HALF_MEMBRANE_NM]:
            below += 1
    through: bool = 2 * below > x.shape[0]
    return through


@kernel
def watch_rod(
    t_us: float,
    x: NDArray[np.float64],
    turned_rad: float,
    rod: NDArray[np.float64],
    watch: Watch,
) -> int:
    """Look at a rod after a step.

    Parameters
    ----------
    t_us, x, turned_rad
        Time, vertices (n, 3) in nm and the angle turned since the start.
    rod
        Parameters of the rod.
    watch
        What is remembered, updated once a window.

    Returns
    -------
    int
        UNDECIDED, SETTLED, THROUGH or LOST.
    """
    if rod[PORE_RADIUS_NM] > 0.0 and is_through(x, rod):
        return THROUGH
    before, numbers = watch
    span = t_us - numbers[0]
    if span < WINDOW_US:
        return UNDECIDED
    cosine = math.cos(turned_rad - numbers[1])
    sine = math.sin(turned_rad - numbers[1])
    deformed = 0.0
    for i in range(x.shape[0]):
        dx = x[i, 0] - cosine * before[i, 0] + sine * before[i, 1]
        dy = x[i, 1] - sine * before[i, 0] - cosine * before[i, 1]
        dz = x[i, 2] - before[i, 2]
        deformed = max(deformed, math.sqrt(dx * dx + dy * dy + dz * dz))
    ratio = deformed / numbers[2]
    left = deformed * ratio / (1.0 - ratio) if ratio < 1.0 else np.inf
    distance = np.inf
    lost = False
    if rod[PORE_RADIUS_NM] > 0.0:
        distance = _distance_from_mouth(x, rod)
        lost = distance > LOST_RADII * rod[PORE_RADIUS_NM] and distance > numbers[4]
    numbers[5] = numbers[5] + 1.0 if left < SETTLED_NM or deformed < UNMOVED_NM else 0.0
    numbers[0] = t_us
    numbers[1] = turned_rad
    numbers[2] = deformed
    numbers[3] = span
    numbers[4] = distance
    copy_shape(x, before)
    if numbers[5] >= 2.0:
        return SETTLED
    return LOST if lost else UNDECIDED
