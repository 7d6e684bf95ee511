"""Numbers and sentences as every figure and page of a report words them."""

from __future__ import annotations

import math
import textwrap
from typing import Any, Protocol

from rotortrack.report import style
from rotortrack.units import TURN_RAD


class Row(Protocol):
    """One row of a table, such as a dict or a pandas Series."""

    def get(self, key: Any, default: Any = None, /) -> Any:
        """Return the value of a column, or the default where the column is absent."""


def number(row: Row, name: str) -> float:
    """Return a column's value as a float, nan where it is absent, empty or not a number."""
    value = row.get(name)
    try:
        return math.nan if value is None else float(value)
    except (TypeError, ValueError):
        return math.nan


def text(row: Row, name: str) -> str:
    """Return a column's text on one line, empty where it is absent or missing."""
    value = row.get(name)
    return " ".join(value.split()) if isinstance(value, str) else ""


def rev_per_s(row: Row) -> tuple[float, float]:
    """Return a rotor's signed speed and its standard deviation in revolutions per second."""
    speed = number(row, "rev_per_s")
    if not math.isfinite(speed):
        speed = number(row, "omega_rad_s") / TURN_RAD
    return speed, number(row, "omega_sd_rad_s") / TURN_RAD


def plus_minus(value: float, sd: float, unit: str, *, signed: bool = False) -> str:
    """Write `value ± sd unit`, rounded to two digits of the sd, or to three of the value."""
    if not math.isfinite(value):
        return f"unknown {unit}".strip()
    known = math.isfinite(sd) and sd > 0
    scale = sd if known else abs(value)
    digits = 2 if known else 3
    decimals = 0 if scale == 0 else max(0, digits - 1 - math.floor(math.log10(scale)))
    sign = "+" if signed else ""
    spread = f" ± {sd:.{decimals}f}" if known else ""
    words = f"{value:{sign}.{decimals}f}{spread} {unit}".strip()
    return minus(words)


def minus(words: str) -> str:
    """Write a typographic minus, as matplotlib does on its axes."""
    return words.replace("-", "\N{MINUS SIGN}")


def name(row: Row) -> str:
    """Write which rotor a row is."""
    value = number(row, "rotor")
    return f"Rotor {value:.0f}" if math.isfinite(value) else "Rotor"


def title(row: Row) -> str:
    """Write a rotor's number, behaviour and speed; when refused its number and the reason."""
    if text(row, "verdict") == "refused":
        reason = text(row, "reason")
        return f"{name(row)}, refused" + (f": {reason}" if reason else "")
    speed, sd = rev_per_s(row)
    kind = text(row, "behaviour")
    words = name(row) + (f", {style.behaviour(kind).label}" if kind else "")
    if not math.isfinite(speed):
        return words
    return f"{words}: {plus_minus(speed, sd, 'rev/s', signed=True)}"


def wrap(words: str, width: int, lines: int) -> str:
    """Break text into at most `lines` lines of `width` characters, cut with an ellipsis."""
    return "\n".join(textwrap.wrap(words, width, max_lines=lines, placeholder=" ..."))


def count(number_of: int, noun: str) -> str:
    """Write a count with thin spaces between thousands and the noun in its number."""
    plural = "" if number_of == 1 else "s"
    return f"{number_of:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") + f" {noun}{plural}"
