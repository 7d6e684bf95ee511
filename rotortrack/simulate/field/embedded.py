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
    """Solve the default field carefully and put its table in its place."""
    from rotortrack.simulate.field.solve import solve_field

    tabulate(solve_field(FieldOptions(accuracy="careful"))).save(EMBEDDED, compact=True)


if __name__ == "__main__":
    main()
