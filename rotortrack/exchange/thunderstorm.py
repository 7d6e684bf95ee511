"""ThunderSTORM's CSV tables, written by the plugin's releases up to 1.3 and by its later builds.

The header names quantities and units (``x [nm]``); frames and ids count from 1. Both generations
are read (``uncertainty [nm]``, ``uncertainty_xy [nm]``; ids and frames as ``1.0`` or ``1``), in any
column order, with nothing demanded but frame, x and y; the later one is written.
Layout after the plugin's own files (M. Ovesny et al., Bioinformatics 30, 2389, 2014).
"""

from __future__ import annotations

import contextlib
import re
import sys
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv
from numpy.typing import NDArray

from rotortrack.errors import TableError, TableWarning
from rotortrack.exchange.arrow import number_array
from rotortrack.exchange.csv_layout import Layout, first_line_where, read_layout
from rotortrack.exchange.csv_stream import create_bytes, open_bytes
from rotortrack.exchange.writer import (
    Columns,
    LocalisationWriter,
    SameColumns,
    check_frames,
    empty_columns,
    first_line,
    require_file,
    to_dtype,
)
from rotortrack.files import atomic_path
from rotortrack.tables import LOCALISATIONS

_DTYPES = LOCALISATIONS.dtypes

_DAMAGE = (OSError, EOFError, zlib.error, UnicodeDecodeError, pa.ArrowException)

_BLOCK_BYTES = 2 << 20
"""What is parsed at once, about 25,000 rows of ten columns; Arrow reads several blocks ahead."""

_PATIENCE_ROWS = 100_000
"""After so many rows that cannot be read, and fewer that can, the rest is not looked at."""

_UNREADABLE_ROW = "CSV parse error"
"""Arrow's words for a row of a wrong length that it cannot hand on, as it is not UTF-8."""

_BAD_CELL = re.compile("invalid value '(.*)'")
_COMMA = re.compile(r"\s*[-+]?[\d.]{0,30},\d{1,30}\s*")

WRITTEN = {
    "x_nm": "x [nm]",
    "y_nm": "y [nm]",
    "sigma_nm": "sigma [nm]",
    "photons": "intensity [photon]",
    "background": "offset [photon]",
    "background_sd": "bkgstd [photon]",
    "chi2": "chi2",
    "uncertainty_nm": "uncertainty_xy [nm]",
}
"""Our columns under the plugin's names, in the plugin's order, after id and frame."""


def read_blocks(path: Path, *, pixel_size_nm: float | None = None) -> Iterator[Columns]:
    """Yield the rows of a ThunderSTORM table block by block, at least one block.

    Lengths become nm, frames count from 0. A table whose smallest frame is 0 is not the plugin's
    own and keeps its frames; signals in ADU are left out, as photons would need the camera; both
    are said in a warning, as are unknown columns and rows with a wrong number of cells (which the
    plugin skips, too).

    Parameters
    ----------
    path
        The table; ``.csv`` or ``.csv.gz``, in any dialect that :mod:`csv_dialect` tells.
    pixel_size_nm
        Side of a pixel, demanded only where a length is given in pixels.

    Raises
    ------
    TableError
        The table lacks frame, x or y, a length has no known unit, a cell is not a number, or most
        rows have a wrong number of cells.

    Notes
    -----
    The file is read twice, as its smallest frame tells whether it counts from 1: half a second and
    a second per million rows of 10 columns. Memory holds a few blocks.
    """
    require_file(path)
    try:
        layout = read_layout(path, pixel_size_nm)
        rows, first = _survey(path, layout)
        for batch in _batches(path, layout, layout.wanted, _WrongRows(rows)):
            yield _to_columns(batch, layout, first)
        if not rows:
            nothing = [pa.array([], pa.float64())] * len(layout.wanted)
            yield _to_columns(pa.RecordBatch.from_arrays(nothing, layout.wanted), layout, first)
    except _DAMAGE as error:
        raise TableError(
            f"{path} cannot be read as a CSV table ({first_line(error)}): export it again"
        ) from error


def _survey(path: Path, layout: Layout) -> tuple[int, int]:
    """Check all frames; count the rows that can be read, and give the number of the first frame."""
    wrong = _WrongRows()
    smallest = np.inf
    for batch in _batches(path, layout, ["frame"], wrong):
        values = batch.column(0).to_numpy(zero_copy_only=False)
        whole = np.isfinite(values) & (np.rint(values) == values) & (np.abs(values) < 2.0**53)
        if not whole.all():
            line = first_line_where(path, layout, layout.has_no_whole_frame)
            raise TableError(f"{path}: the frame in line {line} is not a whole number")
        wrong.read += len(values)
        smallest = min(smallest, values.min(initial=np.inf))
    wrong.report(path, layout)
    if not wrong.read:
        return 0, 1
    check_frames(np.array([smallest], np.int64), path)
    if smallest == 0:
        warnings.warn(
            f"{path} has a frame 0, so another program than ThunderSTORM, which counts from 1, "
            "wrote it: its frame numbers are kept",
            TableWarning,
            stacklevel=4,
        )
    return wrong.read, min(int(smallest), 1)


