"""The punctuation of a text table, told from its first lines.

The cell delimiter is the one of comma, semicolon and tab that the header has most of. A comma is
the decimal sign where a cell of the first rows reads ``12,5`` and none reads ``12.5``; with commas
between cells that takes quotation marks. Lines may end in LF, CR LF or CR. A first line ``sep=;``,
which spreadsheets understand, tells the delimiter itself.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path

from rotortrack.exchange.csv_stream import open_bytes

_HEAD_BYTES = 1 << 17
"""No header and first rows are longer; more of a binary file is not searched for line ends."""

_DECIMAL = re.compile(r"\s*[-+]?\d*([.,])\d+(?:[eE][-+]?\d+)?\s*")

_SEPARATOR = re.compile(r"sep=([,;\t])")


@dataclass(frozen=True)
class Dialect:
    """How a table is cut.

    Parameters
    ----------
    header
        Cells of the first line that is not blank; none where there is no such line. Where every
        row ends in one more delimiter, there is an empty cell for what it seems to begin.
    header_line
        Its number, from 1.
    delimiter, decimal_point, quoted
        How rows are cut, numbers written, and whether quotation marks occur in them.
    has_rows
        Whether anything follows the header.
    """

    header: list[str]
    header_line: int
    delimiter: str
    decimal_point: str
    quoted: bool
    has_rows: bool


def read_dialect(path: Path) -> Dialect:
    """Look at the beginning of a table."""
    with open_bytes(path) as stream:
        head = stream.read(_HEAD_BYTES).removeprefix(codecs.BOM_UTF8)
    lines = head.splitlines()
    goes_on = len(head) == _HEAD_BYTES and len(lines) > 1
    if goes_on:
        lines.pop()
    texts = [_decode(line) for line in lines]
    filled = [index for index, text in enumerate(texts) if text.strip()]
    told = _SEPARATOR.fullmatch(texts[filled[0]]) if filled else None
    if told:
        filled.pop(0)
    if not filled:
        return Dialect([], 0, ",", ".", False, False)
    header = texts[filled[0]]
    rows = [texts[index] for index in filled[1:]]
    delimiter = told[1] if told else max(",;\t", key=header.count)
    quoted = any('"' in row for row in rows)
    signs: set[str] = set()
    for row in rows:
        if "," in row and (quoted or delimiter != ","):
            numbers = map(_DECIMAL.fullmatch, cells_of(row, delimiter, quoted=quoted))
            signs.update(number[1] for number in numbers if number)
    names = cells_of(header, delimiter)
    if rows and all(row.endswith(delimiter) for row in rows):
        lengths = {len(cells_of(row, delimiter, quoted=quoted)) for row in rows}
        if lengths == {len(names) + 1}:
            names.append("")
    return Dialect(
        header=names,
        header_line=filled[0] + 1,
        delimiter=delimiter,
        decimal_point="," if signs == {","} else ".",
        quoted=quoted,
        has_rows=bool(rows) or goes_on,
    )


def cells_of(line: str, delimiter: str, *, quoted: bool = True) -> list[str]:
    """Cut a line into cells."""
    line = line.rstrip("\r\n")
    if not quoted:
        return line.split(delimiter)
    try:
        cells = next(csv.reader(io.StringIO(line), delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:
        # A NUL byte or an endless cell: no table of numbers, and no line of the right length.
        return [line]
    return [cell.strip().strip("'`").strip() for cell in cells]


def _decode(line: bytes) -> str:
    """Decode a line; older exports write the micro sign in Latin-1."""
    try:
        return line.decode("utf-8").strip(" \r\n\f\v")
    except UnicodeDecodeError:
        return line.decode("latin-1").strip(" \r\n\f\v")
