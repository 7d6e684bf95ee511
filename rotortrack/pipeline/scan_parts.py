"""Kept runs of a scan: `parts/scan-KEY/00000000-00000015.npz`, first and last run in the name.

Each part is written atomically under a key of everything that decides its numbers, so that what is
found there still holds; one that a failing disk damaged is not whole, and its runs are made again.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotortrack import files
from rotortrack.simulate.scan import ANGLES, RunResult
from rotortrack.simulate.tables import RUNS

FOLDER = re.compile(r"scan-[0-9a-f]{16}")

_NAME = re.compile(r"(\d{8})-(\d{8})\.npz")
_MOST_LETTERS = 4000
_DAMAGE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, NotImplementedError)


def write_part(folder: Path, results: Sequence[RunResult]) -> None:
    """Keep runs that follow each other."""
    first, last = (results[i].row["run"] for i in (0, -1))
    rows = {c.name: _column(c.dtype, [r.row[c.name] for r in results]) for c in RUNS.columns}
    with files.atomic_path(folder / f"{first:08d}-{last:08d}.npz") as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **rows, **arrays_of(results))


def arrays_of(results: Sequence[RunResult]) -> dict[str, NDArray[np.float64]]:
    """Stack what the table of runs has no columns for.

    Returns
    -------
    dict
        shape_nm (runs, vertices, 3), time_us and turned_rad (runs, ANGLES), seconds (runs,).
    """
    return {
        "shape_nm": np.array([result.shape_nm for result in results]),
        "time_us": np.array([result.time_us for result in results]),
        "turned_rad": np.array([result.turned_rad for result in results]),
        "seconds": np.array([result.seconds for result in results]),
    }


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
    for path in sorted(folder.glob("*.npz")) if not folder.is_symlink() else ():
        match = _NAME.fullmatch(path.name)
        if match is None or not int(match[1]) <= int(match[2]) < runs:
            continue
        try:
            results = _read_part(path, range(int(match[1]), int(match[2]) + 1), vertices)
        except _DAMAGE:
            continue
        kept |= {int(result.row["run"]): result for result in results}
    return kept


def _read_part(path: Path, numbers: range, vertices: int) -> list[RunResult]:
    count = len(numbers)
    shapes = {
        "shape_nm": (count, vertices, 3),
        "time_us": (count, ANGLES),
        "turned_rad": (count, ANGLES),
        "seconds": (count,),
    }
    expected_bytes = 8 * sum(int(np.prod(shape)) for shape in shapes.values())
    expected_bytes += count * len(RUNS.columns) * 4 * _MOST_LETTERS
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > expected_bytes:
            raise ValueError("larger than its runs")
    with np.load(path, allow_pickle=False) as content:
        columns = {column.name: content[column.name] for column in RUNS.columns}
        arrays = {name: content[name] for name in shapes}
    for column in RUNS.columns:
        values = columns[column.name]
        kind = "U" if column.dtype == "str" else np.dtype(column.dtype).kind
        if values.shape != (count,) or values.dtype.kind != kind:
            raise ValueError(f"{column.name} is no column of the runs")
    for name, shape in shapes.items():
        if arrays[name].shape != shape or arrays[name].dtype != np.float64:
            raise ValueError(f"{name} has another shape")
    if columns["run"].tolist() != list(numbers):
        raise ValueError("holds other runs than its name says")
    return [
        RunResult(
            row={name: values[i].item() for name, values in columns.items()},
            shape_nm=arrays["shape_nm"][i],
            time_us=arrays["time_us"][i],
            turned_rad=arrays["turned_rad"][i],
            seconds=float(arrays["seconds"][i]),
        )
        for i in range(count)
    ]


def _column(dtype: str, values: Sequence[object]) -> NDArray[np.generic]:
    if dtype == "str":
        return np.array([str(value)[:_MOST_LETTERS] for value in values], dtype=np.str_)
    return np.array(values, dtype=dtype)
