"""From a movie, or from a table, to a run folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.photon_transfer import GainEstimate, gain_from_movie, warn_if_contradicted
from rotortrack.errors import InputError
from rotortrack.exchange.tables import read_localisations
from rotortrack.exchange.writer import TableInfo
from rotortrack.movies.movie import Movie
from rotortrack.pipeline import stages
from rotortrack.pipeline.localise_run import (
    FIRST_FRAME,
    OpenedMovie,
    Progress,
    extent,
    localise_to_file,
    opened,
    silent,
)
from rotortrack.pipeline.presets import SECTIONS, notes_on
from rotortrack.pipeline.provenance import Record
from rotortrack.pipeline.store import RunFolder
from rotortrack.pipeline.table_runs import read_for, settings_for_table
from rotortrack.settings import Layer, Settings, resolve

if TYPE_CHECKING:
    import pandas as pd

MEAN_IMAGE_FRAMES = 100


@dataclass(frozen=True)
class Result:
    """What a run made, as the summary, the figures and the caller need it.

    Attributes
    ----------
    folder, settings, record
        Where it lies, how it was made, and what its manifest says.
    tables
        By the name of their schema; tracks and drift are absent where there are none.
    drift_bins
        Frames, dx (nm) and dy (nm) of the bins behind the drift.
    mean_image
        Mean of some frames, in counts.
    """

    folder: RunFolder
    settings: Settings
    record: Record
    tables: Mapping[str, pd.DataFrame]
    drift_bins: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None = None
    mean_image: NDArray[np.float32] | None = None

    @property
    def rotors(self) -> pd.DataFrame:
        """One row a rotor."""
        return self.tables["rotors"]


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
    with (
        record.warnings(),
        opened(path, layers, *required) as source,
        RunFolder.claim(target) as folder,
    ):
        settings, movie = source.settings, source.movie
        record.options(settings)
        for sentence in notes_on(settings):
            record.note(sentence)
        with record.timed("input"):
            progress("input", 0, 0)
            record.input(path, target)
            check_gain(source)
        with folder.scratch("localisations.parquet") as part:
            with record.timed("localise"):
                counts = localise_to_file(source, part, workers=workers, progress=progress)
            localisations = read_localisations(part)
        record.count_spots(movie.shape[0], counts)
        with record.timed("correct"):
            progress("correct", 0, 0)
            pixel_size_nm = settings["movie"].pixel_size_nm
            corrected = stages.correct(localisations, settings, pixel_size_nm=pixel_size_nm)
        record.count(precise=corrected.precise, dense=corrected.dense)
        with record.timed("rotors"):
            progress("rotors", 0, 0)
            found = stages.find(
                corrected.localisations,
                corrected.trusted,
                settings,
                n_frames=movie.shape[0],
                drift_sd_nm=corrected.drift_sd_nm,
            )
        _record_found(record, found)
        with record.timed("motion"):
            progress("motion", 0, 0)
            moved = stages.move(found.localisations, found.rotors, settings)
        _record_verdicts(record, moved.rotors)
        drift = corrected.drift
        tables = {
            "localisations": found.localisations,
            "drift": drift.table,
            "rotors": moved.rotors,
            "decisions": found.decisions,
            "tracks": moved.tracks,
        }
        info = extent(source, record.content)
        bins = (drift.bin_frames, drift.bin_dx_nm, drift.bin_dy_nm)
        image = _mean_image(movie)
        folder.replace(tables, info, record, settings)
    return Result(folder, settings, record, tables, bins, image)


def rotors_from_table(
    path: Path, layers: list[Layer], target: Path, *, progress: Progress = silent
) -> Result:
    """Group the localisations of a table into rotors and screen them.

    The table is taken as it is: filter it and correct its drift before, where that is due.
    Parameters and result are those of :func:`run_movie`; there are no tracks yet.
    """
    record = Record("rotors")
    with record.warnings():
        settings, info = settings_for_table(path, layers)
        settings.require("movie.frame_interval_s")
        table = read_for(settings, path)
        record.options(settings)
        record.input(path, target)
        n_frames = _frames_of(table, info)
        record.count(frames=n_frames, localisations=len(table))
        with record.timed("rotors"):
            progress("rotors", 0, 0)
            trusted = np.ones(len(table), bool)
            found = stages.find(table, trusted, settings, n_frames=n_frames)
        _record_found(record, found)
        _record_verdicts(record, found.rotors)
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
        provenance={**info.provenance, **record.content},
    )
    folder = RunFolder.create(target)
    folder.replace(tables, info, record, settings)
    return Result(folder, settings, record, tables)


def motion_of_run(path: Path, layers: list[Layer], *, progress: Progress = silent) -> Result:
    """Measure the motion of the rotors of an existing run folder.

    Options are those of the run, below what the user gives now.
    """
    folder = RunFolder.open(path)
    record = Record("motion")
    with record.warnings():
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
    info = TableInfo(provenance=record.content)
    kept = ("localisations", "drift", "decisions")
    folder.replace(written, info, record, settings, keep=kept)
    return Result(folder, settings, record, tables)


def check_gain(source: OpenedMovie) -> GainEstimate:
    """Estimate the gain from the movie's own noise and warn where the camera's contradicts it."""
    saturation = source.camera.saturation_adu
    estimate = gain_from_movie(
        source.movie, saturation_adu=None if saturation is None else float(np.min(saturation))
    )
    warn_if_contradicted(estimate, source.camera.gain_e_per_adu)
    return estimate


def _frames_of(table: pd.DataFrame, info: TableInfo) -> int:
    """Count the frames that were looked at: as the table records, or as its rows show."""
    if info.frames is not None:
        first = info.provenance.get(FIRST_FRAME, 0)
        return info.frames - (first if isinstance(first, int) else 0)
    return int(table["frame"].max() - table["frame"].min() + 1) if len(table) else 0


def _record_found(record: Record, found: stages.Found) -> None:
    record.note(found.distance_reason)
    record.count(duplicates=found.duplicates, small_clusters=found.small_clusters)


def _record_verdicts(record: Record, rotors: pd.DataFrame) -> None:
    kept = int((rotors["verdict"] == "kept").sum())
    record.count(rotors_found=len(rotors), rotors_kept=kept)


def _mean_image(movie: Movie) -> NDArray[np.float32]:
    """Average evenly spread frames, in counts."""
    frames, height, width = movie.shape
    chosen = np.unique(np.linspace(0, frames - 1, MEAN_IMAGE_FRAMES).astype(int))
    total = np.zeros((height, width))
    for index in chosen:
        total += np.nan_to_num(movie.frames(int(index), int(index) + 1)[0])
    return (total / len(chosen)).astype(np.float32)
