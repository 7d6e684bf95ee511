"""Parquet, the native form of every table: zstd, byte-stream split, units and provenance inside.

The bytes of a float column are stored plane by plane, so that the slowly varying exponents lie
together and compress; every page carries a checksum that is verified on reading. Nothing here
imports pandas except the functions that return a DataFrame.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

from rotortrack.errors import TableError
from rotortrack.exchange.arrow import fit, open_file
from rotortrack.exchange.limits import check_fits_memory, check_holds_rows
from rotortrack.exchange.row_groups import METADATA_KEY, open_row_groups
from rotortrack.exchange.writer import (
    BLOCK_ROWS,
    Columns,
    LocalisationWriter,
    TableInfo,
    empty_columns,
    first_line,
    positive_count,
    positive_number,
    require_file,
    slices,
)
from rotortrack.tables import LOCALISATIONS, Schema, conform, schema_metadata

if TYPE_CHECKING:
    import pandas as pd

_MOVIE = ("pixel_size_nm", "frame_interval_s", "frames", "height_px", "width_px")

_CELL_BYTES = 8

_DAMAGE = (
    pa.ArrowException,
    OSError,
    ValueError,
    TypeError,
    KeyError,
    OverflowError,
    MemoryError,
    RecursionError,
)
"""What pyarrow and json raise for bytes that are not a whole Parquet file of ours; MemoryError
comes from the absurd sizes that a damaged header declares."""


def read_table(path: Path, schema: Schema) -> pd.DataFrame:
    """Read a table of any schema from our Parquet or from another program's.

    Parameters
    ----------
    path
        The file.
    schema
        Which columns must be there and how they are typed; unknown plain columns are kept, last.

    Raises
    ------
    TableError
        The file is not whole Parquet, lacks required columns, or holds values of the wrong kind.
    ResourceError
        The memory of this computer cannot hold the table.
    """
    with _open(path) as file:
        names = _plain_columns(file.schema_arrow)
        metadata = file.metadata
        groups = map(metadata.row_group, range(metadata.num_row_groups))
        declared_bytes = sum(group.total_byte_size for group in groups)
        held_bytes = metadata.num_rows * len(names) * _CELL_BYTES
        check_fits_memory(path, metadata.num_rows, max(held_bytes, declared_bytes))
        table = fit(file.read(names), schema, path)
    return conform(table.to_pandas(ignore_metadata=True), schema, str(path))


def write_table(
    path: Path, table: pd.DataFrame, schema: Schema, provenance: Mapping[str, object]
) -> None:
    """Write a table of any schema atomically, in the schema's column order.

    Raises
    ------
    TableError
        Required columns are missing or a column cannot be stored.
    ResourceError
        The disk is full or the folder cannot be written.
    """
    table = conform(table, schema, f"the table for {path}")
    columns = {str(name): table[name].to_numpy() for name in table.columns}
    with open_row_groups(path, schema, schema_metadata(schema, provenance)) as writer:
        # Text of an unknown column shows its type only in the table as a whole.
        for block in slices(columns) if columns.keys() <= schema.dtypes.keys() else [columns]:
            writer.append(block)


@contextlib.contextmanager
def open_writer(path: Path, info: TableInfo) -> Iterator[LocalisationWriter]:
    """Give a writer of localisations; the file appears under its name when the block succeeds.

    Small blocks are gathered into row groups of 131,072 rows, so that the file is as quick to read
    whatever the size of the blocks; memory holds one row group.
    """
    metadata = schema_metadata(LOCALISATIONS, info.provenance)
    metadata["movie"] = {name: getattr(info, name) for name in _MOVIE}
    with open_row_groups(path, LOCALISATIONS, metadata) as writer:
        yield writer
        if writer.is_empty:
            writer.append(empty_columns())


def read_blocks(path: Path) -> Iterator[Columns]:
    """Yield the localisations block by block; an empty table yields one empty block."""
    with _open(path) as file:
        names = [name for name in _plain_columns(file.schema_arrow) if name in LOCALISATIONS.dtypes]
        empty = True
        for batch in file.iter_batches(batch_size=BLOCK_ROWS, columns=names):
            empty = False
            yield _to_columns(fit(pa.Table.from_batches([batch]), LOCALISATIONS, path))
        if empty:
            schema = pa.schema([file.schema_arrow.field(name) for name in names])
            yield _to_columns(fit(schema.empty_table(), LOCALISATIONS, path))


def read_info(path: Path) -> TableInfo:
    """Read what our Parquet records beside its rows; all unknown for another program's file."""
    metadata = read_metadata(path)
    movie = metadata.get("movie")
    provenance = metadata.get("provenance")
    movie = movie if isinstance(movie, dict) else {}
    return TableInfo(
        pixel_size_nm=positive_number(movie.get("pixel_size_nm")),
        frame_interval_s=positive_number(movie.get("frame_interval_s")),
        frames=positive_count(movie.get("frames")),
        height_px=positive_count(movie.get("height_px")),
        width_px=positive_count(movie.get("width_px")),
        provenance=provenance if isinstance(provenance, dict) else {},
    )


def read_metadata(path: Path) -> dict[str, Any]:
    """Read our JSON from the schema metadata: table, units, provenance; empty when absent."""
    with _open(path) as file:
        text = (file.schema_arrow.metadata or {}).get(METADATA_KEY, b"{}")
        metadata = json.loads(text)
    if not isinstance(metadata, dict):
        raise TableError(f"{path}: its rotortrack metadata is not a JSON object")
    return metadata


@contextlib.contextmanager
def _open(path: Path) -> Iterator[pq.ParquetFile]:
    """Open a Parquet file and turn whatever a damaged one raises into one sentence."""
    require_file(path)
    try:
        with (
            open_file(path) as source,
            pq.ParquetFile(source, page_checksum_verification=True) as file,
        ):
            check_holds_rows(path, file.metadata.num_rows)
            yield file
    except _DAMAGE as error:
        raise TableError(
            f"{path} cannot be read as Parquet ({first_line(error)}): it is damaged, cut short or "
            "another kind of file; export it again"
        ) from error


def _plain_columns(schema: pa.Schema) -> list[str]:
    """Columns that a flat table can hold: numbers, truth values and text."""
    types = pa.types
    plain = (types.is_integer, types.is_floating, types.is_boolean, types.is_string)
    texts = (types.is_large_string, types.is_dictionary)
    return [column.name for column in schema if any(test(column.type) for test in (*plain, *texts))]


def _to_columns(table: pa.Table) -> Columns:
    return {
        column.name: table.column(column.name).to_numpy()
        for column in LOCALISATIONS.columns
        if column.name in table.column_names
    }


def count_rows(path: Path) -> int:
    """Count the rows of a Parquet file without reading them."""
    with _open(path) as file:
        return int(file.metadata.num_rows)
