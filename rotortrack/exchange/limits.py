"""How much a file may claim: what it declares is weighed before anything is decoded.

A table that is to be held as a whole must fit into the memory of the machine; one that passes block
by block has no limit but that its file can hold what it declares.
"""

from __future__ import annotations

import os
from pathlib import Path

from rotortrack.errors import ResourceError, TableError

_MOST_ROWS_PER_BYTE = 1_000
"""Rows that repeat one another pack to less than a byte; measured ones never do."""

_COPIES = 2
"""While blocks are joined, or Arrow's columns become pandas', a table is there twice."""


def memory_bytes() -> int | None:
    """Return the physical memory of this machine; None where the system does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None


def check_fits_memory(path: Path, rows: int, size_bytes: int) -> None:
    """Refuse to hold a table that the memory cannot hold.

    Parameters
    ----------
    path
        The file, for the sentence.
    rows, size_bytes
        What is to be held.

    Raises
    ------
    ResourceError
        Says how much memory it takes.
    """
    memory = memory_bytes()
    needed = _COPIES * size_bytes
    if memory is not None and needed > memory:
        raise ResourceError(
            f"{path} has {rows:,} rows or more, which take {needed / 1e9:.1f} GB of memory where "
            f"this computer has {memory / 1e9:.1f} GB: use a part of the table or a computer with "
            "more memory"
        )


def check_holds_rows(path: Path, rows: int) -> None:
    """Refuse a binary table that declares more rows than a file of its size can hold.

    Raises
    ------
    TableError
        The file is damaged or made to exhaust the memory.
    """
    size = path.stat().st_size
    if rows > _MOST_ROWS_PER_BYTE * size:
        raise TableError(
            f"{path} declares {rows:,} rows in {size:,} bytes, which cannot hold them: it is "
            "damaged; export it again"
        )
