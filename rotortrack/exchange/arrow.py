"""Between numpy, Arrow and a schema, without loading pandas (as ``pyarrow.array`` would)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rotortrack.errors import TableError
from rotortrack.exchange.writer import check_frames, first_line, listed
from rotortrack.tables import Schema


def arrow_type(dtype: str) -> pa.DataType:
    """Translate a dtype name of a schema."""
    return pa.string() if dtype == "str" else pa.from_numpy_dtype(np.dtype(dtype))


def open_file(path: Path, mode: str = "r") -> pa.OSFile:
    """Open a file of any name; Arrow itself takes only names that are UTF-8.

    Parameters
    ----------
    path
        The file.
    mode
        ``r`` or ``w``.
    """
    return pa.OSFile(os.fsencode(path), mode)


def number_array(values: NDArray[Any]) -> pa.Array:
    """Wrap numbers or truth values as an Arrow array; the memory stays shared where it can."""
    values = np.ascontiguousarray(values)
    values = values.astype(values.dtype.newbyteorder("="), copy=False)
    packed = np.packbits(values, bitorder="little") if values.dtype == bool else values
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(packed)])


def fit(table: pa.Table, schema: Schema, path: Path) -> pa.Table:
    """Cast the schema's columns to its types, exactly: a frame 1.5 or an empty cell is refused.

    Raises
    ------
    TableError
        A required column is missing or a column's values do not fit its type.
    """
    names = table.column_names
    twice = [name for name in schema.names if names.count(name) > 1]
    if twice:
        raise TableError(f"{path} has the column {twice[0]} more than once: remove one")
    missing = [c.name for c in schema.columns if c.required and c.name not in names]
    if missing:
        raise TableError(
            f"{path} lacks the {schema.name} column(s) {', '.join(missing)}: it has {listed(names)}"
        )
    for column in schema.columns:
        if column.name not in table.column_names:
            continue
        index = table.column_names.index(column.name)
        values = table.column(index)
        if values.null_count and column.dtype != "str":
            if not column.dtype.startswith("float"):
                raise TableError(f"{path}: column {column.name} has empty cells")
            values = values.fill_null(float("nan"))
        try:
            values = values.cast(arrow_type(column.dtype))
        except pa.ArrowException as error:
            raise TableError(
                f"{path}: column {column.name} cannot be read as {column.dtype} "
                f"({first_line(error)})"
            ) from error
        if column.name == "frame":
            check_frames(values.to_numpy(), path)
        table = table.set_column(index, column.name, values)
    return table
