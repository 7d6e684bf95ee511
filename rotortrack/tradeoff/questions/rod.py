"""How a rod's time is best stepped, and how many vertices it needs.

`stepping`: a rod docks on the paper's pore and begins to rotate; the error is that of its mean rate
over the last stretch, relative to steps of a far smaller tolerance, so that vertices cost nothing
here. The paper's explicit Euler with capped displacements, explicit Euler of a fixed step, and
extrapolated implicit steps of several tolerances are compared.

`vertices`: the rate of the settled rod against that of many vertices, over the three starts; with
few, wrong states are found. Newton's method, begun at what loose steps leave, gives the steady
state of its vertices without error of time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeVar

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, stamped

if TYPE_CHECKING:
    from rotortrack.simulate.rod.run import RodRun

_Made = TypeVar("_Made")

TITLE: Final = "the rod: time steps, and vertices"

STEPPING: Final[dict[str, dict[str, Any]]] = {
    "paper's Euler": {"method": "paper"},
    "explicit 0.35 ns": {"method": "explicit", "step_us": 3.5e-4},
    "implicit 0.1 nm": {"tolerance_nm": 0.1},
    "implicit 0.01 nm": {},
    "implicit 0.001 nm": {"tolerance_nm": 1e-3},
    "implicit 0.0001 nm": {"tolerance_nm": 1e-4},
}
EXPLICIT: Final = ("paper's Euler", "explicit 0.35 ns")
DEFAULT_STEPPING: Final = "implicit 0.01 nm"
DEFAULT_VERTICES: Final = 51
OFFSET_NM: Final = (90.0, 15.0)
"""Of the placements the one from which a rod rotates soonest."""

RESOLVED: Final = 1e-9
"""Relative error of a rate that is not told from none: the reference is not better."""

STATE_WRONG: Final = 0.5


@dataclass(frozen=True)
class Sizes:
    """Simulated times (us) of the two groups, what is tried, and the reference's vertices."""

    stepping_us: float
    settled_us: float
    vertices: tuple[int, ...]
    finest: int
    starts: int
    newton: tuple[int, ...]
    repeats: int = 1
    reference_nm: float = 1e-5


SIZES: Final = {
    "quick": Sizes(20.0, 100.0, (26, 51, 101), 151, 1, (51,), 1, 1e-4),
    "usual": Sizes(200.0, 300.0, (26, 51, 76, 101, 151, 201), 401, 3, (51, 101), 2),
    "thorough": Sizes(500.0, 500.0, (26, 51, 76, 101, 151, 201, 301), 601, 3, (51, 101, 201), 5),
}


def answer(effort: Effort, progress: Progress) -> Answer:
    """Step a rod in all ways, then rods of many and few vertices in the default way."""
    sizes = SIZES[effort.name]
    points = [*stepping(sizes, progress), *vertices(sizes, progress)]
    return stamped(
        question="rod",
        effort=effort,
        points=points,
        error_unit="relative error of the rate",
        seconds_unit="s per run",
        bounds={"stepping": None, "vertices": None},
        advice=advice(points),
    )


def advice(points: list[Point]) -> str:
    """Say what the points mean."""
    of = {point.setting: point for point in points}
    chosen, paper = of[DEFAULT_STEPPING], of["paper's Euler"]
    few, more = of[f"{DEFAULT_VERTICES} vertices"], of["101 vertices"]
    return (
        f"Implicit steps of the default tolerance err by {chosen.error:.0e} and are "
        f"{paper.seconds / chosen.seconds:.0f} times as fast as the paper's, so that the vertices "
        f"decide: {DEFAULT_VERTICES} err by {few.error:.0%}, 101 by {more.error:.0%} in "
        f"{more.seconds / few.seconds:.1f} times the time; below {DEFAULT_VERTICES} wrong states "
        "are found."
    )


