"""How fine the mesh of a nanopore's field must be: errors of current, flow and a rotor's rate.

The paper's pore is solved with each preset of meshes, and read from the table that comes with the
package; another pore, of which there is no table, has to be solved. Errors are relative, against a
far finer mesh whose table has half the spacing. A rod's rate shows more of a mesh than current and
flow do, since the rod touches the rim, where a sharp edge makes the field singular.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, stamped

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rotortrack.simulate.field.table import FieldTable
    from rotortrack.simulate.rod.options import RodOptions

    Array = NDArray[np.float64]

TITLE: Final = "the nanopore's field: meshes and the stored table"

STORED: Final = "stored table"
PRESET: Final = "default"
OTHER_PORE: Final[dict[str, Any]] = {"surface_charge_e_nm2": -0.12}
OTHER: Final = ", another pore"
RODS: Final = ((0.26, 130.0), (0.26, 138.0), (0.35, 122.0))
"""lambda_eff and flow ratio of the rods whose rates are compared."""
RUN_US: Final = 500.0


@dataclass(frozen=True)
class Sizes:
    """Presets tried on each pore, the references' first cell (nm) and ratio, rods compared."""

    presets: tuple[str, ...]
    other_presets: tuple[str, ...]
    reference: tuple[float, float]
    other_reference: tuple[float, float]
    rods: int = len(RODS)


_ALL: Final = ("fast", "default", "careful")

SIZES: Final = {
    "quick": Sizes(("fast", "default"), (), (0.06, 1.3), (0.06, 1.3), 1),
    "usual": Sizes(_ALL, ("fast", "default"), (0.02, 1.12), (0.03, 1.15)),
    "thorough": Sizes(_ALL, _ALL, (0.01, 1.08), (0.014, 1.1)),
}


@dataclass(frozen=True)
class Numbers:
    """What is compared of a field, and the processor time of solving and of tabulating it."""

    current_a: float
    flow_m3_s: float
    table: FieldTable
    solve_s: float
    table_s: float


def answer(effort: Effort, progress: Progress) -> Answer:
    """Solve the paper's pore and another one by every preset."""
    sizes = SIZES[effort.name]
    points = measure({}, "", sizes, progress)
    if sizes.other_presets:
        points += measure(OTHER_PORE, OTHER, sizes, progress)
    return stamped(
        question="field",
        effort=effort,
        points=points,
        error_unit="relative error",
        seconds_unit="s per field",
        bounds=dict.fromkeys(dict.fromkeys(point.group for point in points)),
        advice=advice(points),
    )


def advice(points: list[Point]) -> str:
    """Say what the points mean."""
    of = {(point.group, point.setting): point for point in points}
    stored, solved = of["rate", STORED], of["rate", PRESET]
    return (
        f"For the paper's pore take the stored table: the rate to {stored.error:.1g} in "
        f"{1e3 * stored.seconds:.0f} ms, against {solved.error:.1g} in {solved.seconds:.1f} s by "
        f"the default meshes; these give the flow to {of['flow', PRESET].error:.1g}, and a rod's "
        "rate needs finer ones than the flow does."
    )


def measure(options: dict[str, Any], suffix: str, sizes: Sizes, progress: Progress) -> list[Point]:
    """Compare the presets, and for the paper's pore the stored table, with a finer solution."""
    progress(f"reference{suffix}", 0, 0)
    finest = _finest(options, sizes.other_reference if options else sizes.reference)
    presets = sizes.other_presets if options else sizes.presets
    found = {}
    for number, preset in enumerate(presets):
        progress(f"presets{suffix}", number, len(presets))
        found[preset] = _solved({**options, "accuracy": preset})
    if not options:
        found[STORED] = _stored()
    true_rates, starts = [], []
    if not options:
        # Near the shapes that a run on the stored table leaves, those on the others are sought.
        starts = [(rod, _rotating(rod, found[STORED].table)) for rod in RODS[: sizes.rods]]
        true_rates = [_rate(rod, shape, finest.table) for rod, shape in starts]
    points = []
    for setting, numbers in found.items():
        is_default = setting == (PRESET if options else STORED)
        measured = {
            "current": ([numbers.current_a], [finest.current_a], numbers.solve_s),
            "flow": ([numbers.flow_m3_s], [finest.flow_m3_s], numbers.solve_s),
        }
        if starts:
            rates = [_rate(rod, shape, numbers.table) for rod, shape in starts]
            measured["rate"] = (rates, true_rates, numbers.solve_s + numbers.table_s)
        for group, (values, truths, seconds) in measured.items():
            errors = [abs(value / truth - 1.0) for value, truth in zip(values, truths, strict=True)]
            error = math.sqrt(sum(each**2 for each in errors) / len(errors))
            low, high = min(errors), max(errors)
            points.append(Point(setting, group + suffix, error, low, high, seconds, is_default))
    return points


def _finest(options: dict[str, Any], mesh: tuple[float, float]) -> Numbers:
    from rotortrack.simulate.field.options import FieldOptions
    from rotortrack.simulate.field.solve import as_solution, field_grid, solve_on
    from rotortrack.simulate.field.table import SPACING, tabulate

    field = FieldOptions(**options)
    solved = solve_on(field, field_grid(field, *mesh))
    wall_nm, growth, most_nm = SPACING
    halved = (0.5 * wall_nm, growth**0.5, 0.5 * most_nm)
    table = tabulate(as_solution(field, solved), halved)
    return Numbers(solved.current_a, solved.flow_m3_s, table, 0.0, 0.0)


def _solved(options: dict[str, Any]) -> Numbers:
    from rotortrack.simulate.field.options import FieldOptions
    from rotortrack.simulate.field.solve import solve_field
    from rotortrack.simulate.field.table import tabulate

    begun = time.process_time()
    solution = solve_field(FieldOptions(**options))
    solved = time.process_time()
    table = tabulate(solution)
    ended = time.process_time()
    return Numbers(solution.current_a, solution.flow_m3_s, table, solved - begun, ended - solved)


def _stored() -> Numbers:
    from rotortrack.simulate.field.embedded import EMBEDDED
    from rotortrack.simulate.field.table import FieldTable

    spent_s = math.inf
    for _ in range(3):
        begun = time.process_time()
        table = FieldTable.load(EMBEDDED)
        spent_s = min(spent_s, time.process_time() - begun)
    return Numbers(table.current_a, table.flow_m3_s, table, spent_s, 0.0)


def _rotating(rod: tuple[float, float], table: FieldTable) -> Array:
    """Give a shape that rotates, near which those on the other tables are sought."""
    from rotortrack.simulate.rod.options import StartOptions, SteppingOptions
    from rotortrack.simulate.rod.placement import place_rod
    from rotortrack.simulate.rod.run import run_rod

    start = place_rod(_rod(rod), StartOptions(), membrane_nm=table.membrane_nm)
    stepping = SteppingOptions(duration_us=RUN_US, sample_us=RUN_US)
    last: Array = run_rod(_rod(rod), stepping, start, table).positions_nm[-1]
    return last


def _rate(rod: tuple[float, float], shape_nm: Array, table: FieldTable) -> float:
    from rotortrack.simulate.rod.relative_equilibrium import find_equilibrium

    return find_equilibrium(_rod(rod), table, shape_nm).rate_rev_s


def _rod(rod: tuple[float, float]) -> RodOptions:
    from rotortrack.simulate.rod.options import RodOptions

    return RodOptions(lambda_eff=rod[0], flow_ratio=rod[1])
