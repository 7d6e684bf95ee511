"""From a movie file to a file of localisations, block by block."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.camera import Camera, camera_from_options
from rotortrack.errors import ConfigurationError, MetadataWarning
from rotortrack.exchange.tables import open_writer
from rotortrack.exchange.writer import TableInfo
from rotortrack.localise.engine import Columns, Counts, localise
from rotortrack.localise.options import LocaliseOptions
from rotortrack.movies.movie import Movie
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie
from rotortrack.pipeline.identity import identify
from rotortrack.pipeline.presets import SECTIONS, WORKFLOW
from rotortrack.pipeline.provenance import FIRST_FRAME, RECORDED_FRAMES, Record
from rotortrack.settings import Layer, Settings, resolve

if TYPE_CHECKING:
    from rotortrack.cameras.photon_transfer import GainEstimate

_FROM_FILE = ("pixel_size_nm", "frame_interval_s", "exposure_s")
_DISAGREEMENT = 0.01

_MISFIT_RATIO = 1.2
"""Chi-square over its expectation, or the inverse, from which the gain is in doubt."""

_FEWEST_FITS_JUDGED, _MOST_FITS_JUDGED = 30, 10_000


class Progress(Protocol):
    """What a run tells of its progress: stage, units done, units in all (0 when unknown)."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Take notice."""


def silent(stage: str, done: int, total: int) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class OpenedMovie:
    """A movie with the settings that its own metadata completed, and its camera."""

    movie: Movie
    settings: Settings
    camera: Camera

    @property
    def region(self) -> tuple[int, int, int, int]:
        """The part of the sensor: x0, y0, width, height in pixels."""
        _, height, width = self.movie.shape
        return (*self.movie.origin_px, width, height)


def settings_for_movie(movie: Movie, layers: list[Layer]) -> Settings:
    """Resolve all options, the movie's own metadata below everything that the user gave.

    An exposure of the file that is longer than the frame interval is taken to fill it.

    Parameters
    ----------
    movie
        The movie, which may know its pixel size, frame interval and exposure.
    layers
        What the user gave, later ones win.

    Raises
    ------
    ConfigurationError
        Options are wrong, or the user gave an exposure longer than the frame interval.

    Warns
    -----
    MetadataWarning
        Two origins differ by more than 1 % in one of these values, or the exposure is longer than
        the frame interval by more than 1 %.
    """
    known = [
        Layer(value.origin, {"movie": {field: value.value}})
        for field, value in movie.metadata.items()
        if field in _FROM_FILE
    ]
    settings = resolve(SECTIONS, [*known, *layers])
    for field in _FROM_FILE:
        _warn_of_contradictions(field, settings, [*known, *layers])
    chosen, origins = settings["movie"], settings.origins
    interval_s, exposure_s = chosen.frame_interval_s, chosen.exposure_s
    if interval_s is None or exposure_s is None or exposure_s <= interval_s:
        return settings
    origin = origins["movie.exposure_s"]
    if exposure_s > (1.0 + _DISAGREEMENT) * interval_s:
        told = (
            f"exposure_s is {exposure_s:g} by {origin}, longer than frame_interval_s of "
            f"{interval_s:g} by {origins['movie.frame_interval_s']}, which no camera does: "
        )
        of_file = {layer.origin for layer in known}
        if origin not in of_file and origins["movie.frame_interval_s"] not in of_file:
            raise ConfigurationError(f"{told}correct one of them")
        ranks = [layer.origin for layer in (*known, *layers)]
        doubtful = min(
            ("movie.exposure_s", "movie.frame_interval_s"),
            key=lambda key: ranks.index(origins[key]),
        )
        warnings.warn(
            f"{told}{doubtful.removeprefix('movie.')} is doubtful, and exposures are taken to fill "
            "the frame interval; give the right value",
            MetadataWarning,
            stacklevel=2,
        )
    limited = Layer(
        f"{origin}, limited to the frame interval", {"movie": {"exposure_s": interval_s}}
    )
    return resolve(SECTIONS, [*known, *layers, limited])


def _warn_of_contradictions(field: str, settings: Settings, layers: Sequence[Layer]) -> None:
    """Name every value of a field that differs from the one in use."""
    used: float | None = getattr(settings["movie"], field)
    origin = settings.origins.get(f"movie.{field}")
    for layer in layers:
        other = layer.values.get("movie", {}).get(field)
        if used is None or other is None or layer.origin == origin:
            continue
        if abs(used - other) > _DISAGREEMENT * max(used, other):
            warnings.warn(
                f"{field} is {used:g} by {origin} but {other:g} by {layer.origin}: the former is "
                "used",
                MetadataWarning,
                stacklevel=3,
            )


