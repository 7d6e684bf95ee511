"""Plain CSV of any of our tables, such as rotors.csv and drift.csv, safe to open in a spreadsheet.

A text cell that a spreadsheet would take for a formula gets an apostrophe in front, which
spreadsheets hide and :func:`read_csv` takes away again.
"""

from __future__ import annotations

import csv
import io
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.csv as pacsv

from rotortrack.errors import TableError
from rotortrack.exchange.arrow import arrow_type, fit
from rotortrack.exchange.csv_dialect import read_dialect
from rotortrack.exchange.csv_stream import open_bytes
from rotortrack.exchange.writer import first_line, require_file
from rotortrack.files import atomic_path
from rotortrack.tables import Schema, conform

if TYPE_CHECKING:
    import pandas as pd

_DAMAGE = (OSError, EOFError, zlib.error, UnicodeDecodeError, pa.ArrowException)

_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "'")
"""The apostrophe itself is among them so that reading undoes writing exactly."""


def write_csv(path: Path, table: pd.DataFrame) -> None:
    """Write a table atomically: shortest exact numbers, empty cells for missing ones, UTF-8.

    Raises
    ------
    TableError
        A column holds values that have no place in a cell.
    ResourceError
        The disk is full or the folder cannot be written.
    """
    columns = {str(name): _cells(table[name], path) for name in table.columns}
    header = io.StringIO()
    csv.writer(header, lineterminator="\n").writerow([_guarded(name) for name in columns])
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write(header.getvalue().encode("utf-8"))
        if columns:
            pacsv.write_csv(pa.table(columns), stream, pacsv.WriteOptions(include_header=False))


def read_csv(path: Path, schema: Schema) -> pd.DataFrame:
    """Read a table that :func:`write_csv`, or a spreadsheet with the same column names, wrote.

    Raises
    ------
    TableError
        The file is no CSV, lacks required columns, or holds values of the wrong kind.
    """
    require_file(path)
    texts = [column.name for column in schema.columns if column.dtype == "str"]
    # Whole numbers are parsed as floats, since spreadsheets write 1.0, and must then be whole.
    types = {
        column.name: arrow_type("float64" if column.dtype.startswith("int") else column.dtype)
        for column in schema.columns
    }
    try:
        dialect = read_dialect(path)
        if not dialect.header:
            raise TableError(f"{path} cannot be read as a CSV table of {schema.name}: it is empty")
        with open_bytes(path) as stream:
            table = pacsv.read_csv(
                stream,
                read_options=pacsv.ReadOptions(skip_rows=dialect.header_line - 1),
                parse_options=pacsv.ParseOptions(
                    delimiter=dialect.delimiter, newlines_in_values=True
                ),
                convert_options=pacsv.ConvertOptions(
                    column_types=types, decimal_point=dialect.decimal_point
                ),
            )
        frame = fit(table, schema, path).to_pandas(ignore_metadata=True)
    except _DAMAGE as error:
        raise TableError(
            f"{path} cannot be read as a CSV table of {schema.name} ({first_line(error)})"
        ) from error
    for name in texts:
        if name in frame.columns:
            frame[name] = [cell[1:] if cell.startswith("'") else cell for cell in frame[name]]
    return conform(frame, schema, str(path))


def _cells(values: pd.Series, path: Path) -> pa.Array:
    array = values.to_numpy()
    try:
        if array.dtype.kind in "biuf":
            return pa.array(array, from_pandas=True)
        return pa.array([None if _is_missing(cell) else _guarded(str(cell)) for cell in array])
    except (pa.ArrowException, TypeError) as error:
        raise TableError(
            f"{path}: column {values.name} cannot be written ({first_line(error)})"
        ) from error


def _is_missing(cell: object) -> bool:
    return cell is None or cell != cell


def _guarded(text: str) -> str:
    return f"'{text}" if text.startswith(_FORMULA_STARTS) else text
