"""The table of the paper's own pore that comes with the package, and the command that makes it.

python -m rotortrack.simulate.field.embedded
"""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import Final

from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.table import FieldTable, tabulate

EMBEDDED: Final = Path(__file__).with_name("default_field.npz")

_MESHES: Final = ((0.05, 1.2), (0.03, 1.15))
"""Finest cells (nm) and growth of the two meshes."""


@functools.cache
def embedded_table() -> FieldTable:
    """Load the table of the default options, solved carefully."""
    return FieldTable.load(EMBEDDED)


def is_embedded(options: FieldOptions) -> bool:
    """Whether the table that comes with the package holds the fields of these options.

    It does for any voltage to which it can be scaled; how accurately a solution would be asked for
    does not matter, since the table is of the most accurate one.
    """
    ours = embedded_table().options
    free = {"voltage_v", "accuracy"}
    asked = dataclasses.asdict(options)
    return all(asked[name] == value for name, value in ours.items() if name not in free)


def main() -> None:
    """Solve the default field on two fine meshes and put the table of the finer in its place.

    A rod's rate shows more of a mesh than current and flow do, since it feels the field beside the
    rim: rates on this table and on one of half its spacing differ by 0.1 to 0.3 %, as much as
    those on the two meshes.
    """
    from rotortrack.simulate.field.solve import as_solution, field_grid, solve_on

    options = FieldOptions(accuracy="careful")
    coarse, fine = (solve_on(options, field_grid(options, *each)) for each in _MESHES)
    shrinkage = _MESHES[1][0] / _MESHES[0][0]
    # The singular rim leaves an error in proportion to its smallest cells.
    rest = shrinkage / (1.0 - shrinkage)
    solution = as_solution(
        options,
        fine,
        current_error_rel=rest * abs(1.0 - coarse.current_a / fine.current_a),
        flow_error_rel=rest * abs(1.0 - coarse.flow_m3_s / fine.flow_m3_s),
    )
    tabulate(solution).save(EMBEDDED, compact=True)


if __name__ == "__main__":
    main()
