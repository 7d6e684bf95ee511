"""Steadily rotating shapes by Newton's method, without time stepping, and whether they are stable.

A rod that turns at a constant rate omega without changing its shape is at rest in the frame that
turns with it. There

    F(x) - J^T T - omega Z(x) (e_z x x) = 0,    |x_(i+1) - x_i| = l,    phase condition

are 4 n equations for as many unknowns: vertices x, tensions T and omega. The phase condition keeps
the shape from being turned, which would change nothing. The same matrix gives the rates at which
small changes of the shape grow or die out.

Some rods turn at a steady mean rate while their shape pulses; the state found near one of these is
not stable and has another rate.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from rotortrack.errors import RodError
from rotortrack.kernels import kernel
from rotortrack.simulate.rod.balance import force_balance
from rotortrack.simulate.rod.forces import total_force
from rotortrack.simulate.rod.friction import drag_frames
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import EDGE_NM, rod_parameters

if TYPE_CHECKING:
    from rotortrack.simulate.field.table import FieldTable

Array = NDArray[np.float64]

_DIFFERENCE_NM: Final = 1e-4
_MOST_STEPS: Final = 40
_LONGEST_NM: Final = 3.0
"""Largest move of a vertex in one Newton step."""

CONVERGED_PN: Final = 1e-8
CONVERGED_NM: Final = 1e-9
STILL_PER_US: Final = 1e-6
"""Growth that is told from none."""


@dataclass(frozen=True)
class RelativeEquilibrium:
    """A shape that turns and does not change.

    Attributes
    ----------
    positions_nm
        Vertices, shape (n, 3).
    tensions_pn
        Of the links, shape (n - 1,), positive where a link is pulled.
    omega_rad_us
        Rate, counter-clockwise seen from cis.
    residual_pn
        Largest force that is left on a vertex.
    iterations
        Newton steps.
    rates_per_us
        Complex rates at which changes of the shape grow, the largest real part first, shape
        (2 n + 1,); that of turning the whole, which is 0, is left out.
    seconds
        Time that it took.
    """

    positions_nm: Array
    tensions_pn: Array
    omega_rad_us: float
    residual_pn: float
    iterations: int
    rates_per_us: NDArray[np.complex128]
    seconds: float

    @property
    def rate_rev_s(self) -> float:
        """Rate in revolutions per second."""
        return float(self.omega_rad_us * 1e6 / (2.0 * np.pi))

    @property
    def is_stable(self) -> bool:
        """Whether all changes of the shape die out."""
        return bool(self.rates_per_us.real.max() < STILL_PER_US)


def find_equilibrium(
    rod: RodOptions, field: FieldTable, positions_nm: Array, omega_rad_us: float | None = None
) -> RelativeEquilibrium:
    """Find the steadily rotating shape near a given one.

    Parameters
    ----------
    rod, field
        What the rod is, and the field of its pore.
    positions_nm
        Vertices of a shape nearby, as the end of a run is, shape (n, 3).
    omega_rad_us
        Its rate; by default that of the forces on it.

    Returns
    -------
    RelativeEquilibrium
        Stable or not: Newton's method finds both.

    Raises
    ------
    RodError
        None is found, since the shape given is too far from any.
    """
    begun = time.perf_counter()
    parameters = rod_parameters(rod, field)
    x = np.ascontiguousarray(positions_nm, np.float64).copy()
    n = len(x)
    balance = force_balance(x, rod, field)
    state = np.empty(4 * n)
    state[: 3 * n] = x.ravel()
    state[3 * n : -1] = _tensions(x, balance.tension)
    if omega_rad_us is None:
        omega_rad_us = _turning(x, balance.velocity_nm_us)
    state[-1] = omega_rad_us
    around = around_axis(x).ravel()
    phase = around / np.linalg.norm(around)
    table = field.r_nm, field.z_nm, field.nodes
    residual, jacobian = np.empty(4 * n), np.empty((4 * n, 4 * n))
    steps = 0
    while True:
        steady_residual(state, phase, x.ravel(), parameters, *table, residual)
        left = float(np.abs(residual[: 3 * n]).max())
        steady_jacobian(state, phase, x.ravel(), parameters, *table, jacobian)
        if left < CONVERGED_PN and np.abs(residual[3 * n :]).max() < CONVERGED_NM:
            break
        if steps == _MOST_STEPS:
            raise RodError(
                f"no steadily rotating shape is found in {steps} Newton steps ({left:.2g} pN are "
                "left): start from the end of a longer run"
            )
        try:
            move = np.linalg.solve(jacobian, -residual)
        except np.linalg.LinAlgError:
            move = np.full(4 * n, np.nan)
        if not np.isfinite(move).all():
            raise RodError("no steadily rotating shape is found: a force is not finite there")
        longest = float(np.abs(move[: 3 * n]).max())
        state += move * min(1.0, _LONGEST_NM / max(longest, _LONGEST_NM))
        steps += 1
    shape = state[: 3 * n].reshape(n, 3).copy()
    return RelativeEquilibrium(
        positions_nm=shape,
        tensions_pn=state[3 * n : -1].copy(),
        omega_rad_us=float(state[-1]),
        residual_pn=left,
        iterations=steps,
        rates_per_us=growth_rates(shape, parameters, jacobian),
        seconds=time.perf_counter() - begun,
    )


def growth_rates(x: Array, parameters: Array, jacobian: Array) -> NDArray[np.complex128]:
    """Growth rates of changes that keep the links' lengths, without that of turning the whole."""
    n = len(x)
    free = scipy.linalg.null_space(jacobian[3 * n : -1, : 3 * n])
    friction = scipy.linalg.block_diag(*_friction(x, parameters))
    stiffness = free.T @ jacobian[: 3 * n, : 3 * n] @ free
    values, vectors = scipy.linalg.eig(stiffness, free.T @ friction @ free)
    turning = free.T @ around_axis(x).ravel()
    turning /= np.linalg.norm(turning)
    likeness = np.abs(turning @ vectors) / np.linalg.norm(vectors, axis=0)
    # Of the slow changes the one that is most like a turn of the whole is that turn.
    slow = np.abs(values) <= max(np.sort(np.abs(values))[2], STILL_PER_US)
    others = np.delete(values, int(np.argmax(np.where(slow, likeness, -1.0))))
    return np.asarray(others[np.argsort(-others.real)], np.complex128)