class _WrongRows:
    """Skips and counts the rows that have another number of cells than the header.

    Parameters
    ----------
    read
        Rows that were read so far.
    """

    def __init__(self, read: int = 0) -> None:
        self.read = read
        self.has_stopped = False
        self._skipped = 0
        self._is_open = False

    def __call__(self, row: Any) -> str:
        text = row.text
        self._skipped += bool(text.strip())
        # A quotation mark that is never closed swallows the rows that follow.
        self._is_open = self._is_open or "\n" in text or "\r" in text
        hopeless = self._skipped > _PATIENCE_ROWS and self._skipped > self.read
        self.has_stopped = self._is_open or hopeless
        return "error" if self.has_stopped else "skip"

    def report(self, path: Path, layout: Layout) -> None:
        """Warn of the rows that were skipped; refuse where they are most."""
        if not self._skipped:
            return
        line = first_line_where(path, layout, layout.is_wrong_length)
        if self._is_open:
            raise TableError(
                f"{path}: a quotation mark in line {line} is never closed; correct that row"
            )
        sentence = (
            f"{self._skipped} row(s) of {path} have another number of cells than the header's "
            f"{len(layout.cell_names)}, the first in line {line}"
        )
        if self._skipped > self.read:
            raise TableError(
                f"{sentence}, and only {self.read} can be read: export the table again (with "
                "decimal commas, between semicolons or in quotation marks)"
            )
        warnings.warn(f"{sentence}; they were skipped", TableWarning, stacklevel=5)


@contextlib.contextmanager
def _without_complaints(wrong: _WrongRows) -> Iterator[None]:
    """Keep Arrow from printing that it could not decode the text of a wrong row.

    It does so where no exception can be raised, before it says the same as an error.
    """
    before = sys.unraisablehook

    def hook(what: Any) -> None:
        if what.object is not wrong:
            before(what)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before


def _batches(
    path: Path, layout: Layout, names: list[str], wrong: _WrongRows
) -> Iterator[pa.RecordBatch]:
    """Parse some columns of the rows below the header, a few megabytes at once."""
    dialect = layout.dialect
    if not dialect.has_rows:
        return
    try:
        with (
            _without_complaints(wrong),
            open_bytes(path) as stream,
            pacsv.open_csv(
                stream,
                read_options=pacsv.ReadOptions(
                    column_names=layout.cell_names,
                    skip_rows=dialect.header_line,
                    block_size=_BLOCK_BYTES,
                ),
                parse_options=pacsv.ParseOptions(
                    delimiter=dialect.delimiter,
                    quote_char='"' if dialect.quoted else False,
                    invalid_row_handler=wrong,
                ),
                convert_options=pacsv.ConvertOptions(
                    column_types=dict.fromkeys(names, pa.float64()),
                    include_columns=names,
                    decimal_point=dialect.decimal_point,
                ),
            ) as reader,
        ):
            yield from reader
    except pa.ArrowInvalid as error:
        if wrong.has_stopped:
            wrong.report(path, layout)
        if _UNREADABLE_ROW in str(error):
            line = first_line_where(path, layout, layout.is_wrong_length)
            raise TableError(
                f"{path}: line {line} has another number of cells than the header and is not UTF-8 "
                "text: correct or remove it"
            ) from error
        cell = _BAD_CELL.search(str(error))
        part = cell[1] if cell else ""
        line = first_line_where(path, layout, layout.is_not_numeric, part=part)
        where = f" in line {line}" if line else f" ({first_line(error)})"
        remedy = "; correct or remove that row"
        if _COMMA.fullmatch(part):
            remedy = f" ({part}: is it a decimal comma?); export the table with decimal points"
        raise TableError(f"{path}: a cell{where} is not a number{remedy}") from error


def _to_columns(batch: pa.RecordBatch, layout: Layout, first: int) -> Columns:
    """Give a batch our units, types and order of columns."""
    columns: dict[str, NDArray[Any]] = {}
    for name in layout.wanted:
        values = batch.column(name).to_numpy(zero_copy_only=False)
        if name == "frame":
            columns[name] = values.astype(np.int64) - first
        else:
            scale = layout.scales[name]
            columns[name] = to_dtype(values if scale == 1 else values * scale, _DTYPES[name])
    return {name: columns[name] for name in _DTYPES if name in columns}


@contextlib.contextmanager
def open_writer(path: Path) -> Iterator[LocalisationWriter]:
    """Give a writer of a table that ThunderSTORM can import; atomic, memory of one block.

    Numbers have as many digits as it takes to read the same float32 or float64 back. Columns that
    the plugin does not know (flags, standard deviations of x and y, channel, rotor) are left out.
    """
    with atomic_path(path) as temporary, create_bytes(temporary) as stream:
        writer = _Writer(path, stream)
        yield writer
        if writer.is_empty:
            writer.append(empty_columns())


class _Writer:
    def __init__(self, path: Path, stream: IO[bytes]) -> None:
        self._stream = stream
        self._same = SameColumns(path)
        self._rows = 0
        self.is_empty = True

    def append(self, columns: Columns) -> None:
        rows = self._same.check(columns)
        names = [name for name in WRITTEN if name in columns]
        if self.is_empty:
            header = ["id", "frame", *(WRITTEN[name] for name in names)]
            self._stream.write((",".join(f'"{cell}"' for cell in header) + "\n").encode())
            self.is_empty = False
        table = {
            "id": number_array(np.arange(self._rows + 1, self._rows + rows + 1)),
            "frame": number_array(columns["frame"].astype(np.int64) + 1),
        }
        for name in names:
            table[name] = _java_numbers(to_dtype(columns[name], _DTYPES[name]))
        self._rows += rows
        pacsv.write_csv(
            pa.table(table),
            self._stream,
            pacsv.WriteOptions(include_header=False, quoting_style="none"),
        )


def _java_numbers(values: NDArray[Any]) -> pa.Array:
    """Spell what is not finite as Java reads it; Arrow's digits are the shortest already."""
    array = number_array(values)
    if np.isfinite(values).all():
        return array
    text = pc.replace_substring(array.cast(pa.string()), "nan", "NaN")
    return pc.replace_substring(text, "inf", "Infinity")
