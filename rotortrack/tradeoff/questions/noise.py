"""How long a step of the rod with thermal noise may be, and by which method.

Free rods are simulated for the same time in steps of several lengths. `bending`: the mean square
angle of the joints of ten links against Boltzmann's law of the bending energy, which fixes the
persistence length; steps are taken with half of the bending force implicit, as by default, wholly
implicit, or explicit. `turning`: rotational diffusion of a stiff rod against kT over its friction.
The bound is the statistical error that this much simulated time leaves any method: errors below it
are not told from none.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, stamped

if TYPE_CHECKING:
    from rotortrack.simulate.rod.options import RodOptions
    from rotortrack.simulate.rod.run import RodRun

Floats = NDArray[np.float64]

TITLE: Final = "thermal noise of the rod: time step and method"

EDGE_NM: Final = 9.0
LENGTHS_NM: Final = (1500.0, 3000.0)
"""Persistence length of the bending rod, and of the stiff one."""
VERTICES: Final = (11, 5)
STEPS_NS: Final = (0.05, 0.1, 0.2, 0.4, 0.8)
DEFAULT_NS: Final = 0.1
METHODS: Final[dict[str, dict[str, Any]]] = {
    "midpoint": {},
    "implicit": {"theta": 1.0},
    "explicit": {"theta": 0.0},
}
"""Implicit part of the bending force."""
SAMPLE_US: Final = 4e-3
BLOCKS: Final = 30
_Z: Final = 1.959963984540054


@dataclass(frozen=True)
class Sizes:
    """Simulated times of the groups, us, steps of the default method and of the others, ns."""

    bending_us: float
    turning_us: float
    steps_ns: tuple[float, ...] = STEPS_NS
    other_steps_ns: tuple[float, ...] = (0.1,)


SIZES: Final = {
    "quick": Sizes(8.0, 16.0, (0.1, 0.2, 0.4), (0.1,)),
    "usual": Sizes(80.0, 120.0, STEPS_NS, (0.1,)),
    "thorough": Sizes(600.0, 1000.0, STEPS_NS, (0.05, 0.1, 0.2)),
}


def answer(effort: Effort, progress: Progress) -> Answer:
    """Simulate both rods in steps of every length."""
    sizes = SIZES[effort.name]
    plans = [("bending", "midpoint", step) for step in sizes.steps_ns]
    plans += [("bending", m, s) for m in ("implicit", "explicit") for s in sizes.other_steps_ns]
    plans += [("turning", "midpoint", step) for step in sizes.steps_ns]
    # Compiled code is loaded by a run that nobody times.
    measure("bending", "midpoint", DEFAULT_NS, Sizes(1.0, 1.0))
    points = []
    for number, (group, method, step_ns) in enumerate(plans):
        progress(group, number, len(plans))
        points.append(measure(group, method, step_ns, sizes))
    floors = {group: _floor(points, group) for group in ("bending", "turning")}
    return stamped(
        question="noise",
        effort=effort,
        points=points,
        error_unit="relative error of the mean",
        seconds_unit="s per simulated us",
        bounds=floors,
        advice=advice(points, floors),
    )


def advice(points: list[Point], floors: dict[str, float]) -> str:
    """Say what the points mean."""
    of = {(point.group, point.setting): point for point in points}
    implicit = of["bending", f"implicit {DEFAULT_NS:g} ns"]
    good = [
        point
        for point in points
        if point.group == "bending" and point.setting.startswith("midpoint") and not point.failed
        if point.error_low <= floors["bending"]
    ]
    chosen = of["bending", f"midpoint {DEFAULT_NS:g} ns"]
    longest = min(good, key=lambda point: point.seconds, default=chosen)
    return (
        f"Midpoint steps show no error beyond the statistical {floors['bending']:.1%} up to "
        f"{longest.setting.removeprefix('midpoint ')}, {chosen.seconds / longest.seconds:.1f} "
        f"times as fast as the default's {DEFAULT_NS:g} ns; wholly implicit ones of "
        f"{DEFAULT_NS:g} ns stiffen the rod by {implicit.error:.0%}."
    )


def measure(group: str, method: str, step_ns: float, sizes: Sizes) -> Point:
    """Simulate one rod by one method in steps of one length."""
    from rotortrack.errors import RodError
    from rotortrack.simulate.rod.options import RodOptions, SteppingOptions, ThermalOptions
    from rotortrack.simulate.rod.run import run_rod

    bends = group == "bending"
    count, length_nm = VERTICES[not bends], LENGTHS_NM[not bends]
    rod = RodOptions(
        n_vertices=count, length_nm=EDGE_NM * (count - 1), persistence_length_nm=length_nm
    )
    duration_us = sizes.bending_us if bends else sizes.turning_us
    stepping = SteppingOptions(duration_us=duration_us, sample_us=SAMPLE_US)
    thermal = ThermalOptions(seed=1, step_us=1e-3 * step_ns, metric_force=True, **METHODS[method])
    is_default = (method, step_ns) == ("midpoint", DEFAULT_NS)
    setting = f"{method} {step_ns:g} ns"
    start = equilibrium_rod(np.random.default_rng(1), rod)
    begun = time.thread_time()
    try:
        run = run_rod(rod, stepping, start, thermal=thermal)
    except RodError as problem:
        seconds = (time.thread_time() - begun) / duration_us
        return Point(
            setting, group, math.nan, math.nan, math.nan, seconds, is_default, str(problem)
        )
    seconds = (time.thread_time() - begun) / duration_us
    value, sd = _bending(run, rod) if bends else _turning(run, rod)
    error = abs(value)
    return Point(
        setting, group, error, max(error - _Z * sd, 0.0), error + _Z * sd, seconds, is_default
    )


def equilibrium_rod(rng: np.random.Generator, rod: RodOptions) -> Floats:
    """Draw a free rod whose joints follow Boltzmann's law, (vertices, 3)."""
    edge_nm = rod.length_nm / (rod.n_vertices - 1)
    angles, weights = _joint_law(rod)
    joints = rng.choice(angles, rod.n_vertices - 2, p=weights)
    azimuths = rng.uniform(0.0, 2.0 * np.pi, rod.n_vertices - 2)
    ahead, aside, up = np.eye(3)
    directions = [ahead]
    for theta, azimuth in zip(joints, azimuths, strict=True):
        across = np.cos(azimuth) * aside + np.sin(azimuth) * up
        ahead = np.cos(theta) * ahead + np.sin(theta) * across
        up = np.cross(ahead, aside)
        up /= np.linalg.norm(up)
        aside = np.cross(up, ahead)
        directions.append(ahead)
    x = np.concatenate([np.zeros((1, 3)), edge_nm * np.cumsum(directions, axis=0)])
    return np.asarray(x - x.mean(axis=0))


