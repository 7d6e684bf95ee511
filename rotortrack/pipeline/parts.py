"""Unfinished and reusable work of a run: the folder `parts/`.

    parts/localise-KEY/00000000-00001023.parquet    localisations of these frames, last included
    parts/localise-KEY/done.json                    all frames are there
    parts/correct-KEY/*.parquet, done.json          results of a later stage

Everything is written atomically and named by the key of its stage (see `keys`), so that what is
found under a key is whole and still holds; Parquet's checksums find what a failing disk did to it,
and a part that cannot be read is made again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import re
import shutil
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rotortrack import files
from rotortrack.errors import TableError
from rotortrack.exchange import parquet
from rotortrack.exchange.writer import Columns, TableInfo
from rotortrack.pipeline.manifest import read_json
from rotortrack.pipeline.provenance import Noted
from rotortrack.tables import LOCALISATIONS, Schema

if TYPE_CHECKING:
    import pandas as pd

_Result = TypeVar("_Result")

_DONE = "done.json"
_FOLDER = re.compile(r"(check|localise|correct|rotors|second)-[0-9a-f]{16}|commit")
_FRAMES = re.compile(r"(\d{8,})-(\d{8,})\.parquet")


@dataclass(frozen=True)
class Checkpoint:
    """The result of a stage as it is kept on disk.

    Attributes
    ----------
    tables
        By name.
    facts
        Everything else, as JSON.
    """

    tables: Mapping[str, pd.DataFrame]
    facts: Mapping[str, Any]


class Parts:
    """The kept work of one run folder under the keys of one choice of input and options."""

    def __init__(self, run: Path, keys: Mapping[str, str]) -> None:
        self.root = run / "parts"
        self._keys = keys

    def folder(self, stage: str) -> Path:
        """Give the folder of a stage; it is made when something is written to it."""
        return self.root / f"{stage}-{self._keys[stage]}"

    def facts(self, stage: str) -> dict[str, Any] | None:
        """Read what a finished stage noted; None when it did not finish or cannot be read."""
        path = self.folder(stage) / _DONE
        try:
            found = read_json(path)
        except (OSError, ValueError, RecursionError):
            return None
        return found if isinstance(found, dict) else None

    def finish(self, stage: str, facts: Mapping[str, Any]) -> None:
        """Mark a stage as finished."""
        files.write_text(self.folder(stage) / _DONE, json.dumps(facts, indent=1) + "\n")

    def load(
        self, stage: str, schemas: Mapping[str, Schema], unpack: Callable[[Checkpoint], _Result]
    ) -> tuple[_Result, Noted] | None:
        """Give back a finished stage, or None when there is none that can be read whole.

        Parameters
        ----------
        stage, schemas
            Its name and the tables that are kept of it.
        unpack
            Makes the stage's result of them.
        """
        facts = self.facts(stage)
        if facts is None:
            return None
        try:
            noted = Noted.from_json(facts)
            tables = {
                name: parquet.read_table(self.folder(stage) / f"{name}.parquet", schema)
                for name, schema in schemas.items()
            }
            return unpack(Checkpoint(tables, facts)), noted
        except (TableError, KeyError, TypeError, ValueError, OverflowError):
            # A damaged disk, or a folder from elsewhere: the stage is made again.
            return None

    def save(
        self, stage: str, schemas: Mapping[str, Schema], checkpoint: Checkpoint, noted: Noted
    ) -> None:
        """Keep a finished stage and what was noted in it: its tables first, the mark last."""
        for name, schema in schemas.items():
            path = self.folder(stage) / f"{name}.parquet"
            parquet.write_table(path, checkpoint.tables[name], schema, {})
        self.finish(stage, {**checkpoint.facts, **dataclasses.asdict(noted)})

    def tidy(self) -> None:
        """Remove the work of other inputs and options, and what a killed run left half-written."""
        wanted = {self.folder(stage).name for stage in self._keys}
        remove_work(self.root, wanted)
        sweep_work(self.root)


def sweep_work(root: Path) -> None:
    """Remove what killed runs left half-written among the work of all stages."""
    for place in root.iterdir() if root.is_dir() else ():
        if _FOLDER.fullmatch(place.name):
            files.sweep(place)


def remove_work(root: Path, wanted: Container[str] = ()) -> None:
    """Remove the folders of `parts/` that are not wanted; nothing else, and no link's target."""
    if root.is_symlink() or not root.is_dir():
        return
    for place in root.iterdir():
        ours = _FOLDER.fullmatch(place.name) and not place.is_symlink()
        if ours and place.name not in wanted:
            shutil.rmtree(place, ignore_errors=True)


@dataclass(frozen=True)
class FramePart:
    """Localisations of the frames start to stop (stop excluded), with what was noted of them."""

    path: Path
    start: int
    stop: int
    rows: int
    facts: Mapping[str, Any]


def frame_parts(folder: Path, frames: int) -> list[FramePart]:
    """List the readable parts of a movie in the order of their frames, none overlapping another.

    Parameters
    ----------
    folder
        Where they lie.
    frames
        Frames of the movie; parts beyond do not count.
    """
    found: list[FramePart] = []
    for path in sorted(folder.glob("*.parquet")):
        match = _FRAMES.fullmatch(path.name)
        if match is None:
            continue
        start, stop = int(match[1]), int(match[2]) + 1
        if not (found[-1].stop if found else 0) <= start < stop <= frames:
            continue
        with contextlib.suppress(TableError):
            facts = parquet.read_info(path).provenance
            found.append(FramePart(path, start, stop, parquet.count_rows(path), facts))
    return found


def missing_frames(parts: list[FramePart], frames: int) -> list[tuple[int, int]]:
    """Give the ranges of frames that no part holds."""
    edges = [0, *(edge for part in parts for edge in (part.start, part.stop)), frames]
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [(start, stop) for start, stop in pairs if start < stop]


def write_frame_part(
    folder: Path, start: int, stop: int, blocks: list[Columns], facts: Mapping[str, Any]
) -> None:
    """Keep the localisations of the frames start to stop (stop excluded)."""
    path = folder / f"{start:08d}-{stop - 1:08d}.parquet"
    with parquet.open_writer(path, TableInfo(provenance=dict(facts))) as writer:
        for columns in blocks:
            writer.append(columns)


def read_frame_parts(parts: list[FramePart]) -> pd.DataFrame:
    """Join parts into one table of schema LOCALISATIONS, memory for one copy and one part.

    Raises
    ------
    TableError
        A part cannot be read.
    """
    import numpy as np
    import pandas as pd

    total = sum(part.rows for part in parts)
    joined = {
        column.name: np.empty(total, column.dtype)
        for column in LOCALISATIONS.columns
        if column.name != "rotor"
    }
    row = 0
    for part in parts:
        for columns in parquet.read_blocks(part.path):
            rows = len(columns["frame"])
            for name, values in joined.items():
                values[row : row + rows] = columns[name]
            row += rows
    if row != total:
        raise TableError(f"{parts[0].path.parent} holds other rows than it counts")
    return pd.DataFrame(joined, copy=False)