def stepping(sizes: Sizes, progress: Progress) -> list[Point]:
    """Compare ways of stepping by the rate over the last tenth of the docking of one rod."""
    span_us = 0.1 * sizes.stepping_us
    progress("reference", 0, 0)
    fine: dict[str, Any] = {"tolerance_nm": sizes.reference_nm, "max_step_us": 0.02}
    true = late_rate(_run(sizes.stepping_us, **fine), span_us)
    errors, seconds = {}, dict.fromkeys(STEPPING, math.inf)
    for repeat in range(sizes.repeats):
        for number, (name, chosen) in enumerate(STEPPING.items()):
            if repeat and name in EXPLICIT:
                continue
            progress("stepping", repeat * len(STEPPING) + number, sizes.repeats * len(STEPPING))
            run, spent_s = timed(partial(_run, sizes.stepping_us, **chosen))
            errors[name] = max(abs(late_rate(run, span_us) / true - 1.0), RESOLVED)
            seconds[name] = min(seconds[name], spent_s)
    return [
        Point(name, "stepping", error, error, error, seconds[name], name == DEFAULT_STEPPING)
        for name, error in errors.items()
    ]


def vertices(sizes: Sizes, progress: Progress) -> list[Point]:
    """Compare numbers of vertices by the settled rate, from several starts."""
    from rotortrack.simulate.rod.placement import PLACEMENTS

    offsets = PLACEMENTS[::-1][: sizes.starts]
    progress("reference", 0, 0)
    true = [abs(settled(sizes.finest, offset, sizes, newton=True)[0]) for offset in offsets]
    plans = [(count, False) for count in sizes.vertices] + [(n, True) for n in sizes.newton]
    points = []
    for number, (count, newton) in enumerate(plans):
        progress("vertices", number, len(plans))
        name = f"{count} vertices" + (", Newton" if newton else "")
        errors, seconds = [], 0.0
        for offset, rate in zip(offsets, true, strict=True):
            found, spent_s = settled(count, offset, sizes, newton=newton)
            errors.append(abs(abs(found) / rate - 1.0))
            seconds += spent_s / len(offsets)
        failed = "a wrong state" if max(errors) > STATE_WRONG else ""
        error = math.sqrt(sum(each**2 for each in errors) / len(errors))
        is_default = count == DEFAULT_VERTICES and not newton
        points.append(
            Point(name, "vertices", error, min(errors), max(errors), seconds, is_default, failed)
        )
    return points


def settled(
    count: int, offset_nm: tuple[float, float], sizes: Sizes, *, newton: bool
) -> tuple[float, float]:
    """Give the rate at which a rod rotates in the end, rev/s, and the seconds to find it."""
    from rotortrack.errors import RodError
    from rotortrack.simulate.field.embedded import embedded_table
    from rotortrack.simulate.rod.options import RodOptions
    from rotortrack.simulate.rod.relative_equilibrium import find_equilibrium

    loose: dict[str, Any] = {"tolerance_nm": 0.1} if newton else {}
    run, spent_s = timed(lambda: _run(sizes.settled_us, count, offset_nm, **loose))
    rate = late_rate(run, 0.1 * sizes.settled_us) * 1e6 / (2.0 * math.pi)
    if not newton:
        return rate, spent_s
    rod = RodOptions(n_vertices=count)
    try:
        found, more_s = timed(lambda: find_equilibrium(rod, embedded_table(), run.positions_nm[-1]))
    except RodError:
        return rate, spent_s
    return found.rate_rev_s, spent_s + more_s


def late_rate(run: RodRun, span_us: float) -> float:
    """Mean rate over the last stretch, rad/us."""
    import numpy as np

    begin = int(np.searchsorted(run.time_us, run.time_us[-1] - span_us - 1e-9))
    turned = run.turned_rad[-1] - run.turned_rad[begin]
    return float(turned / (run.time_us[-1] - run.time_us[begin]))


def timed(make: Callable[[], _Made]) -> tuple[_Made, float]:
    """Make something and tell the processor time of this thread, s."""
    begun = time.thread_time()
    made = make()
    return made, time.thread_time() - begun


def _run(
    duration_us: float,
    count: int = DEFAULT_VERTICES,
    offset_nm: tuple[float, float] = OFFSET_NM,
    **stepping: Any,
) -> RodRun:
    from rotortrack.simulate.field.embedded import embedded_table
    from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
    from rotortrack.simulate.rod.placement import place_rod
    from rotortrack.simulate.rod.run import run_rod

    field = embedded_table()
    rod = RodOptions(n_vertices=count)
    at = StartOptions(offset_x_nm=offset_nm[0], offset_y_nm=offset_nm[1])
    start = place_rod(rod, at, membrane_nm=field.membrane_nm)
    options = SteppingOptions(duration_us=duration_us, sample_us=0.01 * duration_us, **stepping)
    return run_rod(rod, options, start, field)
