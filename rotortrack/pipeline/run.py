"""From a movie, or from a table, to a run folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.photon_transfer import gain_from_movie, warn_if_contradicted
from rotortrack.exchange.tables import read_localisations
from rotortrack.exchange.writer import TableInfo
from rotortrack.movies.movie import Movie
from rotortrack.pipeline import stages
from rotortrack.pipeline.localise_run import Progress, localise_to_file, opened, silent
from rotortrack.pipeline.presets import SECTIONS, notes_on
from rotortrack.pipeline.provenance import Record
from rotortrack.pipeline.store import RunFolder
from rotortrack.pipeline.table_runs import read_for, settings_for_table
from rotortrack.settings import Layer, Settings, resolve
from rotortrack.tables import DRIFT, TRACKS, empty

if TYPE_CHECKING:
    import pandas as pd

MEAN_IMAGE_FRAMES = 100


@dataclass(frozen=True)
class Result:
    """What a run made, as the summary, the figures and the caller need it."""

    folder: RunFolder
    settings: Settings
    record: Record
    localisations: pd.DataFrame
    rotors: pd.DataFrame
    tracks: pd.DataFrame
    drift: pd.DataFrame
    drift_bins: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None = None
    mean_image: NDArray[np.float32] | None = None


def run_movie(
    path: Path,
    layers: list[Layer],
    target: Path,
    *,
    workers: int | None = None,
    progress: Progress = silent,
) -> Result:
    """Analyse one movie from frames to rotor speeds and write a run folder.

    Parameters
    ----------
    path, layers
        The movie and what the user gave.
    target
        The run folder; made when absent.
    workers
        Threads of the localisation.
    progress
        Called as each stage advances.

    Returns
    -------
    Result
        The tables, as written.
    """
    record = Record("run")
    required = ("movie.pixel_size_nm", "movie.frame_interval_s")
    with record.warnings(), opened(path, layers, *required) as source:
        settings, movie = source.settings, source.movie
        folder = RunFolder.create(target)
        record.options(settings)
        for sentence in notes_on(settings):
            record.note(sentence)
        with record.timed("input"):
            progress("input", 0, 0)
            record.input(path, target)
            warn_if_contradicted(gain_from_movie(movie), source.camera.gain_e_per_adu)
        with folder.scratch("localisations.parquet") as part:
            with record.timed("localise"):
                counts = localise_to_file(source, part, {}, workers=workers, progress=progress)
            localisations = read_localisations(part)
        record.count(frames=movie.shape[0], **vars(counts))
        with record.timed("correct"):
            progress("correct", 0, 0)
            corrected = stages.correct(
                localisations,
                settings,
                pixel_size_nm=settings["movie"].pixel_size_nm,
            )
        drift = corrected.drift
        record.count(precise=corrected.precise, dense=corrected.dense)
        with record.timed("rotors"):
            progress("rotors", 0, 0)
            found = stages.find(
                corrected.localisations, corrected.trusted, settings, n_frames=movie.shape[0]
            )
        _record_found(record, found)
        with record.timed("motion"):
            progress("motion", 0, 0)
            moved = stages.move(found.localisations, found.rotors, settings)
        result = Result(
            folder,
            settings,
            record,
            found.localisations,
            moved.rotors,
            moved.tracks,
            drift.table,
            (drift.bin_frames, drift.bin_dx_nm, drift.bin_dy_nm),
            _mean_image(movie),
        )
        _write(result, "drift", "localisations", "rotors", "tracks", decisions=found.decisions)
    return result


def rotors_from_table(
    path: Path, layers: list[Layer], target: Path, *, progress: Progress = silent
) -> Result:
    """Group the localisations of a table into rotors and screen them.

    The table is taken as it is: filter it and correct its drift before, where that is due.
    Parameters and result are those of :func:`run_movie`; there are no tracks yet.
    """
    record = Record("rotors")
    with record.warnings():
        settings, _ = settings_for_table(path, layers)
        settings.require("movie.frame_interval_s")
        table = read_for(settings, path)
        folder = RunFolder.create(target)
        record.options(settings)
        record.input(path, target)
        n_frames = int(table["frame"].max() - table["frame"].min() + 1) if len(table) else 0
        record.count(frames=n_frames, localisations=len(table))
        with record.timed("rotors"):
            progress("rotors", 0, 0)
            trusted = np.ones(len(table), bool)
            found = stages.find(table, trusted, settings, n_frames=n_frames)
        _record_found(record, found)
        result = Result(
            folder,
            settings,
            record,
            found.localisations,
            found.rotors,
            empty(TRACKS),
            empty(DRIFT),
        )
        _write(result, "localisations", "rotors", decisions=found.decisions)
    return result


def motion_of_run(path: Path, layers: list[Layer], *, progress: Progress = silent) -> Result:
    """Measure the motion of the rotors of an existing run folder.

    Options are those of the run, below what the user gives now.
    """
    folder = RunFolder.open(path)
    record = Record("motion")
    with record.warnings():
        earlier = record.continue_from(folder.read_manifest(), str(folder.manifest_path))
        settings = resolve(SECTIONS, [*earlier, *layers])
        settings.require("movie.frame_interval_s")
        record.options(settings)
        localisations = folder.read("localisations")
        rotors = folder.read("rotors")
        with record.timed("motion"):
            progress("motion", 0, 0)
            moved = stages.move(localisations, rotors, settings)
        result = Result(
            folder,
            settings,
            record,
            localisations,
            moved.rotors,
            moved.tracks,
            folder.read("drift"),
        )
        _write(result, "rotors", "tracks")
    return result


def _record_found(record: Record, found: stages.Found) -> None:
    record.note(found.distance_reason)
    record.count(duplicates=found.duplicates, small_clusters=found.small_clusters)


def _write(result: Result, *names: str, decisions: pd.DataFrame | None = None) -> None:
    """Write tables, then the manifest: a folder with a manifest is whole."""
    kept = result.rotors["verdict"] == "kept"
    result.record.count(rotors_found=len(result.rotors), rotors_kept=int(kept.sum()))
    movie = result.settings["movie"]
    info = TableInfo(
        pixel_size_nm=movie.pixel_size_nm,
        frames=result.record.content["counts"].get("frames"),
        frame_interval_s=movie.frame_interval_s,
        provenance=result.record.content,
    )
    for name in names:
        result.folder.write(name, getattr(result, name), info)
    if decisions is not None:
        result.folder.write("decisions", decisions, info)
    result.folder.write_record(result.record, result.settings)


def _mean_image(movie: Movie) -> NDArray[np.float32]:
    """Average evenly spread frames, in counts."""
    frames, height, width = movie.shape
    chosen = np.unique(np.linspace(0, frames - 1, MEAN_IMAGE_FRAMES).astype(int))
    total = np.zeros((height, width))
    for index in chosen:
        total += np.nan_to_num(movie.frames(int(index), int(index) + 1)[0])
    return (total / len(chosen)).astype(np.float32)
