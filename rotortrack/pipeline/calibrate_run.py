"""From films of darkness and of steady light to a file of camera maps."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from rotortrack.cameras.calibrate import Calibration, calibrate, check_gain
from rotortrack.cameras.film_statistics import FilmStatistics, film_statistics
from rotortrack.cameras.maps import write_maps
from rotortrack.errors import CalibrationWarning, CameraError, UsageError
from rotortrack.movies.movie import Movie
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie
from rotortrack.pipeline.identity import Identity, identify
from rotortrack.pipeline.localise_run import Progress, silent
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import Record
from rotortrack.settings import Layer, resolve

OPTIONS = (
    *("movie.region", "movie.frames", "movie.axes", "movie.channel", "movie.z_slice"),
    *("movie.salvage", "movie.max_frame_megapixels"),
    *("camera.gain_e_per_adu", "camera.saturation_adu"),
)
"""What a calibration depends on besides its films."""

_BLOCK_BYTES = 8_000_000
_DISAGREEMENT = 0.01


@dataclass(frozen=True)
class Calibrated:
    """A calibration, how it was made, and how its films were understood."""

    calibration: Calibration
    provenance: dict[str, Any]
    frames: int
    notes: tuple[str, ...]


def check_target(target: Path, films: Sequence[Path]) -> None:
    """Refuse a name that later commands would not take for camera maps, or that a film has.

    Raises
    ------
    UsageError
        Says which name to give.
    """
    if target.suffix.lower() != ".npz":
        raise UsageError(f"{target} does not end in .npz: name the camera maps so with -o")
    for film in films:
        with contextlib.suppress(OSError):
            if target.samefile(film):
                raise UsageError(f"{target} is one of the films: choose another name with -o")


def calibrate_films(
    dark: Path,
    flats: Sequence[Path],
    layers: list[Layer],
    *,
    folder: Path = Path(),
    progress: Progress = silent,
) -> Calibrated:
    """Calibrate a camera by its films, block by block.

    Parameters
    ----------
    dark, flats
        Film without light; films of steady light, one for each brightness.
    layers
        What the user gave; `OPTIONS` are used.
    folder
        Where the maps will lie, from which the record names the films.
    progress
        Called as each film is read.

    Raises
    ------
    MovieError, CameraError, ConfigurationError
        A film cannot be read or does not do, sizes differ, a film is given twice, or the gain is
        not known.

    Warns
    -----
    CalibrationWarning, GainWarning
        Films are doubtful; see :func:`rotortrack.cameras.calibrate.calibrate`.
    """
    settings = resolve(SECTIONS, layers)
    options, camera = settings["movie"], settings["camera"]
    check_gain(len(flats), camera.gain_e_per_adu)
    record = Record("calibrate")
    record.options(settings, OPTIONS)
    paths = (dark, *flats)
    _check_different(paths)
    files, notes = _check_alike(paths, options)
    record.inputs(files, folder)
    of_dark = _statistics(dark, options, None, progress)
    of_flats = [(str(path), _statistics(path, options, of_dark.mean, progress)) for path in flats]
    calibration = calibrate(
        of_dark,
        of_flats,
        gain_e_per_adu=camera.gain_e_per_adu,
        saturation_adu=camera.saturation_adu,
    )
    frames = of_dark.frames + sum(film.frames for _, film in of_flats)
    record.count(
        frames=frames,
        dark_frames=of_dark.frames,
        hot_pixels=int(calibration.hot_pixels.sum()),
        dead_pixels=int(calibration.dead_pixels.sum()),
    )
    return Calibrated(calibration, record.provenance, frames, notes)


def save(calibrated: Calibrated, target: Path) -> None:
    """Write the maps and how they were made.

    Raises
    ------
    ResourceError
        The file cannot be written.
    """
    write_maps(target, calibrated.calibration.arrays(), calibrated.provenance)


def _check_different(paths: Sequence[Path]) -> None:
    seen: dict[tuple[int, str], Path] = {}
    for path in paths:
        identity = identify(path)
        mark = (identity.size_bytes, identity.edges)
        if mark in seen:
            raise CameraError(
                f"{seen[mark]} and {path} are the same film: give each film once, the dark one "
                "first"
            )
        seen[mark] = path


def _check_alike(
    paths: Sequence[Path], options: MovieOptions
) -> tuple[list[Identity], tuple[str, ...]]:
    """Refuse films of different size before any is read; warn of different exposures.

    Give their files, and how these were understood.
    """
    notes: list[str] = []
    files: list[Identity] = []
    first: tuple[int, ...] = ()
    exposures: dict[Path, float] = {}
    for path in paths:
        with _film(path, options) as movie:
            size = movie.shape[1:]
            if not first:
                first = size
            if size != first:
                raise CameraError(
                    f"{path} has frames of {size[1]} x {size[0]} pixels but {paths[0]} of "
                    f"{first[1]} x {first[0]} (width x height): take all films with one region of "
                    "the sensor"
                )
            exposure = movie.metadata.get("exposure_s")
            if exposure is not None and isinstance(exposure.value, float):
                exposures[path] = exposure.value
            notes += [f"{path.name}: {note}" for note in movie.notes]
            files += [identify(file) for file in movie.paths]
    if exposures and max(exposures.values()) > (1 + _DISAGREEMENT) * min(exposures.values()):
        told = ", ".join(f"{path.name} {value * 1e3:.4g} ms" for path, value in exposures.items())
        warnings.warn(
            f"the films differ in exposure ({told}): what gathers in the dark during the "
            "difference counts as light or offset; take the dark film with the exposure of the "
            "movies to be analysed, and change the flats by the lamp",
            CalibrationWarning,
            stacklevel=3,
        )
    return files, tuple(notes)


@contextlib.contextmanager
def _film(path: Path, options: MovieOptions) -> Iterator[Movie]:
    with open_movie(path, options) as whole:
        yield select(whole, options.region, options.frames)


def _statistics(
    path: Path,
    options: MovieOptions,
    offset_adu: NDArray[Any] | None,
    progress: Progress,
) -> FilmStatistics:
    with _film(path, options) as movie:
        try:
            return film_statistics(_blocks(movie, path.name, progress), offset_adu=offset_adu)
        except CameraError as error:
            raise CameraError(f"{path}: {error}") from error


def _blocks(movie: Movie, name: str, progress: Progress) -> Iterator[NDArray[Any]]:
    frames, height, width = movie.shape
    size = max(1, _BLOCK_BYTES // (height * width * movie.dtype.itemsize))
    progress(name, 0, frames)
    for start in range(0, frames, size):
        stop = min(frames, start + size)
        yield movie.frames(start, stop)
        progress(name, stop, frames)