@contextmanager
def opened(
    paths: Path | Sequence[Path], layers: list[Layer], *required: str
) -> Iterator[OpenedMovie]:
    """Open a movie, resolve the settings, and prepare the camera.

    Parameters
    ----------
    paths
        The movie, one file or several.
    layers
        What the user gave, later ones win.
    *required
        Keys such as ``movie.pixel_size_nm`` without which the work makes no sense.

    Raises
    ------
    MovieError, CameraError, ConfigurationError
        As the parts raise them.
    """
    with open_movie(paths, resolve(SECTIONS, layers)["movie"]) as whole:
        settings = settings_for_movie(whole, layers)
        camera = _demand(settings, *required)
        camera.check_fits(*whole.shape[1:])
        movie = select(whole, settings["movie"].region, settings["movie"].frames)
        if not camera.is_scalar and settings["movie"].region:
            camera = camera.crop(*settings["movie"].region)
        yield OpenedMovie(movie, settings, camera)


def _demand(settings: Settings, *required: str) -> Camera:
    """Make the camera; name everything that is missing in one error."""
    missing: list[str] = []
    try:
        settings.require(*required)
    except ConfigurationError as error:
        missing.extend(error.mistakes)
    try:
        camera = camera_from_options(settings["camera"])
    except ConfigurationError as error:
        missing.extend(error.mistakes)
    if missing:
        raise ConfigurationError(*missing)
    return camera


def extent(source: OpenedMovie, provenance: Mapping[str, object]) -> TableInfo:
    """Describe the movie to a table of its localisations: frames count from frame 0 of the file."""
    movie, options = source.movie, source.settings["movie"]
    frames, height, width = movie.shape
    first, last = movie.first_frame, movie.first_frame + frames - 1
    if movie.numbers is not None:
        first, last = int(movie.numbers[0]), int(movie.numbers[-1])
    return TableInfo(
        pixel_size_nm=options.pixel_size_nm,
        frames=last + 1,
        height_px=movie.origin_px[1] + height,
        width_px=movie.origin_px[0] + width,
        frame_interval_s=options.frame_interval_s,
        provenance={FIRST_FRAME: first, RECORDED_FRAMES: frames, **provenance},
    )


def absent_frames(movie: Movie) -> dict[str, int]:
    """Count frames that a cut file lost and those that the camera dropped, where there are any."""
    dropped = 0
    if movie.numbers is not None:
        dropped = int(movie.numbers[-1] - movie.numbers[0] + 1) - movie.shape[0]
    counts = {"missing_frames": movie.missing_frames, "dropped_frames": dropped}
    return {name: count for name, count in counts.items() if count}


def check_gain(source: OpenedMovie) -> GainEstimate:
    """Estimate the gain from the movie's own noise and warn where the camera's contradicts it."""
    # Its image filters take a while to import, and few movies need it here.
    from rotortrack.cameras.photon_transfer import gain_from_movie, warn_if_contradicted

    saturation = source.camera.saturation_adu
    estimate = gain_from_movie(
        source.movie, saturation_adu=None if saturation is None else float(np.min(saturation))
    )
    warn_if_contradicted(estimate, source.camera.gain_e_per_adu)
    return estimate


class _Misfits:
    """Tells whether the noise of plain fits is what the camera's gain makes of the counts.

    The residuals are at hand and cost nothing; the movie is read again for its gain only where
    they are in doubt.
    """

    def __init__(self, options: LocaliseOptions) -> None:
        pixels = (2 * options.fit_radius_px + 1) ** 2
        self._freedom = pixels - (5 if options.fit_sigma else 4)
        self._taken: list[NDArray[np.floating]] = []
        self._number = 0

    def add(self, columns: Columns) -> None:
        """Take the fits of a block; the first of a movie suffice."""
        if self._number < _MOST_FITS_JUDGED:
            plain = columns["chi2"][columns["fit_flags"] == 0]
            self._taken.append(plain)
            self._number += len(plain)

    @property
    def are_doubtful(self) -> bool:
        """Whether their median is off by more than a fifth."""
        if self._number < _FEWEST_FITS_JUDGED:
            return False
        ratio = float(np.median(np.concatenate(self._taken))) / self._freedom
        return not 1.0 / _MISFIT_RATIO < ratio < _MISFIT_RATIO


def localise_to_file(
    source: OpenedMovie,
    target: Path,
    *,
    workers: int | None = None,
    progress: Progress = silent,
) -> Counts:
    """Localise a movie into a table file, block by block.

    Warns
    -----
    GainWarning
        The residuals of the fits and the movie's own noise contradict the given gain.
    """
    movie, settings = source.movie, source.settings
    frames = movie.shape[0]
    counts = Counts()
    record = Record("localise")
    record.options(settings, WORKFLOW)
    record.inputs([identify(path) for path in movie.paths], target.parent)
    record.count(frames=frames, **absent_frames(movie))
    progress("localise", 0, frames)
    misfits = _Misfits(settings["localise"])
    with open_writer(target, extent(source, record.provenance)) as writer:
        for block in localise(
            movie,
            source.camera,
            settings["localise"],
            pixel_size_nm=settings["movie"].pixel_size_nm,
            workers=workers,
        ):
            writer.append(block.columns)
            misfits.add(block.columns)
            counts += block.counts
            progress("localise", block.stop, frames)
    if misfits.are_doubtful:
        check_gain(source)
    return counts