def _joint_law(rod: RodOptions) -> tuple[Floats, Floats]:
    """Angles of a joint and their probabilities, exp(-2 Lp/l tan^2(theta/2)) sin(theta)."""
    edge_nm = rod.length_nm / (rod.n_vertices - 1)
    angles = np.linspace(0.0, 1.5, 20_001)
    stiffness = 2.0 * rod.persistence_length_nm / edge_nm
    weights = np.sin(angles) * np.exp(-stiffness * np.tan(0.5 * angles) ** 2)
    return angles, weights / weights.sum()


def _bending(run: RodRun, rod: RodOptions) -> tuple[float, float]:
    """Mean square joint angle over the exact one, less 1, and its standard error."""
    edges = np.diff(run.positions_nm, axis=1)
    edges /= np.linalg.norm(edges, axis=2, keepdims=True)
    cosines = np.einsum("kic,kic->ki", edges[:, 1:], edges[:, :-1])
    squares = np.arccos(np.clip(cosines, -1.0, 1.0)) ** 2
    angles, weights = _joint_law(rod)
    exact = float(np.sum(weights * angles**2))
    mean, sd = _mean_of_blocks(squares.mean(axis=1))
    return mean / exact - 1.0, sd / exact


def _turning(run: RodRun, rod: RodOptions) -> tuple[float, float]:
    """Rotational diffusion between samples over kT / friction, less 1, and its standard error.

    <u(0).u(t)> = exp(-2 D t) of the rod's axis, weighted by friction so that bending has no share.
    """
    from rotortrack.simulate.rod.parameters import BOLTZMANN_PN_NM_K

    weight = np.ones(rod.n_vertices)
    weight[[0, -1]] = 0.5
    along = np.arange(rod.n_vertices) - 0.5 * (rod.n_vertices - 1)
    edge_nm = rod.length_nm / (rod.n_vertices - 1)
    drag = rod.friction_prefactor * 1e-3 * rod.viscosity_mpa_s * edge_nm
    friction = drag * edge_nm**2 * float(weight @ along**2)
    exact = BOLTZMANN_PN_NM_K * rod.temperature_k / friction
    axis = np.einsum("i,kic->kc", weight * along, run.positions_nm)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    mean, sd = _mean_of_blocks(np.einsum("kc,kc->k", axis[1:], axis[:-1]))
    scale = 2.0 * SAMPLE_US * exact
    return -math.log(mean) / scale - 1.0, sd / mean / scale


def _mean_of_blocks(values: Floats) -> tuple[float, float]:
    """Mean of correlated values and its standard error by the scatter of long blocks."""
    length = len(values) // BLOCKS
    means = values[: BLOCKS * length].reshape(BLOCKS, length).mean(axis=1)
    return float(means.mean()), float(means.std(ddof=1)) / math.sqrt(BLOCKS)


def _floor(points: list[Point], group: str) -> float:
    """Half of the median width of the intervals."""
    widths = [p.error_high - p.error for p in points if p.group == group and not p.failed]
    return float(np.median(widths))
