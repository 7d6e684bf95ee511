"""Single stages on a run folder: rotors from a table, and the motion of a folder's rotors."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rotortrack.errors import ConfigurationError, InputError
from rotortrack.exchange.tables import read_info
from rotortrack.exchange.writer import TableInfo
from rotortrack.motion.population import of_rotors
from rotortrack.pipeline import stages
from rotortrack.pipeline.curate import curate
from rotortrack.pipeline.identity import describe, identify, refuse_changed, sha256_of
from rotortrack.pipeline.localise_run import Progress, silent
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import FIRST_FRAME, RECORDED_FRAMES, Record, following
from rotortrack.pipeline.run import Draw, Result, record_found, record_verdicts, stage
from rotortrack.pipeline.second_colour import ENDS, ends_of
from rotortrack.pipeline.store import RunFolder
from rotortrack.pipeline.table_runs import read_for, settings_for_table
from rotortrack.pipeline.voltage_run import measure_voltages
from rotortrack.settings import Layer, Settings, resolve
from rotortrack.tables import DECISIONS, empty

if TYPE_CHECKING:
    import pandas as pd

_MOTION_USES = ("movie.frame_interval_s", "movie.exposure_s", "motion")
# The options of motion are recorded for the command that follows.
_ROTORS_USE = (
    *("movie.pixel_size_nm", "movie.mirrored", "cluster", "circle", "screen"),
    *_MOTION_USES,
)


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
        settings, info = settings_for_table(path, only(_ROTORS_USE, layers))
        settings.require("movie.frame_interval_s")
        table = read_for(settings, path)
        record.options(settings, _ROTORS_USE)
        record.inputs([file], target, [sha256_of(file)])
        n_frames = _frames_of(table, info)
        record.count(frames=n_frames, localisations=len(table))
        with record.timed("rotors"):
            progress("rotors", 0, 0)
            trusted = np.ones(len(table), bool)
            found = stages.find(table, trusted, settings, n_frames=n_frames)
        record_found(record, found)
        rotors, decisions = curate(target, found.rotors, found.decisions, record)
        record_verdicts(record, rotors)
        refuse_changed([file])
        tables = {
            "localisations": found.localisations,
            "rotors": rotors,
            "decisions": decisions,
        }
        movie = settings["movie"]
        info = dataclasses.replace(
            info,
            pixel_size_nm=movie.pixel_size_nm,
            frame_interval_s=movie.frame_interval_s,
            provenance=following(info.provenance, record.provenance),
        )
        folder.commit(tables, info, record)
        folder.remove_kept_work()
    return Result(folder, settings, record, tables)


def motion_of_run(
    path: Path,
    layers: list[Layer],
    *,
    trace: Path | None = None,
    progress: Progress = silent,
    draw: Draw | None = None,
) -> Result:
    """Measure the motion of the rotors of an existing run folder.

    Options are those of the run, below what the user gives now. With a recorded trace of camera
    trigger and voltage, frames get their voltage and rotors a speed at each of them.
    """
    RunFolder.find(path)
    recorded_trace = None if trace is None else identify(trace)
    record = Record("motion")
    with record.warnings(), RunFolder.claim(path, "motion") as folder:
        RunFolder.open(path)
        manifest = folder.read_manifest()
        earlier = record.continue_from(manifest)
        settings = resolve(SECTIONS, [*earlier, *only(_MOTION_USES, layers)])
        settings.require("movie.frame_interval_s")
        recorded = {
            f"{section}.{key}" for section, values in manifest["options"].items() for key in values
        }
        record.options(settings, recorded.union(_MOTION_USES))
        with stage(folder, record, progress, "motion"):
            tables = {name: folder.read(name) for name in ("localisations", "rotors", "drift")}
            if "verdict" not in tables["rotors"]:
                raise InputError(
                    f"{path / 'rotors.parquet'} has no verdicts: screen the rotors again"
                )
            judged = _decisions_of(folder)
            rotors, decisions = curate(path, tables["rotors"], judged, record)
            record_verdicts(record, rotors)
            moved = stages.move(tables["localisations"], rotors, settings)
            record.content["population"] = of_rotors(moved.rotors).plain()
            tables.update(moved.tables)
            names = list(moved.tables)
            if "registration" in record.content:
                tables["second_localisations"] = folder.read("second_localisations")
                tables.update(ends_of(tables, folder.registration(), settings, record))
                names += ENDS
            kept = ["localisations", "drift", "second_localisations"]
            if decisions is judged:
                kept.append("decisions")
            else:
                tables["decisions"] = decisions
                names.append("decisions")
            if trace is not None and recorded_trace is not None:
                record.content["trace"] = describe(recorded_trace, path, sha256_of(recorded_trace))
                tables.update(_voltages(trace, folder, tables, settings, record))
                refuse_changed([recorded_trace])
                names += ["voltages", "voltage_speeds"]
            written = {name: tables[name] for name in names}
            info = TableInfo(provenance=record.provenance)
            unfinished = None if draw is None else "figures"
            folder.commit(written, info, record, keep=kept, unfinished=unfinished)
        result = Result(folder, settings, record, tables)
        if draw is not None:
            with stage(folder, record, progress, "figures"):
                draw(result)
        folder.note_finished(record)
    return result


def _decisions_of(folder: RunFolder) -> pd.DataFrame:
    """Read the decisions of a run; none where they were not kept."""
    there = (folder.path / f"{DECISIONS.name}.parquet").is_file()
    return folder.read(DECISIONS.name) if there else empty(DECISIONS)


def _voltages(
    trace: Path,
    folder: RunFolder,
    tables: dict[str, pd.DataFrame],
    settings: Settings,
    record: Record,
) -> dict[str, pd.DataFrame]:
    """Make the tables that a recorded trace allows."""
    seen = int(tables["localisations"]["frame"].max()) + 1 if len(tables["localisations"]) else 0
    n_frames = read_info(folder.path / "localisations.parquet").frames or seen
    found = measure_voltages(
        trace, tables["tracks"], tables["rotors"], settings, n_frames=max(n_frames, seen)
    )
    for sentence in found.notes:
        record.note(sentence)
    return {"voltages": found.voltages, "voltage_speeds": found.speeds}


def only(uses: Collection[str], layers: list[Layer]) -> list[Layer]:
    """Keep the options that a stage uses; a record must not name others, which changed nothing.

    Raises
    ------
    ConfigurationError
        The user gave another option to this command by name.
    """
    kept, mistakes = [], []
    for layer in layers:
        values: dict[str, dict[str, object]] = {}
        for section, entries in layer.values.items():
            for key, value in entries.items():
                if section in uses or f"{section}.{key}" in uses:
                    values.setdefault(section, {})[key] = value
                elif layer.origin in ("flag", "--set"):
                    mistakes.append(
                        f"{layer.origin}: {section}.{key} belongs to an earlier stage and would "
                        "change nothing here: leave it out, or use `rotortrack run`"
                    )
        kept.append(Layer(layer.origin, values))
    if mistakes:
        raise ConfigurationError(*mistakes)
    return kept


def _frames_of(table: pd.DataFrame, info: TableInfo) -> int:
    """Count the frames that were looked at: as the table records, or as its rows show."""
    if info.frames is not None:
        recorded = info.provenance.get(RECORDED_FRAMES)
        if isinstance(recorded, int):
            return recorded
        first = info.provenance.get(FIRST_FRAME, 0)
        return info.frames - (first if isinstance(first, int) else 0)
    return int(table["frame"].max() - table["frame"].min() + 1) if len(table) else 0
