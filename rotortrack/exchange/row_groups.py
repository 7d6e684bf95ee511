"""Row groups of a Parquet file, gathered from blocks of any size and written as they fill."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rotortrack.errors import TableError
from rotortrack.exchange.arrow import arrow_type, number_array, open_file
from rotortrack.exchange.writer import BLOCK_ROWS, Columns, SameColumns, first_line
from rotortrack.files import atomic_path
from rotortrack.tables import Schema

METADATA_KEY = b"rotortrack"
"""The one key of the schema metadata under which our JSON lies."""


class RowGroupWriter:
    """Gathers blocks into row groups; the first block settles the columns of the file."""

    def __init__(
        self, temporary: Path, path: Path, schema: Schema, metadata: Mapping[str, object]
    ) -> None:
        self._temporary = temporary
        self._path = path
        self._schema = schema
        self._same = SameColumns(path, schema)
        self._metadata = {METADATA_KEY: json.dumps(metadata, default=_json_value)}
        self._target: pa.OSFile | None = None
        self._file: pq.ParquetWriter | None = None
        self._pending: list[pa.Table] = []
        self._rows = 0

    @property
    def is_empty(self) -> bool:
        """Whether no block has come yet."""
        return self._file is None

    def append(self, columns: Columns) -> None:
        """Add the rows of one block; write the row groups that are full."""
        self._same.check(columns)
        names = [name for name in self._schema.dtypes if name in columns]
        names += [name for name in columns if name not in self._schema.dtypes]
        table = pa.table({name: self._array(name, columns[name]) for name in names})
        if self._file is None:
            self._target = open_file(self._temporary, "w")
            self._file = _create(self._target, table.schema.with_metadata(self._metadata))
        # Only a cast loads pyarrow's compute functions.
        alike = table.schema.equals(self._file.schema)
        self._pending.append(table if alike else table.cast(self._file.schema))
        self._rows += table.num_rows
        while self._rows >= BLOCK_ROWS:
            self._write(BLOCK_ROWS)

    def close(self) -> None:
        """Write what still waits, and the footer."""
        if self._rows:
            self._write(self._rows)
        self.abandon()

    def abandon(self) -> None:
        """Let go of the file as it is."""
        try:
            if self._file is not None:
                self._file.close()
        finally:
            if self._target is not None:
                self._target.close()

    def _write(self, rows: int) -> None:
        gathered = pa.concat_tables(self._pending)
        rest = gathered.slice(rows)
        self._pending = [rest] if rest.num_rows else []
        self._rows = rest.num_rows
        assert self._file is not None
        self._file.write_table(gathered.slice(0, rows), row_group_size=BLOCK_ROWS)

    def _array(self, name: str, values: Any) -> pa.Array:
        dtype = self._schema.dtypes.get(name)
        # NaN is a number that a fit may give; only text can be absent. The copy is the writer's
        # own: a caller may reuse its block while rows still wait for their row group.
        text = values.dtype.kind not in "biuf"
        try:
            if text:
                return pa.array(values, arrow_type(dtype) if dtype else None, from_pandas=True)
            with np.errstate(over="ignore"):
                return number_array(np.array(values, dtype=None if dtype == "str" else dtype))
        except (pa.ArrowException, ValueError, TypeError) as error:
            raise TableError(
                f"{self._path}: column {name} cannot be stored ({first_line(error)})"
            ) from error


@contextlib.contextmanager
def open_row_groups(
    path: Path, schema: Schema, metadata: Mapping[str, object]
) -> Iterator[RowGroupWriter]:
    """Give a writer for a table of any schema; the file appears when the block succeeds."""
    with atomic_path(path) as temporary:
        writer = RowGroupWriter(temporary, path, schema, metadata)
        try:
            yield writer
            writer.close()
        except BaseException:
            with contextlib.suppress(OSError, pa.ArrowException):
                writer.abandon()
            raise


def _create(target: pa.OSFile, schema: pa.Schema) -> pq.ParquetWriter:
    encodings = {}
    for column in schema:
        if pa.types.is_floating(column.type):
            encodings[column.name] = "BYTE_STREAM_SPLIT"
        elif pa.types.is_integer(column.type):
            encodings[column.name] = "DELTA_BINARY_PACKED"
    return pq.ParquetWriter(
        target,
        schema,
        compression="zstd",
        use_dictionary=False,
        column_encoding=encodings,
        write_page_checksum=True,
    )


def _json_value(value: object) -> object:
    """Give numpy's scalars as numbers and anything else (a path, an enumeration) as text."""
    return value.item() if isinstance(value, np.generic) else str(value)
