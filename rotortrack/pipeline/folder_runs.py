"""Single stages on a run folder: rotors from a table, and the motion of a folder's rotors."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rotortrack.errors import InputError
from rotortrack.exchange.writer import TableInfo
from rotortrack.pipeline import stages
from rotortrack.pipeline.identity import identify, refuse_changed, sha256_of
from rotortrack.pipeline.localise_run import Progress, silent
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import FIRST_FRAME, RECORDED_FRAMES, Record, following
from rotortrack.pipeline.run import Draw, Result, record_found, record_verdicts
from rotortrack.pipeline.store import RunFolder
from rotortrack.pipeline.table_runs import read_for, settings_for_table
from rotortrack.settings import Layer, resolve

if TYPE_CHECKING:
    import pandas as pd


def rotors_from_table(
    path: Path,
    layers: list[Layer],
    target: Path,
    *,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Result:
    """Group the localisations of a table into rotors and screen them.

    The table is taken as it is: filter it and correct its drift before, where that is due.
    Parameters and result are those of :func:`rotortrack.pipeline.run.run_movie`; there are no
    tracks yet.
    """
    record = Record("rotors")
    file = identify(path)
    with (
        record.warnings(),
        RunFolder.claim(target, "rotors", [file], overwrite=overwrite) as folder,
    ):
        settings, info = settings_for_table(path, layers)
        settings.require("movie.frame_interval_s")
        table = read_for(settings, path)
        record.options(settings)
        record.inputs([file], target, [sha256_of(file)])
        n_frames = _frames_of(table, info)
        record.count(frames=n_frames, localisations=len(table))
        with record.timed("rotors"):
            progress("rotors", 0, 0)
            trusted = np.ones(len(table), bool)
            found = stages.find(table, trusted, settings, n_frames=n_frames)
        record_found(record, found)
        record_verdicts(record, found.rotors)
        refuse_changed([file])
        tables = {
            "localisations": found.localisations,
            "rotors": found.rotors,
            "decisions": found.decisions,
        }
        movie = settings["movie"]
        info = dataclasses.replace(
            info,
            pixel_size_nm=movie.pixel_size_nm,
            frame_interval_s=movie.frame_interval_s,
            provenance=following(info.provenance, record.provenance),
        )
        folder.commit(tables, info, record, settings)
    return Result(folder, settings, record, tables)


def motion_of_run(
    path: Path, layers: list[Layer], *, progress: Progress = silent, draw: Draw | None = None
) -> Result:
    """Measure the motion of the rotors of an existing run folder.

    Options are those of the run, below what the user gives now.
    """
    RunFolder.find(path)
    record = Record("motion")
    with record.warnings(), RunFolder.claim(path, "motion") as folder:
        RunFolder.open(path)
        earlier = record.continue_from(folder.read_manifest())
        settings = resolve(SECTIONS, [*earlier, *layers])
        settings.require("movie.frame_interval_s")
        record.options(settings)
        tables = {name: folder.read(name) for name in ("localisations", "rotors", "drift")}
        if "verdict" not in tables["rotors"]:
            raise InputError(f"{path / 'rotors.parquet'} has no verdicts: screen the rotors again")
        with record.timed("motion"):
            progress("motion", 0, 0)
            moved = stages.move(tables["localisations"], tables["rotors"], settings)
        tables.update(rotors=moved.rotors, tracks=moved.tracks)
        written = {name: tables[name] for name in ("rotors", "tracks")}
        info = TableInfo(provenance=record.provenance)
        kept = ("localisations", "drift", "decisions")
        unfinished = None if draw is None else "figures"
        folder.commit(written, info, record, settings, keep=kept, unfinished=unfinished)
        result = Result(folder, settings, record, tables)
        if draw is not None:
            with record.timed("figures"):
                draw(result)
        folder.note_finished(record)
    return result


def _frames_of(table: pd.DataFrame, info: TableInfo) -> int:
    """Count the frames that were looked at: as the table records, or as its rows show."""
    if info.frames is not None:
        recorded = info.provenance.get(RECORDED_FRAMES)
        if isinstance(recorded, int):
            return recorded
        first = info.provenance.get(FIRST_FRAME, 0)
        return info.frames - (first if isinstance(first, int) else 0)
    return int(table["frame"].max() - table["frame"].min() + 1) if len(table) else 0
