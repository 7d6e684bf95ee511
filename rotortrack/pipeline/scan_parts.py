"""Kept runs of a scan: `parts/scan-KEY/00000000-00000015.npz`, first and last run in the name.

Each part is written atomically under a key of everything that decides its numbers, so that what is
found there still holds; one that a failing disk damaged is not whole, and its runs are made again.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ArchiveError
from rotortrack.simulate.archive import read_archive, write_archive
from rotortrack.simulate.scan import ANGLES, KINDS, RunResult
from rotortrack.simulate.tables import RUNS

FOLDER = re.compile(r"scan-[0-9a-f]{16}")

DIMENSIONS = {"shape_nm": 3, "time_us": 2, "turned_rad": 2}
"""Arrays beside the table of runs: (runs, vertices, 3), and twice (runs, ANGLES)."""

_NAME = re.compile(r"(\d{8})-(\d{8})\.npz")


def arrays_of(results: Sequence[RunResult]) -> dict[str, NDArray[np.float64]]:
    """Stack what the table of runs has no columns for."""
    return {name: np.array([getattr(result, name) for result in results]) for name in DIMENSIONS}


def write_part(folder: Path, results: Sequence[RunResult]) -> None:
    """Keep runs that follow each other."""
    rows = [result.row for result in results]
    path = folder / f"{rows[0]['run']:08d}-{rows[-1]['run']:08d}.npz"
    about = {"rows": rows, "seconds": [result.seconds for result in results]}
    write_archive(path, arrays_of(results), about)


def read_parts(folder: Path, runs: int, vertices: int) -> dict[int, RunResult]:
    """Give the kept runs by their number.

    Parameters
    ----------
    folder
        Where the parts lie, if there are any.
    runs, vertices
        Runs of the scan and vertices of its rods; others do not count.
    """
    kept: dict[int, RunResult] = {}
    for path in sorted(folder.glob("*.npz")):
        match = _NAME.fullmatch(path.name)
        if match is None or not int(match[1]) <= int(match[2]) < runs:
            continue
        numbers = range(int(match[1]), int(match[2]) + 1)
        try:
            arrays, about = read_archive(path, "a part of a scan", DIMENSIONS)
        except ArchiveError:
            continue
        if _is_whole(arrays, about, numbers, vertices):
            for i, number in enumerate(numbers):
                own = {name: values[i] for name, values in arrays.items()}
                kept[number] = RunResult(about["rows"][i], **own, seconds=about["seconds"][i])
    return kept


def _is_whole(
    arrays: dict[str, NDArray[np.float64]], about: dict[str, Any], numbers: range, vertices: int
) -> bool:
    """Whether an archive holds these runs, each with all that is kept of one."""
    count = len(numbers)
    rows, seconds = about.get("rows"), about.get("seconds")
    shapes = {"shape_nm": (vertices, 3), "time_us": (ANGLES,), "turned_rad": (ANGLES,)}
    columns = {column.name: KINDS[column.dtype] for column in RUNS.columns}
    return (
        isinstance(rows, list)
        and isinstance(seconds, list)
        and len(rows) == len(seconds) == count
        and all(isinstance(value, float) for value in seconds)
        and all(arrays[name].shape == (count, *shape) for name, shape in shapes.items())
        and all(isinstance(row, dict) and row.keys() == columns.keys() for row in rows)
        and all(type(row[name]) is kind for row in rows for name, kind in columns.items())
        and [row["run"] for row in rows] == list(numbers)
    )
