"""How fine the mesh of a nanopore's field must be: errors of current, flow and a rotor's rate.

The paper's pore is solved with each preset of meshes, and read from the table that comes with the
package; another pore, of which there is no table, has to be solved. Errors are relative, against a
far finer mesh whose table has half the spacing. A rod's rate shows more of a mesh than current and
flow do, since the rod touches the rim, where a sharp edge makes the field singular.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, stamped

if TYPE_CHECKING:
    from rotortrack.simulate.field.table import FieldTable

TITLE: Final = "the nanopore's field: meshes and the stored table"

STORED: Final = "stored table"
PRESET: Final = "default"
OTHER_PORE: Final[dict[str, Any]] = {"pore_radius_nm": 15.0}
OTHER: Final = ", pore of 15 nm"
RUN_US: Final = 500.0


@dataclass(frozen=True)
class Sizes:
    """Presets tried on each pore, and the reference's first cell (nm) and ratio of neighbours."""

    presets: tuple[str, ...]
    other_presets: tuple[str, ...]
    reference: tuple[float, float]


SIZES: Final = {
    "quick": Sizes(("fast", "default"), (), (0.06, 1.3)),
    "usual": Sizes(("fast", "default", "careful"), ("fast", "default", "careful"), (0.03, 1.15)),
    "thorough": Sizes(("fast", "default", "careful"), ("fast", "default", "careful"), (0.014, 1.1)),
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
    points = measure({}, "", sizes.presets, sizes.reference, progress)
    if sizes.other_presets:
        points += measure(OTHER_PORE, OTHER, sizes.other_presets, sizes.reference, progress)
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


def measure(
    options: dict[str, Any],
    suffix: str,
    presets: tuple[str, ...],
    reference: tuple[float, float],
    progress: Progress,
) -> list[Point]:
    """Compare the presets, and for the paper's pore the stored table, with a finer solution."""
    progress(f"reference{suffix}", 0, 0)
    finest = _finest(options, reference)
    found = {}
    for number, preset in enumerate(presets):
        progress(f"presets{suffix}", number, len(presets))
        found[preset] = _solved({**options, "accuracy": preset})
    if not options:
        found[STORED] = _stored()
    start = _rotating(finest.table)
    truth = {
        "current": finest.current_a,
        "flow": finest.flow_m3_s,
        "rate": _rate(finest.table, start),
    }
    points = []
    for setting, numbers in found.items():
        is_default = setting == (PRESET if options else STORED)
        measured = {
            "current": (numbers.current_a, numbers.solve_s),
            "flow": (numbers.flow_m3_s, numbers.solve_s),
            "rate": (_rate(numbers.table, start), numbers.solve_s + numbers.table_s),
        }
        for group, (value, seconds) in measured.items():
            error = abs(value / truth[group] - 1.0)
            points.append(
                Point(setting, group + suffix, error, error, error, seconds, is_default)
            )
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
    return Numbers(
        solution.current_a, solution.flow_m3_s, table, solved - begun, ended - solved
    )


def _stored() -> Numbers:
    from rotortrack.simulate.field.embedded import EMBEDDED
    from rotortrack.simulate.field.table import FieldTable

    begun = time.process_time()
    table = FieldTable.load(EMBEDDED)
    spent_s = time.process_time() - begun
    return Numbers(table.current_a, table.flow_m3_s, table, spent_s, 0.0)


def _rotating(table: FieldTable) -> Any:
    """Give a shape that rotates on the finest field, near which those on the others are sought."""
    from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
    from rotortrack.simulate.rod.placement import place_rod
    from rotortrack.simulate.rod.run import run_rod

    rod = RodOptions()
    start = place_rod(rod, StartOptions(), membrane_nm=table.membrane_nm)
    stepping = SteppingOptions(duration_us=RUN_US, sample_us=RUN_US)
    return run_rod(rod, stepping, start, table).positions_nm[-1]


def _rate(table: FieldTable, start: Any) -> float:
    from rotortrack.simulate.rod.options import RodOptions
    from rotortrack.simulate.rod.relative_equilibrium import find_equilibrium

    return find_equilibrium(RodOptions(), table, start).rate_rev_s
