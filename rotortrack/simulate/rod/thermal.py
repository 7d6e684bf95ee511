"""Thermal noise: midstep Brownian steps of the rod with rigid links.

In a step of dt every vertex feels the random force sqrt(2 kT / dt) Z^1/2 xi besides all others, and
both move the rod through the same constrained mobility

    H = Z^-1 - Z^-1 J^T (J Z^-1 J^T)^-1 J Z^-1,    so that noise and drift obey H Z H = H.

H changes with the shape. The forces are those at the beginning of the step and H that of a shape
half a step on, to which a first solve with the same forces leads: the mean of their product then is
the drift kT div H, which keeps the equilibrium for any anisotropic friction, and the links stretch
in a step only by what is of higher order. Half of the bending force's change is implicit in both
solves (theta = 1/2), for which the variance of a linear bending mode is exact at any step; with
theta it is off by 1 / (1 + (theta - 1/2) k dt / zeta).

Order 1 in the mean of any function of the shape. The joints' variance is right to 0.5 % up to steps
of 0.4 ns at links of 9 nm, and to 1 % as long as noise moves a vertex by less than a tenth of a
link, beyond which steps are refused.

Rigid links hold more shapes with perpendicular neighbours than stiff springs do, by
det^1/2 (J Z^-1 J^T). With `metric_force` the force

    F_j = -kT sum_ab (J Z^-1 J^T)^-1_ab d_j J_b . (Z^-1 J_a^T)

takes that away (for one friction in all directions it is -(kT/2) grad ln det). Links and joints are
then those of the bending energy alone. In the paper's rod it moves the persistence length by less
than 1 %.

Sources: Fixman, J. Chem. Phys. 69 (1978) 1527; Grassia and Hinch, J. Fluid Mech. 308 (1996) 255;
Montesi, Morse and Pasquali, J. Chem. Phys. 122 (2005) 084903.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import RodError
from rotortrack.kernels import kernel
from rotortrack.simulate.rod.banded import factor, solve
from rotortrack.simulate.rod.friction import drag_frames
from rotortrack.simulate.rod.implicit import Room, Shape, assemble, look, new_room, new_shape
from rotortrack.simulate.rod.integrate import (
    FOLDED,
    NOT_FINITE,
    OUT_OF_STEPS,
    STEPS,
    STORED,
    TIME_OVER,
    TIME_US,
    Control,
    Samples,
    is_finite,
)
from rotortrack.simulate.rod.options import ThermalOptions
from rotortrack.simulate.rod.parameters import (
    BENDING_PN_NM2,
    BOLTZMANN_PN_NM_K,
    EDGE_NM,
    FRICTION_LENGTH_NM,
    PORE_RADIUS_NM,
    ZETA_PAR_PER_NM,
)
from rotortrack.simulate.rod.projection import (
    link_directions,
    mobility_matrix,
    project_lengths,
)
from rotortrack.simulate.rod.watch import THROUGH, UNDECIDED, copy_shape, is_through, turn_between

STREAM = 0x7468
"""Place of the noise among the children of a seed; whoever shares the seed uses another."""

LONGEST_KICK = 0.1
"""Root mean square of a step's random displacement over a link's length beyond which the links
cannot be kept."""

_BLOCK_NUMBERS = 1 << 16


class Walk(NamedTuple):
    """A rod on its random way: vertices (n, 3), the angle turned, and memory."""

    x: NDArray[np.float64]
    turned: NDArray[np.float64]
    shape: Shape
    middle: Shape
    room: Room
    half: NDArray[np.float64]
    moved: NDArray[np.float64]


def noise_stream(thermal: ThermalOptions) -> np.random.Generator:
    """Give the stream from which all noise of a run is drawn, and nothing else."""
    return np.random.default_rng(np.random.SeedSequence(thermal.seed, spawn_key=(STREAM,)))


def integrate_noisy(
    start_nm: NDArray[np.float64],
    rod: NDArray[np.float64],
    r_nm: NDArray[np.float64],
    z_nm: NDArray[np.float64],
    nodes: NDArray[np.float64],
    control: Control,
    thermal: ThermalOptions,
    samples: Samples,
) -> int:
    """Run a rod with noise, as `integrate` does without.

    The step is `thermal.step_us`, or the next shorter one of which an interval between two samples
    holds a whole number: nothing in it depends on what was drawn.

    Parameters
    ----------
    start_nm, rod, r_nm, z_nm, nodes, samples
        As for `integrate`.
    control
        Of which duration, samples, number of steps and `stops` count; with noise a rod never
        settles, so it is stopped early only behind the membrane.
    thermal
        Temperature, seed and step.

    Returns
    -------
    int
        TIME_OVER, THROUGH, OUT_OF_STEPS, NOT_FINITE or FOLDED.

    Raises
    ------
    RodError
        The step is so long that the noise would move vertices by LONGEST_KICK of a link.

    Notes
    -----
    About 35 us a step for 51 vertices, 45 us with a field.
    """
    energy = BOLTZMANN_PN_NM_K * thermal.temperature_k
    check_kick(rod, thermal)
    walk = new_walk(start_nm)
    stream = noise_stream(thermal)
    numbers = samples.numbers
    numbers[:] = 0.0
    numbers[STORED + 1 :] = np.nan
    _store(walk, 0.0, samples)
    block = max(1, _BLOCK_NUMBERS // start_nm.size)
    whole = int(control.duration_us / control.sample_us * (1.0 + 1e-12))
    rest_us = control.duration_us - whole * control.sample_us
    intervals = [control.sample_us] * whole
    if rest_us > 1e-9 * control.duration_us:
        intervals.append(rest_us)
    for index, interval_us in enumerate(intervals):
        count = max(1, math.ceil(interval_us / thermal.step_us * (1.0 - 1e-12)))
        allowed = min(count, control.max_steps - int(numbers[STEPS]))
        step_us = interval_us / count
        begin_us = index * control.sample_us
        done = 0
        status = UNDECIDED
        while done < allowed and status == UNDECIDED:
            steps = min(block, allowed - done)
            noise = stream.standard_normal((steps, *start_nm.shape))
            taken, status = noisy_steps(
                walk,
                rod,
                r_nm,
                z_nm,
                nodes,
                noise,
                step_us,
                thermal.theta,
                energy,
                thermal.metric_force,
                control.stops,
            )
            done += taken
        numbers[STEPS] += done
        numbers[TIME_US] = begin_us + done * step_us
        if status != UNDECIDED or done < count:
            if status in (UNDECIDED, THROUGH) and done > 0:
                _store(walk, numbers[TIME_US], samples)
            return OUT_OF_STEPS if status == UNDECIDED else status
        _store(walk, begin_us + interval_us, samples)
    return TIME_OVER


def check_kick(rod: NDArray[np.float64], thermal: ThermalOptions) -> None:
    """Refuse steps in which the noise alone moves a vertex by LONGEST_KICK of a link."""
    energy = BOLTZMANN_PN_NM_K * thermal.temperature_k
    drag = rod[ZETA_PAR_PER_NM] * rod[FRICTION_LENGTH_NM]
    longest_us = (LONGEST_KICK * rod[EDGE_NM]) ** 2 * drag / (2.0 * energy)
    if thermal.step_us > longest_us:
        raise RodError(
            f"step_us {thermal.step_us:g} of [thermal] moves vertices by more than a tenth of a "
            f"link: give at most {longest_us:.2g}, or fewer n_vertices"
        )


def new_walk(start_nm: NDArray[np.float64]) -> Walk:
    """Begin a random way at vertices (n, 3)."""
    n = len(start_nm)
    return Walk(
        start_nm.copy(),
        np.zeros(1),
        new_shape(n),
        new_shape(n),
        new_room(n),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
    )


@kernel
def noisy_steps(
    walk: Walk,
    rod: NDArray[np.float64],
    r_nm: NDArray[np.float64],
    z_nm: NDArray[np.float64],
    nodes: NDArray[np.float64],
    noise: NDArray[np.float64],
    dt_us: float,
    theta: float,
    energy_pn_nm: float,
    metric: bool,
    stops: bool,
) -> tuple[int, int]:
    """Take one step for each row of noise.

    Parameters
    ----------
    walk
        The rod; its vertices and angle are moved on.
    rod, r_nm, z_nm, nodes
        Parameters and field table.
    noise
        Standard normal numbers, shape (steps, n, 3).
    dt_us, theta, energy_pn_nm
        Step; implicit part of the bending force; kT.
    metric, stops
        Whether the metric force acts; whether the run ends behind the membrane.

    Returns
    -------
    tuple
        Steps taken; UNDECIDED, THROUGH, NOT_FINITE or FOLDED.
    """
    x, turned, shape, middle, room, half, moved = walk
    n = x.shape[0]
    size = 4 * n - 1
    mixed = Shape(shape.force, middle.tangent, middle.drag, shape.bending, shape.contact)
    for step in range(noise.shape[0]):
        folded = look(x, rod, r_nm, z_nm, nodes, shape)
        # Without stiffness a joint may fold: there is no bending force to be wrong about.
        if folded >= 0 and rod[BENDING_PN_NM2] > 0.0:
            return step, FOLDED
        if metric:
            add_metric_force(x, rod, shape, room, energy_pn_nm)
        add_random_force(shape, noise[step], 2.0 * energy_pn_nm / dt_us)
        at, known = x, shape
        for stage in range(2):
            if stage == 1:
                drag_frames(half, rod, middle.tangent, middle.drag)
                at, known = half, mixed
            assemble(at, rod, known, dt_us, theta, room)
            if factor(room.band, size) != n - 1:
                return step, NOT_FINITE
            solve(room.band, size, room.values)
            for i in range(n):
                for c in range(3):
                    moved[i, c] = x[i, c] + room.values[4 * i + c]
                    half[i, c] = 0.5 * (x[i, c] + moved[i, c])
        solves = project_lengths(
            moved, rod[EDGE_NM], middle.tangent, middle.drag, room.directions, room.tri
        )
        if solves < 0 or not is_finite(moved):
            return step, NOT_FINITE
        turned[0] += turn_between(x, moved, middle.drag)
        copy_shape(moved, x)
        if stops and rod[PORE_RADIUS_NM] > 0.0 and is_through(x, rod):
            return step + 1, THROUGH
    return noise.shape[0], UNDECIDED


@kernel
def add_random_force(shape: Shape, normal: NDArray[np.float64], strength: float) -> None:
    """Add sqrt(strength) Z^1/2 xi to the forces of a shape, xi standard normal of shape (n, 3)."""
    for i in range(normal.shape[0]):
        across = math.sqrt(strength * shape.drag[i, 0])
        along = 0.0
        for c in range(3):
            along += shape.tangent[i, c] * normal[i, c]
        along *= math.sqrt(strength * shape.drag[i, 1]) - across
        for c in range(3):
            shape.force[i, c] += across * normal[i, c] + along * shape.tangent[i, c]


@kernel
def add_metric_force(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    shape: Shape,
    room: Room,
    energy_pn_nm: float,
) -> None:
    """Add the force that undoes the preference of rigid links, kT = energy_pn_nm, to a shape's.

    Costs one elimination of the links' tridiagonal matrix, of whose inverse only the diagonal and
    the one beside it are needed, as friction couples neighbours only.
    """
    links = x.shape[0] - 1
    directions = room.directions
    tri = room.tri
    link_directions(x, directions)
    mobility_matrix(directions, shape.tangent, shape.drag, tri)
    for a in range(1, links):
        tri[0, a] -= tri[1, a - 1] ** 2 / tri[0, a - 1]
    scale = energy_pn_nm / rod[EDGE_NM]
    later = 0.0
    for b in range(links - 1, -1, -1):
        # (G^-1)_bb and (G^-1)_b,b+1, from the last link backwards.
        beside = 0.0
        diagonal = 1.0 / tri[0, b]
        if b < links - 1:
            ratio = tri[1, b] / tri[0, b]
            beside = -ratio * later
            diagonal -= ratio * beside
            _push_apart(shape, directions, b, b + 1, b + 1, -scale * beside)
            _push_apart(shape, directions, b + 1, b, b + 1, -scale * beside)
        for vertex in (b, b + 1):
            _push_apart(shape, directions, b, b, vertex, scale * diagonal)
        later = diagonal


@kernel
def _push_apart(
    shape: Shape,
    directions: NDArray[np.float64],
    link: int,
    other: int,
    vertex: int,
    factor: float,
) -> None:
    """Add -factor (1 - u u^T) Z^-1 u' to the vertex above a link u, and its opposite below.

    u' is the direction of link `other`, Z that of `vertex`.
    """
    across = 1.0 / shape.drag[vertex, 0]
    along = 1.0 / shape.drag[vertex, 1] - across
    dot = 0.0
    for c in range(3):
        dot += shape.tangent[vertex, c] * directions[other, c]
    inside = 0.0
    for c in range(3):
        mobile = across * directions[other, c] + along * dot * shape.tangent[vertex, c]
        inside += mobile * directions[link, c]
    for c in range(3):
        mobile = across * directions[other, c] + along * dot * shape.tangent[vertex, c]
        push = factor * (mobile - inside * directions[link, c])
        shape.force[link + 1, c] -= push
        shape.force[link, c] += push


def _store(walk: Walk, t_us: float, samples: Samples) -> None:
    k = int(samples.numbers[STORED])
    samples.time_us[k] = t_us
    samples.positions_nm[k] = walk.x
    samples.turned_rad[k] = walk.turned[0]
    samples.numbers[STORED] = k + 1