def _friction(x: Array, parameters: Array) -> Array:
    """Z of each vertex, (n, 3, 3)."""
    tangent, zeta = np.empty_like(x), np.empty((len(x), 2))
    drag_frames(x, parameters, tangent, zeta)
    along = tangent[:, :, np.newaxis] * tangent[:, np.newaxis, :]
    across = zeta[:, :1, np.newaxis]
    result: Array = across * (np.eye(3) - along) + zeta[:, 1:, np.newaxis] * along
    return result


def around_axis(x: Array) -> Array:
    """e_z x x, the velocity of a turn at 1 rad per time."""
    return np.stack((-x[:, 1], x[:, 0], np.zeros(len(x))), axis=1)


def _turning(x: Array, velocity: Array) -> float:
    around = around_axis(x)
    return float(np.sum(around * velocity) / np.sum(around**2))


def _tensions(x: Array, force: Array) -> Array:
    """Tensions whose pulls on the vertices are these forces."""
    links = np.diff(x, axis=0)
    links /= np.linalg.norm(links, axis=1, keepdims=True)
    return np.asarray(np.sum(np.cumsum(force, axis=0)[:-1] * links, axis=1), np.float64)


@kernel
def steady_residual(
    state: Array,
    phase: Array,
    origin: Array,
    rod: Array,
    r_nm: Array,
    z_nm: Array,
    nodes: Array,
    residual: Array,
) -> None:
    """Write forces (3 n), errors of length (n - 1) and the phase condition."""
    n = state.size // 4
    x = state[: 3 * n].reshape((n, 3))
    omega = state[4 * n - 1]
    force = np.empty((n, 3))
    tangent = np.empty((n, 3))
    zeta = np.empty((n, 2))
    total_force(x, rod, r_nm, z_nm, nodes, force)
    drag_frames(x, rod, tangent, zeta)
    for i in range(n):
        vx, vy = -omega * x[i, 1], omega * x[i, 0]
        along = (zeta[i, 1] - zeta[i, 0]) * (vx * tangent[i, 0] + vy * tangent[i, 1])
        residual[3 * i] = force[i, 0] - zeta[i, 0] * vx - along * tangent[i, 0]
        residual[3 * i + 1] = force[i, 1] - zeta[i, 0] * vy - along * tangent[i, 1]
        residual[3 * i + 2] = force[i, 2] - along * tangent[i, 2]
    for i in range(n - 1):
        square = 0.0
        for c in range(3):
            square += (x[i + 1, c] - x[i, c]) ** 2
        length = np.sqrt(square)
        pull = state[3 * n + i] / length
        for c in range(3):
            residual[3 * i + c] += pull * (x[i + 1, c] - x[i, c])
            residual[3 * i + 3 + c] -= pull * (x[i + 1, c] - x[i, c])
        residual[3 * n + i] = length - rod[EDGE_NM]
    turned = 0.0
    for k in range(3 * n):
        turned += phase[k] * (state[k] - origin[k])
    residual[4 * n - 1] = turned


@kernel
def steady_jacobian(
    state: Array,
    phase: Array,
    origin: Array,
    rod: Array,
    r_nm: Array,
    z_nm: Array,
    nodes: Array,
    jacobian: Array,
) -> None:
    """Write the derivatives of `steady_residual`, (4 n, 4 n), by central differences."""
    size = state.size
    there = state.copy()
    above = np.empty(size)
    below = np.empty(size)
    for k in range(size):
        there[k] = state[k] + _DIFFERENCE_NM
        steady_residual(there, phase, origin, rod, r_nm, z_nm, nodes, above)
        there[k] = state[k] - _DIFFERENCE_NM
        steady_residual(there, phase, origin, rod, r_nm, z_nm, nodes, below)
        there[k] = state[k]
        for row in range(size):
            jacobian[row, k] = (above[row] - below[row]) / (2.0 * _DIFFERENCE_NM)
