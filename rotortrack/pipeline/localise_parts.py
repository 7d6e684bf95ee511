"""Localisation of a movie that may be stopped at any moment and taken up again.

What is done is kept in parts of some seconds of work each. Frames are localised independently of
each other, so the joined table does not depend on where a run was stopped.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rotortrack.errors import InputError, ResourceError, TableError
from rotortrack.exchange.writer import Columns
from rotortrack.flags import FitFlag
from rotortrack.localise.engine import Block, Counts, localise
from rotortrack.pipeline.identity import Identity, RunningHash, refuse_changed
from rotortrack.pipeline.localise_run import OpenedMovie, Progress
from rotortrack.pipeline.parts import (
    FramePart,
    Parts,
    frame_parts,
    missing_frames,
    read_frame_parts,
    write_frame_part,
)
from rotortrack.pipeline.provenance import Record

if TYPE_CHECKING:
    import pandas as pd

PART_PIXELS = 2**26
"""Pixels localised between two parts: a second or two of work."""

_FIRST = "localise"


def localise_in_parts(
    source: OpenedMovie,
    files: list[Identity],
    parts: Parts,
    record: Record,
    *,
    workers: int | None,
    progress: Progress,
    stage: str = "localise",
) -> tuple[pd.DataFrame, list[str]]:
    """Localise what earlier runs have not, keep it, and join everything.

    Parameters
    ----------
    source
        The movie with its settings.
    files
        Its files as they were when they were identified.
    parts, record
        Where the work is kept, and what the manifest will say.
    workers, progress
        As everywhere.
    stage
        Under which name the work is kept; what becomes of candidates is counted for `localise`
        alone.

    Returns
    -------
    DataFrame, list of str
        All localisations, and the SHA-256 of each file.

    Raises
    ------
    InputError
        A file changed while it was read.
    """
    facts = parts.facts(stage)
    hashes = _hashes(facts, len(files))
    for _ in range(2):
        if facts is None or hashes is None:
            hashes = _complete(source, files, parts, stage, workers=workers, progress=progress)
        found = frame_parts(parts.folder(stage), source.movie.shape[0])
        if not missing_frames(found, source.movie.shape[0]):
            try:
                table = read_frame_parts(found)
            except TableError:
                _remove_damaged(found)
            else:
                progress(stage, source.movie.shape[0], source.movie.shape[0])
                if stage == _FIRST:
                    _recount(source, found, record)
                return table, hashes
        facts = None
    folder = parts.folder(stage)
    raise ResourceError(
        f"{folder} does not give back what was written to it: check the disk, or choose another "
        "run folder with -o"
    )


def _complete(
    source: OpenedMovie,
    files: list[Identity],
    parts: Parts,
    stage: str,
    *,
    workers: int | None,
    progress: Progress,
) -> list[str]:
    """Localise the frames that no part holds and mark the stage as finished."""
    frames = source.movie.shape[0]
    folder = parts.folder(stage)
    spans = missing_frames(frame_parts(folder, frames), frames)
    hashing = RunningHash(files)
    done = frames - sum(stop - start for start, stop in spans)
    progress(stage, done, frames)
    with _PartWriter(folder, source, files) as writer:
        for block in localise(
            source.movie,
            source.camera,
            source.settings["localise"],
            pixel_size_nm=source.settings["movie"].pixel_size_nm,
            workers=workers,
            spans=spans,
        ):
            writer.add(block)
            hashing.advance(block.stop / frames)
            done += block.stop - block.start
            progress(stage, done, frames)
    hashes = hashing.finish()
    refuse_changed(files)
    parts.finish(stage, {"sha256": hashes})
    return hashes


class _PartWriter:
    """Gathers blocks into parts; what was gathered is kept even when the work is stopped."""

    def __init__(self, folder: Path, source: OpenedMovie, files: list[Identity]) -> None:
        self._folder = folder
        self._files = files
        _, height, width = source.movie.shape
        self._frames_a_part = max(1, PART_PIXELS // (height * width))
        self._start = self._stop = 0
        self._gathered: list[Columns] = []
        self._counts = Counts()

    def add(self, block: Block) -> None:
        """Take the next block; write a part when it is large enough or frames are left out."""
        if self._gathered and block.start != self._stop:
            self._write()
        if not self._gathered:
            self._start = block.start
        self._gathered.append(block.columns)
        self._counts += block.counts
        self._stop = block.stop
        if self._stop - self._start >= self._frames_a_part:
            self._write()

    def __enter__(self) -> _PartWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if not self._gathered:
            return
        if kind is None:
            self._write()
            return
        # The reason why the work ended is the one to report.
        with contextlib.suppress(ResourceError, InputError):
            self._write()

    def _write(self) -> None:
        # What comes from a file that changed must not be found under the key of what it was.
        refuse_changed(self._files)
        facts = {"counts": _counts_to_json(self._counts)}
        write_frame_part(self._folder, self._start, self._stop, self._gathered, facts)
        self._gathered, self._counts = [], Counts()


def _hashes(facts: Mapping[str, Any] | None, files: int) -> list[str] | None:
    """Take the hashes that a finished stage noted."""
    found = (facts or {}).get("sha256")
    if not isinstance(found, list) or len(found) != files:
        return None
    return [str(word) for word in found]


def _recount(source: OpenedMovie, found: list[FramePart], record: Record) -> None:
    """Record what became of all candidates, as the parts noted it."""
    counts = sum((_counts_from_json(part.facts) for part in found), Counts())
    record.count_spots(source.movie.shape[0], counts)


def _counts_to_json(counts: Counts) -> dict[str, Any]:
    return {
        "candidates": counts.candidates,
        "localisations": counts.localisations,
        "masked_pixels": counts.masked_pixels,
        "flags": {str(flag.name): count for flag, count in counts.flags.items()},
    }


def _counts_from_json(facts: Mapping[str, Any]) -> Counts:
    """Read the counts of a part; a folder from elsewhere may hold anything."""
    noted = facts.get("counts")
    noted = noted if isinstance(noted, dict) else {}
    flags = noted.get("flags")
    flags = flags if isinstance(flags, dict) else {}
    return Counts(
        _whole(noted.get("candidates")),
        _whole(noted.get("localisations")),
        _whole(noted.get("masked_pixels")),
        Counter({flag: _whole(flags.get(str(flag.name))) for flag in FitFlag}),
    )


def _whole(value: object) -> int:
    return value if isinstance(value, int) else 0


def _remove_damaged(found: list[FramePart]) -> None:
    """Remove parts whose rows cannot be read, so that their frames are localised again."""
    for part in found:
        try:
            read_frame_parts([part])
        except TableError:
            part.path.unlink(missing_ok=True)
