"""What every table format shares: a file's particulars, blocks of columns and the writer's face."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import TableError
from rotortrack.tables import LOCALISATIONS, Schema

Columns = Mapping[str, NDArray[Any]]
"""Arrays of one length under the column names of a schema."""

BLOCK_ROWS = 131_072
"""Rows handled at once: about 10 MB of localisations, and one row group of a Parquet file."""

_LONGEST_CAUSE = 200

BASE_COLUMNS = tuple(column for column in LOCALISATIONS.columns if column.name != "rotor")
"""Columns of a file to which no block was ever given: those of spots before clustering."""


@dataclass(frozen=True)
class TableInfo:
    """What a file of localisations records beside its rows; ``None`` where unknown.

    Parameters
    ----------
    pixel_size_nm
        Side of a camera pixel in the sample (nm).
    frames, height_px, width_px
        Extent of the movie that the table came from.
    frame_interval_s
        Time between the starts of two frames (s).
    provenance
        How the table was made; written as JSON.

    Examples
    --------
    >>> import rotortrack as rt
    >>> rt.TableInfo(pixel_size_nm=108.3, frames=2000).frames
    2000
    """

    pixel_size_nm: float | None = None
    frames: int | None = None
    height_px: int | None = None
    width_px: int | None = None
    frame_interval_s: float | None = None
    provenance: Mapping[str, object] = field(default_factory=dict)


class LocalisationWriter(Protocol):
    """Takes blocks of localisations in order; memory does not grow with their number."""

    def append(self, columns: Columns) -> None:
        """Add the rows of one block, which has the columns of the first block."""


class SameColumns:
    """Makes sure that every appended block fits the first one.

    Raises
    ------
    TableError
        A block's columns differ from the first block's, or its arrays differ in length.
    """

    def __init__(self, path: Path, schema: Schema = LOCALISATIONS) -> None:
        self._path = path
        self._schema = schema
        self._names: list[str] | None = None

    def check(self, columns: Columns) -> int:
        """Return the number of rows of a block that fits."""
        names = list(columns)
        lengths = {len(values) for values in columns.values()}
        if len(lengths) > 1:
            raise TableError(f"{self._path}: the columns of a block differ in length: {lengths}")
        if self._names is None:
            required = [c.name for c in self._schema.columns if c.required]
            missing = [name for name in required if name not in columns]
            if missing:
                raise TableError(
                    f"{self._path} cannot be written: the {self._schema.name} lack "
                    f"{', '.join(missing)}"
                )
            self._names = names
        if sorted(names) != sorted(self._names):
            raise TableError(
                f"{self._path}: a block has the columns {', '.join(names)}, the first one had "
                f"{', '.join(self._names)}; give every block the same columns"
            )
        return lengths.pop() if lengths else 0


def empty_columns() -> Columns:
    """Return a block without rows that has every column of spots before clustering."""
    return {column.name: np.empty(0, dtype=column.dtype) for column in BASE_COLUMNS}


def slices(columns: Columns, rows: int = BLOCK_ROWS) -> Iterator[Columns]:
    """Cut columns into blocks of at most `rows` rows; an empty table is one empty block."""
    total = len(next(iter(columns.values()), ()))
    for start in range(0, max(total, 1), rows):
        yield {name: values[start : start + rows] for name, values in columns.items()}


def to_dtype(values: NDArray[Any], dtype: str) -> NDArray[Any]:
    """Convert quietly: a number beyond float32 becomes infinite, as any reader would take it."""
    with np.errstate(over="ignore"):
        return values.astype(dtype, copy=False)


def require_file(path: Path) -> None:
    """Refuse what is not a plain file before anything blocks on it (a pipe would).

    Raises
    ------
    TableError
        There is no such file, or it is a folder or a pipe.
    """
    if not path.exists():
        raise TableError(f"{path} does not exist: check the name and the folder")
    if not path.is_file():
        raise TableError(f"{path} is not a file: give the path of one table")


def positive_number(value: object) -> float | None:
    """Return a value that a file claims, if it can be a size, an interval or a count at all."""
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < 1e300:
        return float(value)
    return None


def positive_count(value: object) -> int | None:
    """Return a whole number above 0, else ``None``."""
    number = positive_number(value)
    return int(number) if number is not None and number == int(number) else None


def check_frames(frame: NDArray[np.int64], path: Path) -> None:
    """Refuse negative frame numbers.

    Raises
    ------
    TableError
        A frame number lies below 0.
    """
    if frame.size and int(frame.min()) < 0:
        raise TableError(
            f"{path}: frame {int(frame.min())} is negative; frames count from 0 (ThunderSTORM: 1)"
        )


def first_line(error: BaseException) -> str:
    """Return the first line of a foreign error's text, for a sentence of ours."""
    line = (str(error).strip().splitlines() or [type(error).__name__])[0][:_LONGEST_CAUSE]
    # Control codes of a damaged file would reach the terminal.
    return "".join(letter if letter.isprintable() else "?" for letter in line)


def listed(names: Iterable[object], most: int = 8) -> str:
    """Name the columns of a foreign file in a sentence: quoted, shortened, not all of many."""
    texts = list(map(str, itertools.islice(names, most + 1)))
    shown = ", ".join(repr(text if len(text) <= 40 else f"{text[:40]}...") for text in texts[:most])
    return f"{shown}, ..." if len(texts) > most else shown or "nothing"
