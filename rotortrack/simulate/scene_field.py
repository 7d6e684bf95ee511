"""Which field a scene gets: the one that comes with the program, a file, or a new solution."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rotortrack.errors import ConfigurationError

if TYPE_CHECKING:
    from rotortrack.simulate.field.options import FieldOptions
    from rotortrack.simulate.field.table import FieldTable

Source = Literal["embedded", "solved", "file"]

LARGEST_SCALED_V = 0.2
"""Up to this voltage fields are proportional to it within 2.5 %."""


@dataclass(frozen=True)
class SceneField:
    """A table of the field, and where it comes from.

    Attributes
    ----------
    table
        The field at the scene's voltage.
    source
        `embedded`: the table that comes with the program, scaled; `solved`; `file`.
    origin
        The same in words.
    unknowns
        Unknowns of the solution; None where nothing was solved.
    seconds
        How long it took.
    """

    table: FieldTable
    source: Source
    origin: str
    unknowns: int | None
    seconds: float


def field_for(
    options: FieldOptions, *, solve: bool | None = None, file: Path | None = None
) -> SceneField:
    """Give the field of a scene.

    Parameters
    ----------
    options
        The scene's section [field].
    solve
        Solve in any case, or (False) never; not given, the embedded table is used where it is that
        of the scene but for the voltage, and else the equations are solved.
    file
        A table that `rotortrack simulate field` wrote, used instead.

    Raises
    ------
    ConfigurationError
        Another pore or salt was asked for than that of the file, or than that of the embedded
        table where solving was refused; each difference is named.
    """
    begun = time.perf_counter()
    if file is not None:
        from rotortrack.simulate.field.table import FieldTable

        stored = FieldTable.load(file)
        differences = differences_of(options, stored)
        if differences:
            raise ConfigurationError(*(f"{file} was made with {word}" for word in differences))
        table, origin = stored.scaled(options.voltage_v), f"{file} at {options.voltage_v:g} V"
        return SceneField(table, "file", origin, None, time.perf_counter() - begun)
    if not solve:
        from rotortrack.simulate.field.embedded import embedded_table

        stored = embedded_table()
        differences = differences_of(options, stored)
        if abs(options.voltage_v) > LARGEST_SCALED_V:
            differences.append(f"voltages to {LARGEST_SCALED_V:g} V, not {options.voltage_v:g}")
        if not differences:
            table = stored.scaled(options.voltage_v)
            origin = f"embedded table, scaled to {options.voltage_v:g} V"
            return SceneField(table, "embedded", origin, None, time.perf_counter() - begun)
        if solve is False:
            raise ConfigurationError(
                *(f"the embedded table is for {word}: give --solve" for word in differences)
            )
    from rotortrack.simulate.field.solve import solve_field
    from rotortrack.simulate.field.table import tabulate

    solution = solve_field(options)
    table = tabulate(solution)
    return SceneField(
        table, "solved", "solved for this scene", solution.unknowns, time.perf_counter() - begun
    )


def differences_of(options: FieldOptions, table: FieldTable) -> list[str]:
    """Say in which options, voltage and accuracy apart, a table is another field's."""
    wanted = dataclasses.asdict(options)
    return [
        f"{name} = {table.options.get(name)}, not {value}"
        for name, value in wanted.items()
        if name not in _FREE and table.options.get(name) != value
    ]


_FREE = ("voltage_v", "accuracy")
