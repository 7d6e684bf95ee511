"""From a movie to a run folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.line_noise import check_line_noise
from rotortrack.errors import InputError, ResourceError
from rotortrack.motion.population import of_rotors
from rotortrack.movies.movie import Movie
from rotortrack.pipeline import stages
from rotortrack.pipeline.accuracy import cost_notes
from rotortrack.pipeline.checkpoints import (
    CORRECTED,
    FOUND,
    pack_corrected,
    pack_found,
    unpack_corrected,
    unpack_found,
)
from rotortrack.pipeline.curate import curate
from rotortrack.pipeline.identity import (
    Identity,
    describe,
    identify,
    refuse_changed,
    sha256_of,
)
from rotortrack.pipeline.keys import stage_keys
from rotortrack.pipeline.localise_parts import localise_in_parts
from rotortrack.pipeline.localise_run import (
    OpenedMovie,
    Progress,
    absent_frames,
    check_gain,
    extent,
    silent,
)
from rotortrack.pipeline.parts import Checkpoint, Parts
from rotortrack.pipeline.presets import WORKFLOW, notes_on
from rotortrack.pipeline.provenance import Record
from rotortrack.pipeline.second_colour import (
    SECOND_USES,
    SecondColour,
    ends_of,
    opened_colours,
    record_second,
)
from rotortrack.pipeline.store import RunFolder
from rotortrack.rotors.curation import FILE_NAME, read_curation
from rotortrack.settings import Layer, Settings
from rotortrack.tables import Schema

if TYPE_CHECKING:
    import pandas as pd

MEAN_IMAGE_FRAMES = 100

_Made = TypeVar("_Made")


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
    movie
        The movie itself, open while the figures are drawn.
    """

    folder: RunFolder
    settings: Settings
    record: Record
    tables: Mapping[str, pd.DataFrame]
    drift_bins: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None = None
    mean_image: NDArray[np.float32] | None = None
    movie: Movie | None = None

    @property
    def rotors(self) -> pd.DataFrame:
        """One row a rotor."""
        return self.tables["rotors"]


Draw = Callable[[Result], None]
"""Draws the figures of a run into its folder."""


def run_movie(
    paths: Path | Sequence[Path],
    layers: list[Layer],
    target: Path,
    *,
    workers: int | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
    draw: Draw | None = None,
) -> Result:
    """Analyse one movie from frames to rotor speeds and write a run folder.

    Work that an earlier run into the same folder finished with the same input, options and code
    is taken over, so that a stopped run goes on where it was, and a changed option reruns its
    stage and the later ones alone.

    Parameters
    ----------
    paths, layers
        The movie, one file or several, and what the user gave.
    target
        The run folder; made when absent.
    workers
        Threads of the localisation.
    overwrite
        Replace results of another movie.
    progress
        Called as each stage advances.
    draw
        Draws the figures once the tables are written.

    Returns
    -------
    Result
        The tables, as written.

    Raises
    ------
    MovieError, CameraError, ConfigurationError
        The movie or the camera cannot be used, or options are missing or wrong.
    LockedError, UsageError, ResourceError
        The folder is in use, holds another movie's results, or cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, rotortrack as rt
    >>> from rotortrack.settings import Layer
    >>> rotor = rt.IdealRotor(
    ...     kind="driven", x_nm=2600.0, y_nm=2600.0, radius_nm=120.0, photons=800.0,
    ...     omega_rad_s=40.0
    ... )
    >>> scene = rt.IdealScene(
    ...     shape_px=(48, 48), n_frames=400, pixel_size_nm=108.3, frame_interval_s=0.002,
    ...     exposure_s=0.002, sigma_nm=140.0, background_photons=5.0, rotors=(rotor,)
    ... )
    >>> sensor = {"offset_adu": 100.0, "gain_e_per_adu": 0.5, "read_noise_e": 1.4}
    >>> movie = rt.film(scene, rt.Camera(**sensor), np.random.default_rng(1))
    >>> known = {"pixel_size_nm": 108.3, "frame_interval_s": 0.002, "exposure_s": 0.002}
    >>> given = {"movie": known, "camera": sensor, "drift": {"method": "none"}}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     rt.write_movie(path := pathlib.Path(folder) / "movie.tif", movie.frames(0, 400))
    ...     result = rt.run_movie(path, [Layer("notebook", given)], pathlib.Path(folder) / "run")
    >>> round(result.rotors["omega_rad_s"][0])
    40
    """
    record = Record("run")
    required = ("movie.pixel_size_nm", "movie.frame_interval_s")
    with record.warnings(), opened_colours(paths, layers, *required) as (source, second):
        files = [identify(path) for path in source.movie.paths]
        given = source.settings["camera"].camera_maps
        maps = None if given is None else identify(Path(given))
        with RunFolder.claim(target, "run", files, overwrite=overwrite) as folder:
            run = _Run(source, second, files, maps, folder, record, progress)
            return run.to_the_end(workers, draw)


