"""From a movie file to a file of localisations, block by block."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from rotortrack.cameras.camera import Camera, camera_from_options
from rotortrack.errors import ConfigurationError, MetadataWarning
from rotortrack.exchange.tables import open_writer
from rotortrack.exchange.writer import TableInfo
from rotortrack.localise.engine import Counts, localise
from rotortrack.movies.movie import Movie
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.settings import Layer, Settings, resolve

FIRST_FRAME = "first_frame"
"""Key of a table's provenance: the first frame of the movie that was looked at."""

_FROM_FILE = ("pixel_size_nm", "frame_interval_s", "exposure_s")


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


def settings_for_movie(movie: Movie, layers: list[Layer]) -> Settings:
    """Resolve all options, the movie's own metadata below everything that the user gave."""
    known = {field: value for field, value in movie.metadata.items() if field in _FROM_FILE}
    file_layers = [
        Layer(value.origin, {"movie": {field: value.value}}) for field, value in known.items()
    ]
    settings = resolve(SECTIONS, [*file_layers, *layers])
    for field, value in known.items():
        chosen = getattr(settings["movie"], field)
        recorded = float(value.value)
        if abs(chosen - recorded) > 0.01 * recorded:
            warnings.warn(
                f"{field} is {chosen:g} by {settings.origins[f'movie.{field}']} but "
                f"{recorded:g} by {value.origin}: the former is used",
                MetadataWarning,
                stacklevel=2,
            )
    return settings


@contextmanager
def opened(path: Path, layers: list[Layer], *required: str) -> Iterator[OpenedMovie]:
    """Open a movie, resolve the settings, and prepare the camera.

    Parameters
    ----------
    path
        The movie file.
    layers
        What the user gave, later ones win.
    *required
        Keys such as ``movie.pixel_size_nm`` without which the work makes no sense.

    Raises
    ------
    MovieError, CameraError, ConfigurationError
        As the parts raise them.
    """
    with open_movie(path) as whole:
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
    return TableInfo(
        pixel_size_nm=options.pixel_size_nm,
        frames=movie.first_frame + frames,
        height_px=movie.origin_px[1] + height,
        width_px=movie.origin_px[0] + width,
        frame_interval_s=options.frame_interval_s,
        provenance={FIRST_FRAME: movie.first_frame, **provenance},
    )


def localise_to_file(
    source: OpenedMovie,
    target: Path,
    *,
    workers: int | None = None,
    progress: Progress = silent,
) -> Counts:
    """Localise a movie into a table file, block by block."""
    movie, settings = source.movie, source.settings
    frames = movie.shape[0]
    counts = Counts()
    progress("localise", 0, frames)
    with open_writer(target, extent(source, settings.as_dict())) as writer:
        for block in localise(
            movie,
            source.camera,
            settings["localise"],
            pixel_size_nm=settings["movie"].pixel_size_nm,
            workers=workers,
        ):
            writer.append(block.columns)
            counts += block.counts
            progress("localise", block.stop, frames)
    return counts
