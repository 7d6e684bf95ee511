"""Columns of tables as figures need them, whether or not the table has them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from rotortrack.report import style
from rotortrack.report.figures.canvas import Floats, NothingToDrawError
from rotortrack.report.style import Look


def column(table: pd.DataFrame, name: str) -> Floats:
    """Return a column as floats; nan where the table lacks it."""
    if name not in table:
        return np.full(len(table), np.nan)
    return table[name].to_numpy(np.float64)


def kept(rotors: pd.DataFrame) -> pd.DataFrame:
    """Return the kept rotors; all where there are no verdicts."""
    return rotors[rotors["verdict"] == "kept"] if "verdict" in rotors else rotors


def need(table: pd.DataFrame | None, name: str, columns: Iterable[str]) -> pd.DataFrame:
    """Return a table that has rows, and values in each of these columns.

    Raises
    ------
    NothingToDrawError
        It has not; the reason names the table or column.
    """
    if table is None or len(table) == 0:
        raise NothingToDrawError(f"no {name}")
    for wanted in columns:
        if wanted not in table or not table[wanted].notna().any():
            raise NothingToDrawError(f"the {name} have no {wanted}")
    return table


def looks(rotors: pd.DataFrame) -> list[Look]:
    """Return the look of each rotor's behaviour."""
    if "behaviour" not in rotors:
        return [style.behaviour(None)] * len(rotors)
    return [style.behaviour(name) for name in rotors["behaviour"]]


def interval(
    table: pd.DataFrame, name: str, unit: str, value: Floats, sd: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return the ends of the 95 % intervals `NAME_ci_low_UNIT` and `NAME_ci_high_UNIT`.

    Where they are unknown, 1.96 standard deviations to either side; failing that, the value.
    """
    spread = np.zeros(len(value)) if sd is None else 1.96 * np.nan_to_num(sd)
    low, high = (column(table, f"{name}_ci_{end}_{unit}") for end in ("low", "high"))
    return (
        np.where(np.isfinite(low), low, value - spread),
        np.where(np.isfinite(high), high, value + spread),
    )


def handles(shown: Sequence[Look], *, line: bool = False) -> list[Line2D]:
    """Explain the behaviours that are shown, in their order, with counts."""
    return [
        Line2D(
            [], [], color=look.colour, marker=None if line else look.marker, ms=5, mew=0,
            label=f"{look.label} ({count})",
        )
        for look in style.BEHAVIOURS.values()
        if (count := sum(other is look for other in shown))
    ]  # fmt: skip