class _Run:
    """The workflow on one movie in one claimed folder."""

    def __init__(
        self,
        source: OpenedMovie,
        second: SecondColour | None,
        files: list[Identity],
        maps: Identity | None,
        folder: RunFolder,
        record: Record,
        progress: Progress,
    ) -> None:
        self._source = source
        self._second = second
        self._settings = source.settings
        self._files = files
        self._maps = maps
        self._folder = folder
        self._record = record
        self._progress = progress
        if maps is not None:
            record.content["camera_maps"] = describe(maps, folder.path, sha256_of(maps))
        if second is not None:
            record_second(record, second, folder.path)
        keys = stage_keys(files, source.settings, () if second is None else second.files)
        record.content["keys"] = keys
        self._parts = Parts(folder.path, keys)

    def to_the_end(self, workers: int | None, draw: Draw | None) -> Result:
        record, settings, folder = self._record, self._settings, self._folder
        uses = WORKFLOW if self._second is None else (*WORKFLOW, *SECOND_USES)
        record.options(settings, uses)
        record.inputs(self._files, folder.path)
        movie = self._source.movie
        record.count(frames=movie.shape[0], **absent_frames(movie))
        told = (*notes_on(settings), *cost_notes(settings), *self._source.movie.notes)
        for sentence in told:
            record.note(sentence)
        with self._stage("check"):
            # A mistake in it is told before the long work.
            read_curation(folder.path / FILE_NAME)
            self._check()
        with self._stage("localise", self._source.movie.shape[0]):
            localisations, hashes = localise_in_parts(
                self._source,
                self._files,
                self._parts,
                record,
                workers=workers,
                progress=self._progress,
            )
            record.inputs(self._files, folder.path, hashes)
            refuse_changed([] if self._maps is None else [self._maps])
        if self._second is not None:
            seen = self._second_localisations(self._second, workers)
        with self._stage("correct"):
            corrected = self._corrected(localisations)
            del localisations
        with self._stage("rotors"):
            found = self._found(corrected)
        # What people say may change from one call to the next, so nothing of it is kept.
        rotors, decisions = curate(folder.path, found.rotors, found.decisions, record)
        with self._stage("motion"):
            moved = stages.move(found.localisations, rotors, settings, workers=workers)
            record_verdicts(record, moved.rotors)
            record.content["population"] = of_rotors(moved.rotors).plain()
        drift = corrected.drift
        tables = {
            "localisations": found.localisations,
            "drift": drift.table,
            "decisions": decisions,
            **moved.tables,
        }
        registration = None
        if self._second is not None:
            tables["second_localisations"] = seen
            with self._stage("ends"):
                tables.update(ends_of(tables, self._second.registration, settings, record))
            registration = self._second.registration_text
        with self._stage("tables"):
            info = extent(self._source, record.provenance)
            image = _mean_image(self._source.movie)
            unfinished = None if draw is None else "figures"
            folder.commit(tables, info, record, registration=registration, unfinished=unfinished)
            self._parts.tidy()
        bins = (drift.bin_frames, drift.bin_dx_nm, drift.bin_dy_nm)
        result = Result(folder, settings, record, tables, bins, image, self._source.movie)
        if draw is not None:
            with self._stage("figures"):
                draw(result)
        folder.note_finished(record)
        return result

    def _second_localisations(self, second: SecondColour, workers: int | None) -> pd.DataFrame:
        """Take over or make the localisations of the second colour."""
        with self._stage("second", second.source.movie.shape[0]):
            seen, _ = localise_in_parts(
                second.source,
                second.files,
                self._parts,
                self._record,
                workers=workers,
                progress=self._progress,
                stage="second",
            )
            refuse_changed([second.registration_file])
        self._record.count(second_localisations=len(seen))
        if seen.empty:
            raise InputError(
                "the second colour shows no spot: look at it, or leave --channels and the split out"
            )
        return seen

    def _check(self) -> None:
        """Hold what is known of the camera against what the movie itself shows."""

        def check() -> None:
            check_gain(self._source)
            gain_e_per_adu = float(np.median(self._source.camera.gain_e_per_adu))
            check_line_noise(self._source.movie, gain_e_per_adu)

        self._kept_or_made("check", {}, lambda _: None, check, lambda _: Checkpoint({}, {}))

    def _corrected(self, localisations: pd.DataFrame) -> stages.Corrected:
        """Take over or compute precise, drift-corrected, dense localisations."""

        def correct() -> stages.Corrected:
            pixel_size_nm = self._settings["movie"].pixel_size_nm
            corrected = stages.correct(localisations, self._settings, pixel_size_nm=pixel_size_nm)
            self._record.count(precise=corrected.precise, dense=corrected.dense)
            return corrected

        unpack = partial(unpack_corrected, localisations=localisations)
        return self._kept_or_made("correct", CORRECTED, unpack, correct, pack_corrected)

    def _found(self, corrected: stages.Corrected) -> stages.Found:
        """Take over or find the rotors."""

        def find() -> stages.Found:
            found = stages.find(
                corrected.localisations,
                corrected.trusted,
                self._settings,
                n_frames=self._source.movie.shape[0],
                drift_sd_nm=corrected.drift_sd_nm,
            )
            record_found(self._record, found)
            return found

        unpack = partial(unpack_found, localisations=corrected.localisations)
        return self._kept_or_made("rotors", FOUND, unpack, find, pack_found)

    def _kept_or_made(
        self,
        stage: str,
        schemas: Mapping[str, Schema],
        unpack: Callable[[Checkpoint], _Made],
        make: Callable[[], _Made],
        pack: Callable[[_Made], Checkpoint],
    ) -> _Made:
        """Take over what an earlier run kept of a stage, or make it and keep it."""
        kept = self._parts.load(stage, schemas, unpack)
        if kept is not None:
            self._record.repeat(kept[1])
            return kept[0]
        with self._record.noting() as noted:
            made = make()
        self._parts.save(stage, schemas, pack(made), noted)
        return made

    def _stage(self, name: str, units: int = 0) -> AbstractContextManager[None]:
        return stage(self._folder, self._record, self._progress, name, units)


@contextmanager
def stage(
    folder: RunFolder, record: Record, progress: Progress, name: str, units: int = 0
) -> Iterator[None]:
    """Time a stage, and note in the folder that it began and why it ended early."""
    try:
        folder.note_unfinished(record, name, "begun")
        progress(name, 0, units)
        with record.timed(name):
            yield
    except BaseException as error:
        # What ended the stage is what the user must learn, even if the disk is full.
        with suppress(ResourceError):
            folder.note_unfinished(record, name, _reason(error))
        raise


def _reason(error: BaseException) -> str:
    """Say in one line why a stage ended early."""
    if isinstance(error, KeyboardInterrupt):
        return "stopped"
    return " ".join(str(error).split()) or type(error).__name__


def record_found(record: Record, found: stages.Found) -> None:
    """Record how rotors were found."""
    record.note(found.distance_reason)
    record.count(duplicates=found.duplicates, small_clusters=found.small_clusters)


def record_verdicts(record: Record, rotors: pd.DataFrame) -> None:
    """Record how many rotors were found and kept."""
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
