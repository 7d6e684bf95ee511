"""Which field a scene gets: the one that comes with the program, a file, or a new solution."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.table import LINEAR_TO_V, FieldTable, tabulate

Source = Literal["embedded", "solved", "file"]


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
    FieldError
        The file cannot be scaled to the voltage, or the equations did not converge.
    ArchiveError
        The file is no field.
    """
    begun = time.perf_counter()
    if file is not None:
        stored, origin = FieldTable.load(file), f"{file} at {options.voltage_v:g} V"
        differences = differences_of(options, stored)
        if differences:
            raise ConfigurationError(*(f"{file} was made with {word}" for word in differences))
        table = stored.scaled(options.voltage_v)
        return SceneField(table, "file", origin, None, time.perf_counter() - begun)
    if not solve:
        stored = embedded_table()
        differences = differences_of(options, stored)
        if abs(options.voltage_v) > LINEAR_TO_V:
            differences.append(f"voltages to {LINEAR_TO_V:g} V, not {options.voltage_v:g}")
        if not differences:
            table, origin = stored.scaled(options.voltage_v), "embedded table"
            if options.voltage_v != stored.voltage_v:
                origin += f", scaled to {options.voltage_v:g} V"
            return SceneField(table, "embedded", origin, None, time.perf_counter() - begun)
        if solve is False:
            raise ConfigurationError(
                *(f"the embedded table is for {word}: leave --no-solve out" for word in differences)
            )
    from rotortrack.simulate.field.solve import solve_field

    solution = solve_field(options)
    table, origin = tabulate(solution), f"solved for this scene, accuracy {options.accuracy}"
    return SceneField(table, "solved", origin, solution.unknowns, time.perf_counter() - begun)


def differences_of(options: FieldOptions, table: FieldTable) -> list[str]:
    """Say in which options, voltage and accuracy apart, a table is another field's."""
    wanted = dataclasses.asdict(options)
    return [
        f"{name} = {table.options[name]}, not {value}"
        for name, value in wanted.items()
        if name not in _FREE and table.options[name] != value
    ]


_FREE = ("voltage_v", "accuracy")
