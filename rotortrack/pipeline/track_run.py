"""From a table of localisations to tracks of mobile particles and their diffusion."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rotortrack.errors import ExposureWarning, UsageError
from rotortrack.exchange import csv, parquet
from rotortrack.files import atomic_path
from rotortrack.motion.particles import Particles, track_particles
from rotortrack.motion.tables import PARTICLE_TRACKS
from rotortrack.pipeline.identity import identify, refuse_changed, sha256_of
from rotortrack.pipeline.localise_run import Progress, silent
from rotortrack.pipeline.provenance import Record, following
from rotortrack.pipeline.table_runs import read_for, settings_for_table
from rotortrack.settings import Layer

if TYPE_CHECKING:
    import pandas as pd

_USES = ("movie.pixel_size_nm", "movie.frame_interval_s", "movie.exposure_s", "link")
_ENDINGS = (".parquet", ".csv")


@dataclass(frozen=True)
class Tracked:
    """What was found, from how many spots, and where it was written."""

    found: Particles
    localisations: int
    frame_interval_s: float
    exposure_s: float
    files: dict[str, Path]


def track_table(
    path: Path,
    target: Path,
    layers: list[Layer],
    *,
    draw: Callable[[Path, Particles, float], None],
    progress: Progress = silent,
) -> Tracked:
    """Link the localisations of a table into particles and measure their diffusion.

    Parameters
    ----------
    path, target
        Table of localisations, and that of tracks (.parquet or .csv). Beside it lie
        `NAME-particles.csv`, `NAME-msd.csv` and the figure `NAME.png`.
    layers
        What the user gave; the frame interval may also come from the table.
    draw
        Called with the path, what was found and the frame interval to draw the figure.
    progress
        Shows stages.

    Raises
    ------
    UsageError
        The target has another ending, is the input, or would replace a table of a run.
    ConfigurationError
        The frame interval is not known.
    """
    files = _targets(path, target)
    settings, info = settings_for_table(path, layers)
    settings.require("movie.frame_interval_s")
    interval_s = settings["movie"].frame_interval_s
    exposure_s = settings["movie"].exposure_s
    if exposure_s is None:
        exposure_s = interval_s
        warnings.warn(
            "exposure_s is not given, so exposures are taken to fill the frame interval of "
            f"{interval_s:g} s; localisation errors depend on it: give exposure_s",
            ExposureWarning,
            stacklevel=2,
        )
    record = Record("track")
    file = identify(path)
    table = read_for(settings, path)
    progress("track", 0, 0)
    found = track_particles(
        table,
        settings["link"],
        frame_interval_s=interval_s,
        exposure_s=exposure_s,
    )
    record.options(settings, _USES)
    record.inputs([file], target.parent, [sha256_of(file)])
    record.count(localisations=len(table), particles=len(found.particles))
    refuse_changed([file])
    provenance = following(info.provenance, record.provenance)
    progress("write", 0, 0)
    with (
        atomic_path(files["particles"]) as particles,
        atomic_path(files["msd"]) as msd,
        atomic_path(files["figure"]) as figure,
    ):
        # All or none: what comes last needs no further file.
        csv.write_csv(particles, found.particles)
        csv.write_csv(msd, found.ensemble.msd)
        draw(figure, found, interval_s)
        _write_tracks(target, found.tracks, provenance)
    return Tracked(found, len(table), interval_s, exposure_s, files)


def _targets(path: Path, target: Path) -> dict[str, Path]:
    """Name the files that are written."""
    if target.suffix.lower() not in _ENDINGS:
        raise UsageError(f"{target} has no known ending: tracks are written as .parquet or .csv")
    if (target.parent / "run.json").is_file():
        raise UsageError(
            f"{target.parent} is a run folder, whose tables must not be replaced: choose another "
            "folder with -o"
        )
    files = {
        "tracks": target,
        "particles": target.with_name(f"{target.stem}-particles.csv"),
        "msd": target.with_name(f"{target.stem}-msd.csv"),
        "figure": target.with_name(f"{target.stem}.png"),
    }
    for made in files.values():
        if made.absolute() == path.absolute():
            raise UsageError(f"{made} is the input: choose another name with -o")
    return files


def _write_tracks(target: Path, tracks: pd.DataFrame, provenance: dict[str, object]) -> None:
    if target.suffix.lower() == ".csv":
        csv.write_csv(target, tracks)
    else:
        parquet.write_table(target, tracks, PARTICLE_TRACKS, provenance)
