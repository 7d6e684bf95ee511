"""Localisations of any format, chosen by the file's ending.

``.parquet`` is ours, ``.csv`` (also ``.csv.gz``) ThunderSTORM's, ``.hdf5`` and ``.h5`` Picasso's.
Formats are loaded when they are used; no writer imports pandas.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from rotortrack.errors import TableError
from rotortrack.exchange.limits import check_fits_memory
from rotortrack.exchange.writer import (
    Columns,
    LocalisationWriter,
    TableInfo,
    require_file,
    slices,
)
from rotortrack.tables import LOCALISATIONS, conform

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Columns",
    "LocalisationWriter",
    "TableInfo",
    "convert",
    "open_writer",
    "read_blocks",
    "read_info",
    "read_localisations",
    "write_localisations",
]


def read_localisations(path: Path, *, pixel_size_nm: float | None = None) -> pd.DataFrame:
    """Read a table of localisations in our units and conventions.

    Parameters
    ----------
    path
        The file; its ending tells the format.
    pixel_size_nm
        Side of a pixel, demanded only where the file counts in pixels and does not say it.

    Raises
    ------
    TableError
        The ending is unknown, the file is damaged, columns are missing, or a length is in pixels
        of unknown size.
    ConfigurationError
        The format needs an optional package that is not installed.
    ResourceError
        The memory of this computer cannot hold the table.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import pandas as pd
    >>> import rotortrack as rt
    >>> spots = pd.DataFrame({"frame": [0, 1], "x_nm": [10.0, 12.0], "y_nm": [5.0, 5.0]})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "spots.parquet"
    ...     rt.write_localisations(path, spots, rt.TableInfo())
    ...     rt.read_localisations(path)["frame"].tolist()
    [0, 1]
    """
    import pandas as pd

    if _format(path) == "parquet":
        from rotortrack.exchange import parquet

        return parquet.read_table(path, LOCALISATIONS)
    blocks = []
    rows = size_bytes = 0
    for block in read_blocks(path, pixel_size_nm=pixel_size_nm):
        blocks.append(block)
        rows += len(block["frame"])
        size_bytes += sum(values.nbytes for values in block.values())
        check_fits_memory(path, rows, size_bytes)
    columns = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    return conform(pd.DataFrame(columns), LOCALISATIONS, str(path))


def read_blocks(path: Path, *, pixel_size_nm: float | None = None) -> Iterator[Columns]:
    """Yield the known columns of a table block by block, at least one block.

    Memory does not grow with the rows.
    """
    match _format(path):
        case "parquet":
            from rotortrack.exchange import parquet

            yield from parquet.read_blocks(path)
        case "picasso":
            from rotortrack.exchange import picasso

            yield from picasso.read_blocks(path, pixel_size_nm=pixel_size_nm)
        case "thunderstorm":
            from rotortrack.exchange import thunderstorm

            yield from thunderstorm.read_blocks(path, pixel_size_nm=pixel_size_nm)


def open_writer(path: Path, info: TableInfo) -> AbstractContextManager[LocalisationWriter]:
    """Give a writer of localisations as a context manager.

    The file appears under its name when the ``with`` block ends without an error, else nothing
    does; without any block it holds no rows but all columns. Memory does not grow with the rows.

    Raises
    ------
    TableError
        The ending is unknown.
    ConfigurationError
        Picasso's format: the pixel size is unknown or an optional package is missing.
    """
    match _format(path):
        case "parquet":
            from rotortrack.exchange import parquet

            return parquet.open_writer(path, info)
        case "picasso":
            from rotortrack.exchange import picasso

            return picasso.open_writer(path, info)
        case "thunderstorm":
            from rotortrack.exchange import thunderstorm

            return thunderstorm.open_writer(path)


def write_localisations(path: Path, table: pd.DataFrame, info: TableInfo) -> None:
    """Write a table of localisations atomically in the format of the ending.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import pandas as pd
    >>> import rotortrack as rt
    >>> spots = pd.DataFrame({"frame": [0, 1], "x_nm": [10.0, 12.0], "y_nm": [5.0, 5.0]})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "spots.csv"
    ...     rt.write_localisations(path, spots, rt.TableInfo(pixel_size_nm=108.3))
    ...     rt.read_localisations(path)["x_nm"].tolist()
    [10.0, 12.0]
    """
    table = conform(table, LOCALISATIONS, f"the table for {path}")
    columns = {str(name): table[name].to_numpy() for name in table.columns}
    with open_writer(path, info) as writer:
        for block in slices(columns):
            writer.append(block)


def read_info(path: Path) -> TableInfo:
    """Read what the file records beside its rows; ``None`` where it does not say."""
    require_file(path)
    match _format(path):
        case "parquet":
            from rotortrack.exchange import parquet

            return parquet.read_info(path)
        case "picasso":
            from rotortrack.exchange import picasso

            return picasso.read_info(path)
        case "thunderstorm":
            return TableInfo()


def convert(source: Path, target: Path, *, pixel_size_nm: float | None = None) -> int:
    """Write a table in the format of another ending, keeping order, units and particulars.

    Parameters
    ----------
    source, target
        Files; their endings tell the formats. Columns unknown to the target's format are lost.
    pixel_size_nm
        Side of a pixel where one of the formats counts in pixels; wins over what `source` records.

    Returns
    -------
    int
        Number of rows.

    Notes
    -----
    The table passes block by block, whatever its size.
    """
    info = read_info(source)
    info = dataclasses.replace(
        info,
        pixel_size_nm=pixel_size_nm if pixel_size_nm is not None else info.pixel_size_nm,
        provenance={**info.provenance, "converted_from": source.name},
    )
    rows = 0
    with open_writer(target, info) as writer:
        for columns in read_blocks(source, pixel_size_nm=pixel_size_nm):
            for block in slices(columns):
                writer.append(block)
                rows += len(block["frame"])
    return rows


def _format(path: Path) -> Literal["parquet", "thunderstorm", "picasso"]:
    name = path.name.lower()
    if name.endswith(".parquet"):
        return "parquet"
    if name.endswith((".csv", ".csv.gz")):
        return "thunderstorm"
    if name.endswith((".hdf5", ".h5")):
        return "picasso"
    raise TableError(
        f"{path} has no known ending: a table is .parquet, .csv or .csv.gz (ThunderSTORM), "
        ".hdf5 or .h5 (Picasso)"
    )
