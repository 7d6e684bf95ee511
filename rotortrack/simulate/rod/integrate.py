"""A whole run of a rod in one compiled call: steps, error control, samples and what ends it.

Implicit steps are taken in a frame that turns with the rod, x = R(spin t) y: field and membrane are
bodies of revolution, so that y moves by the same forces less the drag of the turning frame,

    Z dy/dt = F(y) - J^T T - Z (spin e_z x y).

The spin is the mean rate of the step before, any value would do. A rod that turns steadily stands
still in its frame: nothing is left to err about, steps grow, and what the run settles to satisfies
the equation of the relative equilibrium itself, whatever the tolerance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.rod.explicit import explicit_step
from rotortrack.simulate.rod.field_stiffness import write_field_stiffness
from rotortrack.simulate.rod.implicit import (
    Room,
    Shape,
    implicit_step,
    keep_tensions,
    look,
    new_room,
    new_shape,
)
from rotortrack.simulate.rod.parameters import EDGE_NM
from rotortrack.simulate.rod.projection import project_lengths
from rotortrack.simulate.rod.watch import (
    UNDECIDED,
    copy_shape,
    new_watch,
    turn_between,
    watch_rod,
)

IMPLICIT = 0
EXPLICIT = 1

# How the loop ended; below TIME_OVER it is what `watch_rod` returned.
TIME_OVER = 10
OUT_OF_STEPS = 11
NOT_FINITE = 12
FOLDED = 13
TOO_STIFF = 14

SMALLEST_STEP_US = 1e-12

# Places in `Samples.numbers`.
TIME_US = 0
STEPS = 1
REJECTED = 2
STORED = 3
SETTLED_US = 4
DEFORMATION_NM_US = 5


class Control(NamedTuple):
    """How a run is stepped: what kind of step, and the numbers of the stepping options."""

    kind: int
    step_us: float
    longest_us: float
    tolerance_nm: float
    cap_nm: float
    duration_us: float
    sample_us: float
    max_steps: int
    stops: bool


class Samples(NamedTuple):
    """Where a run is written: times (k,), shapes (k, n, 3), angles (k,), and six numbers."""

    time_us: NDArray[np.float64]
    positions_nm: NDArray[np.float64]
    turned_rad: NDArray[np.float64]
    numbers: NDArray[np.float64]


class Stages(NamedTuple):
    """The shapes within one step, each (n, 3): in the turning frame, and the last one out of it."""

    full: NDArray[np.float64]
    middle: NDArray[np.float64]
    moved: NDArray[np.float64]
    turned: NDArray[np.float64]


@kernel
def is_finite(values: NDArray[np.float64]) -> bool:
    """Whether an array of shape (n, 3) holds neither NaN nor infinity."""
    total = 0.0
    for i in range(values.shape[0]):
        for c in range(3):
            total += values[i, c] * 0.0
    return total == 0.0


@kernel
def _join_frame(x: NDArray[np.float64], spin: float, shape: Shape) -> None:
    """Take the drag of a frame that turns by `spin` rad/us off the forces."""
    for i in range(x.shape[0]):
        vx = -spin * x[i, 1]
        vy = spin * x[i, 0]
        across = shape.drag[i, 0]
        along = (shape.drag[i, 1] - across) * (shape.tangent[i, 0] * vx + shape.tangent[i, 1] * vy)
        shape.force[i, 0] -= across * vx + along * shape.tangent[i, 0]
        shape.force[i, 1] -= across * vy + along * shape.tangent[i, 1]
        shape.force[i, 2] -= along * shape.tangent[i, 2]


@kernel
def _turn(x: NDArray[np.float64], angle: float, turned: NDArray[np.float64]) -> None:
    """Turn vertices about the z axis."""
    cosine = math.cos(angle)
    sine = math.sin(angle)
    for i in range(x.shape[0]):
        along = x[i, 0]
        turned[i, 0] = cosine * along - sine * x[i, 1]
        turned[i, 1] = sine * along + cosine * x[i, 1]
        turned[i, 2] = x[i, 2]


@kernel
def _touches(shape: Shape, i: int) -> bool:
    """Tell by its stiffness whether the wall touches a vertex, or a tether pulls it."""
    stiffness: float = shape.contact[i, 0, 0] + shape.contact[i, 1, 1] + shape.contact[i, 2, 2]
    return stiffness > 0.0


@kernel
def extrapolated_step(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    r_nm: NDArray[np.float64],
    z_nm: NDArray[np.float64],
    nodes: NDArray[np.float64],
    shape: Shape,
    half_shape: Shape,
    dt_us: float,
    spin: float,
    room: Room,
    stages: Stages,
) -> float:
    """Take one step of order 2 and return an estimate of its error, nm.

    One implicit step of dt and two of dt/2 differ by as much as the two are off; twice the two
    less the one has no error of second order in dt left, for any stiffness matrix. The same
    difference corrects the shape in the middle. A vertex that meets or leaves the wall within the
    step is not extrapolated: there the difference is no power of dt, and adding it would throw the
    vertex off the wall as far as it had sunk in, again and again.

    Parameters
    ----------
    x, rod, r_nm, z_nm, nodes, shape
        Vertices, parameters, field and what `look` found at x, less the drag of the frame.
    half_shape, dt_us, spin, room
        Memory; the step; rate of the turning frame, rad/us; memory.
    stages
        Results in that frame: `moved`, the shape after dt, and `middle`, that after dt/2, each of
        order 2.

    Returns
    -------
    float
        Largest distance of a vertex between the two results of order 1; infinite where a step
        failed.

    Notes
    -----
    About 50 us for 51 vertices, 90 us in a field.
    """
    full, middle, moved, _ = stages
    if room.field.shape[0] > 0:
        write_field_stiffness(x, rod, r_nm, z_nm, nodes, room.field)
    # One call in a loop, as each that is written out takes the compiler seconds.
    for stage in range(3):
        begin, known, result, step = x, shape, full, dt_us
        if stage == 1:
            result, step = middle, 0.5 * dt_us
        elif stage == 2:
            look(middle, rod, r_nm, z_nm, nodes, half_shape)
            _join_frame(middle, spin, half_shape)
            begin, known, result, step = middle, half_shape, moved, 0.5 * dt_us
        if not implicit_step(begin, rod, known, step, 1.0, room, result):
            return np.inf
    error = 0.0
    for i in range(x.shape[0]):
        square = 0.0
        smooth = _touches(shape, i) == _touches(half_shape, i)
        for c in range(3):
            difference = moved[i, c] - full[i, c]
            square += difference * difference
            if smooth:
                moved[i, c] += difference
                middle[i, c] += 0.5 * difference
        error = max(error, square)
        if not math.isfinite(square):
            return np.inf
    solves = project_lengths(
        moved, rod[EDGE_NM], half_shape.tangent, half_shape.drag, room.directions, room.tri
    )
    return math.sqrt(error) if solves >= 0 else np.inf


@kernel
def _sample_within(
    x: NDArray[np.float64],
    rod: NDArray[np.float64],
    shape: Shape,
    begin_us: float,
    dt_us: float,
    turned: float,
    spin: float,
    curved: bool,
    control: Control,
    room: Room,
    stages: Stages,
    samples: Samples,
) -> None:
    """Store the samples that fall into a step, on the parabola through its three shapes."""
    numbers = samples.numbers
    while True:
        k = int(numbers[STORED])
        due = k * control.sample_us
        s = (due - begin_us) / dt_us
        if s > 1.0 + 1e-12 or k >= samples.time_us.shape[0] - 1:
            return
        y = samples.positions_nm[k]
        if curved:
            first, second, third = (
                (2.0 * s - 1.0) * (s - 1.0),
                4.0 * s * (1.0 - s),
                s * (2.0 * s - 1.0),
            )
        else:
            first, second, third = 1.0 - s, 0.0, s
        for i in range(x.shape[0]):
            for c in range(3):
                y[i, c] = first * x[i, c] + third * stages.moved[i, c]
                if curved:
                    y[i, c] += second * stages.middle[i, c]
        project_lengths(y, rod[EDGE_NM], shape.tangent, shape.drag, room.directions, room.tri)
        samples.time_us[k] = due
        samples.turned_rad[k] = turned + turn_between(x, y, shape.drag) + spin * s * dt_us
        _turn(y, spin * s * dt_us, y)
        numbers[STORED] = k + 1


@kernel
def _finish(x: NDArray[np.float64], t_us: float, turned: float, samples: Samples) -> None:
    """Store the last shape, unless a sample is due at this very time."""
    numbers = samples.numbers
    numbers[TIME_US] = t_us
    k = int(numbers[STORED])
    if samples.time_us[k - 1] < t_us * (1.0 - 1e-9):
        samples.time_us[k] = t_us
        copy_shape(x, samples.positions_nm[k])
        samples.turned_rad[k] = turned
        numbers[STORED] = k + 1


@kernel
def integrate(
    start_nm: NDArray[np.float64],
    rod: NDArray[np.float64],
    r_nm: NDArray[np.float64],
    z_nm: NDArray[np.float64],
    nodes: NDArray[np.float64],
    control: Control,
    samples: Samples,
) -> int:
    """Run a rod from its start to an end.

    Parameters
    ----------
    start_nm
        Vertices, nm, shape (n, 3), links at their length.
    rod
        Parameters of the rod.
    r_nm, z_nm, nodes
        Field table; arrays of size 0 mean no field.
    control
        Steps, tolerances and limits.
    samples
        Results; room for duration / sample + 2 of them. `numbers` tells the time reached, the
        steps taken and rejected, the samples stored, the window over which the shape stood still
        (nan where it did not) and its speed of deformation.

    Returns
    -------
    int
        SETTLED, THROUGH or LOST (`watch`), TIME_OVER, OUT_OF_STEPS, NOT_FINITE, FOLDED or
        TOO_STIFF.
    """
    n = start_nm.shape[0]
    x = np.empty((n, 3))
    copy_shape(start_nm, x)
    shape = new_shape(n)
    other = new_shape(n)
    room = new_room(n, control.kind == IMPLICIT and nodes.size > 0)
    stages = Stages(np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)))
    watch = new_watch(x)
    numbers = samples.numbers
    numbers[:] = 0.0
    numbers[SETTLED_US] = np.nan
    numbers[DEFORMATION_NM_US] = np.nan
    samples.time_us[0] = 0.0
    copy_shape(x, samples.positions_nm[0])
    samples.turned_rad[0] = 0.0
    numbers[STORED] = 1
    implicit = control.kind == IMPLICIT
    t = 0.0
    turned = 0.0
    spin = 0.0
    step = min(control.step_us, control.longest_us)
    folded = look(x, rod, r_nm, z_nm, nodes, shape)
    status = UNDECIDED
    if not (is_finite(x) and is_finite(shape.force)):
        status = NOT_FINITE
    elif folded >= 0:
        status = FOLDED
    while status == UNDECIDED:
        left = control.duration_us - t
        if left <= 1e-9 * control.duration_us:
            status = TIME_OVER
            break
        if numbers[STEPS] + numbers[REJECTED] >= control.max_steps:
            status = OUT_OF_STEPS
            break
        error = 0.0
        if implicit:
            dt = min(step, left)
            error = extrapolated_step(
                x, rod, r_nm, z_nm, nodes, shape, other, dt, spin, room, stages
            )
        else:
            dt = explicit_step(x, rod, shape, min(step, left), control.cap_nm, room, stages.moved)
            if not dt > 0.0:
                status = NOT_FINITE
                break
        if error <= control.tolerance_nm:
            _turn(stages.moved, spin * dt, stages.turned)
            folded = look(stages.turned, rod, r_nm, z_nm, nodes, other)
        grown = 0.9 * math.sqrt(control.tolerance_nm / max(error, 1e-30))
        if implicit and (error > control.tolerance_nm or folded >= 0):
            numbers[REJECTED] += 1
            step = dt * (0.25 if error <= control.tolerance_nm else max(grown, 0.1))
            if step < SMALLEST_STEP_US:
                status = FOLDED if folded >= 0 else TOO_STIFF
                if not is_finite(other.force):
                    status = NOT_FINITE
            continue
        if not (is_finite(stages.moved) and is_finite(other.force)):
            status = NOT_FINITE
            break
        if folded >= 0:
            status = FOLDED
            break
        _sample_within(x, rod, shape, t, dt, turned, spin, implicit, control, room, stages, samples)
        turn = turn_between(x, stages.moved, shape.drag) + spin * dt
        turned += turn
        t += dt
        copy_shape(stages.turned, x)
        shape, other = other, shape
        numbers[STEPS] += 1
        if implicit:
            spin = turn / dt
            _join_frame(x, spin, shape)
            keep_tensions(room)
            # The last step is cut short by the end of the run and says nothing about the next.
            if dt == step or grown < 1.0:
                step = min(dt * min(grown, 3.0), control.longest_us)
        seen = watch_rod(t, x, turned, rod, watch)
        if control.stops:
            status = seen
    if watch.numbers[3] > 0.0:
        numbers[DEFORMATION_NM_US] = watch.numbers[2] / watch.numbers[3]
        if watch.numbers[5] >= 2.0:
            numbers[SETTLED_US] = watch.numbers[3]
    _finish(x, t, turned, samples)
    return status
