"""How a ThunderSTORM table is laid out: which cell holds what, and in which unit."""

from __future__ import annotations

import dataclasses
import io
import math
import re
import warnings
from collections.abc import Callable
from pathlib import Path

from rotortrack.errors import TableError, TableWarning
from rotortrack.exchange.csv_dialect import Dialect, cells_of, read_dialect
from rotortrack.exchange.csv_stream import open_bytes
from rotortrack.exchange.writer import listed

_LINE_CHARACTERS = 65_536
"""No row is longer; what is longer is looked at in pieces."""

_LENGTHS = {
    "x": "x_nm",
    "y": "y_nm",
    "sigma": "sigma_nm",
    "uncertainty": "uncertainty_nm",
    "uncertainty_xy": "uncertainty_nm",
}
_SIGNALS = {"intensity": "photons", "offset": "background", "bkgstd": "background_sd"}
_PLAIN = {"frame": "frame", "chi2": "chi2"}
_IGNORED = {"id", "detections"}
_NM_PER_UNIT = {"nm": 1.0, "um": 1e3, "µm": 1e3, "μm": 1e3}
_LONGEST_NAME = 200
_CELL = re.compile(r"^(?P<name>[^\[]*?)\s*(?:\[(?P<unit>[^\]]*)\])?$")


@dataclasses.dataclass(frozen=True)
class Layout:
    """A table's columns and punctuation.

    Parameters
    ----------
    cell_names
        A unique name for every cell of a row; our column's name where we read it.
    scales
        Factor from the file's unit to ours, by our column's name; frame is not among them.
    dialect
        How rows are cut and numbers written.
    """

    cell_names: list[str]
    scales: dict[str, float]
    dialect: Dialect

    @property
    def wanted(self) -> list[str]:
        """The columns to parse."""
        return ["frame", *self.scales]

    def is_wrong_length(self, cells: list[str]) -> bool:
        """Whether a row has more or fewer cells than the header."""
        return len(cells) != len(self.cell_names)

    def is_not_numeric(self, cells: list[str]) -> bool:
        """Whether a row of the right length holds text where a number belongs."""
        return not self.is_wrong_length(cells) and any(
            self._number(cells, name) is None for name in self.wanted
        )

    def has_no_whole_frame(self, cells: list[str]) -> bool:
        """Whether a row of the right length has a frame that is not a whole number."""
        if self.is_wrong_length(cells):
            return False
        frame = self._number(cells, "frame")
        return frame is None or not math.isfinite(frame) or frame != round(frame)

    def _number(self, cells: list[str], name: str) -> float | None:
        text = cells[self.cell_names.index(name)].strip().replace(self.dialect.decimal_point, ".")
        try:
            return float(text or "nan")
        except ValueError:
            return None


def read_layout(path: Path, pixel_size_nm: float | None) -> Layout:
    """Understand the header of a table.

    Raises
    ------
    TableError
        Frame, x or y is missing or there twice, or a length is in an unknown unit.
    """
    dialect = read_dialect(path)
    if not dialect.header:
        raise TableError(f"{path} is empty: export the table again")
    names, scales = _understand(dialect.header, path, pixel_size_nm)
    return Layout(cell_names=names, scales=scales, dialect=dialect)


def first_line_where(
    path: Path, layout: Layout, is_wrong: Callable[[list[str]], bool], *, part: str = ""
) -> int | None:
    """Find the number, from 1, of the first line below the header whose cells are wrong.

    The fast parser counts rows only when it runs on one thread; this looks once, after a fault,
    and only at lines that hold `part`.
    """
    dialect = layout.dialect
    with io.TextIOWrapper(open_bytes(path), encoding="utf-8", errors="replace") as stream:
        number = 1
        while line := stream.readline(_LINE_CHARACTERS):
            if (
                number > dialect.header_line
                and part in line
                and line.strip()
                and is_wrong(cells_of(line, dialect.delimiter, quoted=dialect.quoted))
            ):
                return number
            number += line.endswith("\n")
    return None


def _understand(
    cells: list[str], path: Path, pixel_size_nm: float | None
) -> tuple[list[str], dict[str, float]]:
    """Give every cell a name and every length a factor; say what is not used."""
    names: list[str] = []
    taken: set[str | None] = set()
    scales: dict[str, float] = {}
    unknown: list[str] = []
    in_adu: list[str] = []
    for index, cell in enumerate(cells):
        parts = _CELL.match(cell) if len(cell) <= _LONGEST_NAME else None
        name = parts["name"].lower() if parts else ""
        unit = (parts["unit"] or "").strip() if parts else ""
        column = _LENGTHS.get(name) or _SIGNALS.get(name) or _PLAIN.get(name)
        if column in taken:
            raise TableError(f"{path} has two columns for {column}: remove one, such as {cell!r}")
        if name in _SIGNALS and unit.lower() not in ("photon", "photons"):
            in_adu.append(cell)
            column = None
        elif column is None and name not in _IGNORED and (cell or index < len(cells) - 1):
            unknown.append(cell)
        names.append(column or f"cell {index}")
        if column is not None:
            taken.add(column)
        if column is not None and name in _LENGTHS:
            scales[column] = _nm_per(unit, cell, path, pixel_size_nm)
        elif column is not None and column != "frame":
            scales[column] = 1.0
    missing = [name for name in ("frame", "x_nm", "y_nm") if name not in taken]
    if missing:
        wanted = ", ".join(_HEADER_OF[name] for name in missing)
        remedy = ": its first line must name the columns" if len(missing) == len(_HEADER_OF) else ""
        raise TableError(
            f"{path} is no ThunderSTORM table: it lacks {wanted}; found {listed(cells)}{remedy}"
        )
    _warn_of(unknown, in_adu, path)
    return names, scales


_HEADER_OF = {"frame": "frame", "x_nm": "x [nm]", "y_nm": "y [nm]"}


def _nm_per(unit: str, cell: str, path: Path, pixel_size_nm: float | None) -> float:
    if unit.lower() in _NM_PER_UNIT:
        return _NM_PER_UNIT[unit.lower()]
    if unit.lower() not in ("px", "pixel", "pixels"):
        raise TableError(
            f"{path}: column {cell!r} has {f'the unknown unit {unit!r}' if unit else 'no unit'}; "
            "write [nm], [um] or [px] behind its name"
        )
    if pixel_size_nm is None:
        raise TableError(
            f"{path}: column {cell!r} is in pixels; give their size with --pixel-size-nm"
        )
    return pixel_size_nm


def _warn_of(unknown: list[str], in_adu: list[str], path: Path) -> None:
    if unknown:
        warnings.warn(
            f"{path}: the column(s) {listed(unknown)} were left out, as nothing here uses them",
            TableWarning,
            stacklevel=6,
        )
    if in_adu:
        warnings.warn(
            f"{path}: the column(s) {listed(in_adu)} are not in photons and were "
            "left out; export them in photons if they are needed",
            TableWarning,
            stacklevel=6,
        )
