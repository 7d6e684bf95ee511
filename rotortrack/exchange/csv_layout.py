"""How a ThunderSTORM table is laid out: which cell holds what, in which unit, and how it is cut."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import gzip
import io
import math
import re
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, cast

from rotortrack.errors import TableError, TableWarning

_HEADER_BYTES = 65_536
"""No header is longer; the rest of a binary file is not read in search of a line end."""

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
    header_line
        Line number of the header, from 1.
    delimiter, decimal_point, quoted
        How rows are cut and numbers written.
    has_rows
        Whether anything follows the header.
    """

    cell_names: list[str]
    scales: dict[str, float]
    header_line: int
    delimiter: str
    decimal_point: str
    quoted: bool
    has_rows: bool

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
        text = cells[self.cell_names.index(name)].strip().replace(self.decimal_point, ".")
        try:
            return float(text or "nan")
        except ValueError:
            return None


def open_bytes(path: Path) -> IO[bytes]:
    """Open a table, plain or gzip-compressed by its ending."""
    if path.suffix.lower() == ".gz":
        return cast("IO[bytes]", gzip.open(path, "rb"))
    return path.open("rb")


@contextlib.contextmanager
def create_bytes(path: Path) -> Iterator[IO[bytes]]:
    """Create a table, plain or gzip-compressed by its ending, the same bytes at every time."""
    with path.open("wb") as file:
        if path.suffix.lower() != ".gz":
            yield file
            return
        with gzip.GzipFile("", "wb", fileobj=file, compresslevel=4, mtime=0) as packed:
            yield cast("IO[bytes]", packed)


def read_layout(stream: IO[bytes], path: Path, pixel_size_nm: float | None) -> Layout:
    """Understand the header and leave the stream at the first row.

    Raises
    ------
    TableError
        Frame, x or y is missing or there twice, or a length is in an unknown unit.
    """
    header_line = 0
    header = b"\n"
    while header and not header.strip(b"\xef\xbb\xbf \t\r\n"):
        header = stream.readline(_HEADER_BYTES)
        header_line += 1
    text = _decode(header)
    delimiter = max(",;\t", key=text.count)
    start = stream.tell()
    row = b"\n"
    while row and not row.strip():
        row = stream.readline(_HEADER_BYTES)
    stream.seek(start)
    names, scales = _understand(_cells(text, delimiter), path, pixel_size_nm)
    return Layout(
        cell_names=names,
        scales=scales,
        header_line=header_line,
        delimiter=delimiter,
        decimal_point="," if delimiter != "," and b"," in row else ".",
        quoted=b'"' in row,
        has_rows=bool(row.strip()),
    )


def first_line_where(
    path: Path, layout: Layout, is_wrong: Callable[[list[str]], bool]
) -> int | None:
    """Find the number, from 1, of the first line below the header whose cells are wrong.

    The fast parser counts rows only when it runs on one thread; this looks once, after a fault.
    """
    with open_bytes(path) as stream:
        for number, line in enumerate(stream, start=1):
            text = line.decode("utf-8", errors="replace")
            if number <= layout.header_line or not text.strip():
                continue
            if is_wrong(_cells(text, layout.delimiter, quoted=layout.quoted)):
                return number
    return None


def _understand(
    cells: list[str], path: Path, pixel_size_nm: float | None
) -> tuple[list[str], dict[str, float]]:
    """Give every cell a name and every length a factor; say what is not used."""
    names: list[str] = []
    scales: dict[str, float] = {}
    unknown: list[str] = []
    in_adu: list[str] = []
    for index, cell in enumerate(cells):
        parts = _CELL.match(cell)
        name = parts["name"].lower() if parts else ""
        unit = (parts["unit"] or "").strip() if parts else ""
        column = _LENGTHS.get(name) or _SIGNALS.get(name) or _PLAIN.get(name)
        if column in names:
            raise TableError(f"{path} has two columns for {column}: remove one, such as {cell!r}")
        if name in _SIGNALS and unit.lower() not in ("photon", "photons"):
            in_adu.append(cell)
            column = None
        elif column is None and name not in _IGNORED:
            unknown.append(cell)
        names.append(column or f"cell {index}")
        if column is not None and name in _LENGTHS:
            scales[column] = _nm_per(unit, cell, path, pixel_size_nm)
        elif column is not None and column != "frame":
            scales[column] = 1.0
    missing = [name for name in ("frame", "x_nm", "y_nm") if name not in names]
    if missing:
        wanted = ", ".join(_HEADER_OF[name] for name in missing)
        found = ", ".join(repr(cell[:40]) for cell in cells[:12])
        raise TableError(f"{path} is no ThunderSTORM table: it lacks {wanted}; found {found}")
    _warn_of(unknown, in_adu, path)
    return names, scales


_HEADER_OF = {"frame": "frame", "x_nm": "x [nm]", "y_nm": "y [nm]"}


def _nm_per(unit: str, cell: str, path: Path, pixel_size_nm: float | None) -> float:
    if unit.lower() in _NM_PER_UNIT:
        return _NM_PER_UNIT[unit.lower()]
    if unit.lower() not in ("px", "pixel", "pixels"):
        raise TableError(
            f"{path}: column {cell!r} has {'the unknown unit ' + unit if unit else 'no unit'}; "
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
            f"{path}: the column(s) {', '.join(map(repr, unknown))} were left out, as nothing here "
            "uses them",
            TableWarning,
            stacklevel=6,
        )
    if in_adu:
        warnings.warn(
            f"{path}: the column(s) {', '.join(map(repr, in_adu))} are not in photons and were "
            "left out; export them in photons if they are needed",
            TableWarning,
            stacklevel=6,
        )


def _decode(line: bytes) -> str:
    """Decode a header; older exports write the micro sign in Latin-1."""
    try:
        return line.decode("utf-8-sig").strip()
    except UnicodeDecodeError:
        return line.decode("latin-1").strip()


def _cells(line: str, delimiter: str, *, quoted: bool = True) -> list[str]:
    line = line.rstrip("\r\n")
    if not quoted:
        return line.split(delimiter)
    try:
        cells = next(csv.reader(io.StringIO(line), delimiter=delimiter), [])
    except csv.Error:
        # A NUL byte or an endless cell: no table of numbers, and no line of the right length.
        return [line]
    return [cell.strip().strip("'`").strip() for cell in cells]
