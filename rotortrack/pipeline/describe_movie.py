"""What a movie says of itself, and what its counts show of the camera."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rotortrack.cameras.camera import Camera, camera_from_options
from rotortrack.cameras.line_noise import LineNoise, check_line_noise
from rotortrack.cameras.photon_transfer import GainEstimate, gain_from_movie, warn_if_contradicted
from rotortrack.cameras.pixels import PixelCheck, check_pixels
from rotortrack.movies.metadata import Value
from rotortrack.movies.movie import Movie
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie
from rotortrack.movies.timing import FEWEST_TIMED_FRAMES, FrameTimes, number_frames
from rotortrack.pipeline.localise_run import Progress, settings_for_movie, silent
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.settings import Layer, Settings, resolve

NEEDED = ("pixel_size_nm", "frame_interval_s", "exposure_s")
"""What a movie must tell, or the user in its place."""


@dataclass(frozen=True)
class MovieReport:
    """What is in a movie.

    Attributes
    ----------
    files, size_bytes
        The files and their size together.
    shape, dtype, first_frame, origin_px, notes, missing_frames
        As of the movie, after selection.
    values
        What is known of it, each with its origin; the user's word comes first.
    times
        What the recorded times show; None where the file tells none.
    gain, column_noise, row_noise, pixels
        What the counts show of the camera.
    gain_in_use
        Electrons per count, as given or else as estimated; None where neither is.
    """

    files: tuple[Path, ...]
    size_bytes: int
    shape: tuple[int, int, int]
    dtype: str
    first_frame: int
    origin_px: tuple[int, int]
    notes: tuple[str, ...]
    missing_frames: int
    values: dict[str, Value]
    times: FrameTimes | None
    gain: GainEstimate
    gain_in_use: float | None
    column_noise: LineNoise
    row_noise: LineNoise
    pixels: PixelCheck

    def as_dict(self) -> dict[str, Any]:
        """Give everything as plain values, numbers with units in their names."""
        frames, height, width = self.shape
        return {
            "kind": "movie",
            "files": list(self.files),
            "bytes": self.size_bytes,
            "frames": frames,
            "height_px": height,
            "width_px": width,
            "dtype": self.dtype,
            "first_frame": self.first_frame,
            "origin_px": self.origin_px,
            "notes": self.notes,
            "missing_frames": self.missing_frames,
            "metadata": {name: dataclasses.asdict(value) for name, value in self.values.items()},
            "times": _times_dict(self.times) if self.times else None,
            "gain_e_per_adu": self.gain.gain_e_per_adu,
            "gain_sd_e_per_adu": self.gain.sd,
            "gain_reason": self.gain.reason,
            "column_noise": _noise_dict(self.column_noise),
            "row_noise": _noise_dict(self.row_noise),
            "pixels": dataclasses.asdict(self.pixels),
        }


def describe_movie(
    paths: Path | Sequence[Path], layers: list[Layer], *, progress: Progress = silent
) -> MovieReport:
    """Open a movie and look at what it says and what its counts show.

    Parameters
    ----------
    paths
        One file, or several of one recording in their order.
    layers
        What the user gave.
    progress
        Called as each stage advances.

    Raises
    ------
    MovieError, CameraError, ConfigurationError
        The movie or the camera maps cannot be used, or the selection leaves the movie.

    Warns
    -----
    GainWarning
        The given gain contradicts the noise.
    LineNoiseWarning
        Columns or rows share noise.
    """
    with open_movie(paths, resolve(SECTIONS, layers)["movie"]) as whole:
        settings = settings_for_movie(whole, layers)
        movie = select(whole, settings["movie"].region, settings["movie"].frames)
        camera = _camera(settings)
        given: Any = settings["camera"].gain_e_per_adu
        saturation_adu = settings["camera"].saturation_adu
        if camera is not None:
            camera.check_fits(*whole.shape[1:])
            given = camera.gain_e_per_adu
            if camera.saturation_adu is not None:
                saturation_adu = float(np.min(camera.saturation_adu))
        progress("gain", 0, 0)
        gain = gain_from_movie(movie, saturation_adu=saturation_adu)
        in_use = None if gain.reason else gain.gain_e_per_adu
        if given is not None:
            in_use = float(np.median(given))
            warn_if_contradicted(gain, given)
        progress("noise", 0, 0)
        column_noise, row_noise = check_line_noise(movie, in_use)
        pixels = check_pixels(
            movie,
            saturation_adu=saturation_adu,
            progress=lambda done, total: progress("counts", done, total),
        )
        return MovieReport(
            files=movie.paths,
            size_bytes=sum(path.stat().st_size for path in movie.paths),
            shape=movie.shape,
            dtype=movie.dtype.name,
            first_frame=movie.first_frame,
            origin_px=movie.origin_px,
            notes=movie.notes,
            missing_frames=movie.missing_frames,
            values=_values(movie, settings),
            times=_times(movie),
            gain=gain,
            gain_in_use=in_use,
            column_noise=column_noise,
            row_noise=row_noise,
            pixels=pixels,
        )


def _camera(settings: Settings) -> Camera | None:
    """Make the camera where maps or a model give all of it."""
    options = settings["camera"]
    if options.camera_maps is None and options.camera_model is None:
        return None
    return camera_from_options(options)


def _values(movie: Movie, settings: Settings) -> dict[str, Value]:
    """List what is known of the movie: what the analysis needs first, then what the file tells."""
    known = {
        name: Value(getattr(settings["movie"], name), origin)
        for name in NEEDED
        if (origin := settings.origins[f"movie.{name}"]) != "default"
    }
    return {**known, **{name: v for name, v in movie.metadata.items() if name not in known}}


def _times(movie: Movie) -> FrameTimes | None:
    if movie.times_s is None or len(movie.times_s) < FEWEST_TIMED_FRAMES:
        return None
    return number_frames(movie.times_s)


def _times_dict(times: FrameTimes) -> dict[str, Any]:
    return {
        "interval_s": times.interval_s,
        "jitter_s": times.jitter_s,
        "irregular": times.irregular,
        "dropped_frames": times.dropped,
        "gaps": times.places,
    }


def _noise_dict(noise: LineNoise) -> dict[str, Any]:
    return {**dataclasses.asdict(noise), "matters": noise.matters}
