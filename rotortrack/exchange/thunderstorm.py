"""ThunderSTORM's CSV tables, written by the plugin's releases up to 1.3 and by its later builds.

The header names quantities and units (``x [nm]``); frames and ids count from 1. Both generations
are read (``uncertainty [nm]``, ``uncertainty_xy [nm]``; ids and frames as ``1.0`` or ``1``), in any
column order, with nothing demanded but frame, x and y; the later one is written.
Layout after the plugin's own files (M. Ovesny et al., Bioinformatics 30, 2389, 2014).
"""

from __future__ import annotations

import contextlib
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
from rotortrack.exchange.csv_layout import (
    Layout,
    create_bytes,
    first_line_where,
    open_bytes,
    read_layout,
)
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


def read_columns(path: Path, *, pixel_size_nm: float | None = None) -> Columns:
    """Read a ThunderSTORM table, plain or gzip-compressed.

    Lengths become nm, frames count from 0. A table whose smallest frame is 0 is not the plugin's
    own and keeps its frames; signals in ADU are left out, as photons would need the camera; both
    are said in a warning, as are unknown columns and rows with a wrong number of cells (which the
    plugin skips, too).

    Parameters
    ----------
    path
        The table; ``.csv`` or ``.csv.gz``.
    pixel_size_nm
        Side of a pixel, demanded only where a length is given in pixels.

    Raises
    ------
    TableError
        The table lacks frame, x or y, a length has no known unit, or a cell is not a number.

    Notes
    -----
    Time and memory grow with the number of rows; 1e6 rows of 10 columns take about a second.
    """
    require_file(path)
    try:
        with open_bytes(path) as stream:
            layout = read_layout(stream, path, pixel_size_nm)
            table = _parse(stream, layout, path)
    except (OSError, EOFError, zlib.error, UnicodeDecodeError, pa.ArrowException) as error:
        raise TableError(
            f"{path} cannot be read as a CSV table ({first_line(error)}): export it again"
        ) from error
    columns: dict[str, NDArray[Any]] = {}
    for name, scale in layout.scales.items():
        values = table.column(name).to_numpy()
        columns[name] = to_dtype(values if scale == 1 else values * scale, _DTYPES[name])
    columns["frame"] = _frames_from_zero(table.column("frame").to_numpy(), layout, path)
    return {name: columns[name] for name in _DTYPES if name in columns}


def _parse(stream: IO[bytes], layout: Layout, path: Path) -> pa.Table:
    """Parse the rows below the header with Arrow's threads."""
    wrong_counts: list[int] = []

    def skip(row: Any) -> str:
        if row.text.strip():
            wrong_counts.append(row.actual_columns)
        return "skip"

    if not layout.has_rows:
        return pa.table({name: pa.array([], pa.float64()) for name in layout.wanted})
    try:
        table = pacsv.read_csv(
            stream,
            read_options=pacsv.ReadOptions(column_names=layout.cell_names),
            parse_options=pacsv.ParseOptions(
                delimiter=layout.delimiter,
                quote_char='"' if layout.quoted else False,
                invalid_row_handler=skip,
            ),
            convert_options=pacsv.ConvertOptions(
                column_types=dict.fromkeys(layout.wanted, pa.float64()),
                include_columns=layout.wanted,
                decimal_point=layout.decimal_point,
            ),
        )
    except pa.ArrowInvalid as error:
        line = first_line_where(path, layout, layout.is_not_numeric)
        where = f" in line {line}" if line else f" ({first_line(error)})"
        raise TableError(
            f"{path}: a cell{where} is not a number; correct or remove that row"
        ) from error
    if wrong_counts:
        line = first_line_where(path, layout, layout.is_wrong_length)
        sentence = (
            f"{len(wrong_counts)} row(s) of {path} have another number of cells than the header's "
            f"{len(layout.cell_names)}, the first in line {line}"
        )
        if not table.num_rows:
            raise TableError(f"{sentence}: no row can be read; export the table again")
        warnings.warn(f"{sentence}; they were skipped", TableWarning, stacklevel=5)
    return table


def _frames_from_zero(values: NDArray[Any], layout: Layout, path: Path) -> NDArray[np.int64]:
    """Turn the plugin's frames, 1, 2, ... or 1.0, 2.0, ..., into ours, 0, 1, ..."""
    whole = np.isfinite(values) & (np.rint(values) == values) & (np.abs(values) < 2.0**53)
    if not whole.all():
        line = first_line_where(path, layout, layout.has_no_whole_frame)
        raise TableError(f"{path}: the frame in line {line} is not a whole number")
    frame = values.astype(np.int64)
    check_frames(frame, path)
    if frame.size and frame.min() == 0:
        warnings.warn(
            f"{path} has a frame 0, so another program than ThunderSTORM, which counts from 1, "
            "wrote it: its frame numbers are kept",
            TableWarning,
            stacklevel=4,
        )
        return frame
    return frame - 1


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
