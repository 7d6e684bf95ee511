"""Both colours of a recording, each as a movie of its own with the camera of its pixels."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rotortrack.cameras.camera import Camera
from rotortrack.errors import ConfigurationError, MovieError
from rotortrack.movies.movie import Movie
from rotortrack.movies.select import select
from rotortrack.pipeline.localise_run import OpenedMovie, opened
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.settings import Layer, Settings, resolve
from rotortrack.twocolour.split import split_regions

if TYPE_CHECKING:
    from rotortrack.twocolour.channel_options import ChannelsOptions

Region = tuple[int, int, int, int]

_ORIGIN = "the second colour"


@contextmanager
def both_colours(
    paths: Path | Sequence[Path], layers: list[Layer], *required: str
) -> Iterator[tuple[OpenedMovie, OpenedMovie]]:
    """Open both colours; settings are those of the first, the second's start at its own width.

    Parameters
    ----------
    paths, layers, required
        As of :func:`rotortrack.pipeline.localise_run.opened`; `[channels]` says where the second
        colour is.

    Raises
    ------
    ConfigurationError
        It is nowhere, in two places, or not inside the sensor.
    MovieError
        The colours differ in size, or their frames do not belong together.
    """
    options: ChannelsOptions = resolve(SECTIONS, layers)["channels"]
    _check(options, layers)
    if options.second_movie is not None or options.second_channel is not None:
        others = paths if options.second_movie is None else Path(options.second_movie)
        other = Layer(_ORIGIN, {"movie": {"channel": options.second_channel}})
        with (
            opened(paths, layers, *required) as first,
            opened(others, [*layers, other], *required) as second,
        ):
            _check_together(first.movie, second.movie)
            yield first, _with_own_width(second, options)
        return
    with opened(paths, layers, *required) as whole:
        _, height, width = whole.movie.shape
        regions = _regions(options, (height, width))
        first, second = (_part(whole, region) for region in regions)
        yield first, _with_own_width(second, options)


def _regions(options: ChannelsOptions, shape: tuple[int, int]) -> tuple[Region, Region]:
    if options.first_region is not None and options.second_region is not None:
        return options.first_region, options.second_region
    assert options.split is not None
    return split_regions(shape, options.split, swapped=options.swapped)


def _part(whole: OpenedMovie, region: Region) -> OpenedMovie:
    """Cut a movie and its camera to a region of the sensor."""
    movie = select(whole.movie, region)
    camera: Camera = whole.camera
    if not camera.is_scalar:
        camera = camera.crop(*region)
    return OpenedMovie(movie, whole.settings, camera)


def _with_own_width(source: OpenedMovie, options: ChannelsOptions) -> OpenedMovie:
    if options.second_sigma_px is None:
        return source
    own = dataclasses.replace(source.settings["localise"], initial_sigma_px=options.second_sigma_px)
    settings = Settings({**source.settings.sections, "localise": own}, source.settings.origins)
    return dataclasses.replace(source, settings=settings)


def _check(options: ChannelsOptions, layers: Sequence[Layer]) -> None:
    """Refuse options that contradict each other, all at once."""
    mistakes = []
    places = {
        "split": options.split,
        "first_region and second_region": options.second_region or options.first_region,
        "second_movie or second_channel": options.second_movie
        or (None if options.second_channel is None else "channel"),
    }
    named = [name for name, value in places.items() if value is not None]
    if not named:
        mistakes.append(
            "[channels] does not say where the second colour is: give --split left-right or "
            "top-bottom, --first-region and --second-region, --second-movie, or --second-channel"
        )
    elif len(named) > 1:
        mistakes.append(f"[channels] gives {' and '.join(named)}: keep one of them")
    if (options.first_region is None) != (options.second_region is None):
        mistakes.append("[channels] needs both first_region and second_region, or neither")
    elif options.first_region is not None and options.second_region is not None:
        sizes = options.first_region[2:], options.second_region[2:]
        if sizes[0] != sizes[1]:
            mistakes.append(
                f"[channels] first_region has {sizes[0][0]} x {sizes[0][1]} pixels, second_region "
                f"{sizes[1][0]} x {sizes[1][1]}: give both the same size"
            )
    region = any("region" in layer.values.get("movie", {}) for layer in layers)
    if region and options.second_movie is None and options.second_channel is None and named:
        mistakes.append(
            "movie.region and a split view contradict each other: give channels.first_region and "
            "channels.second_region instead"
        )
    if mistakes:
        raise ConfigurationError(*mistakes)


def _check_together(first: Movie, second: Movie) -> None:
    """Refuse movies whose frames do not belong together."""
    names = [movie.path.name if movie.path else "movie" for movie in (first, second)]
    if first.shape[1:] != second.shape[1:]:
        sizes = [f"{movie.shape[2]} x {movie.shape[1]}" for movie in (first, second)]
        raise MovieError(
            f"{names[0]} has frames of {sizes[0]} pixels and {names[1]} of {sizes[1]}: give "
            "two colours of the same part of the sensor, or --region for both"
        )
    if first.numbers is None and second.numbers is None and first.shape[0] != second.shape[0]:
        raise MovieError(
            f"{names[0]} has {first.shape[0]} frames and {names[1]} has {second.shape[0]}, and "
            "neither tells the time of its frames: give --frames for the part where both are whole"
        )
    if first.times_s is None or second.times_s is None:
        return
    common, at_first, at_second = np.intersect1d(
        _numbers(first), _numbers(second), return_indices=True
    )
    if not common.size:
        raise MovieError(f"{names[0]} and {names[1]} have no frame in common: give one recording")
    started = [movie.times_s[0] for movie in (first, second) if movie.times_s is not None]
    late_s = (second.times_s[at_second] - started[1]) - (first.times_s[at_first] - started[0])
    interval_s = float(np.median(np.diff(first.times_s)))
    worst = float(np.abs(late_s).max())
    if worst > 0.5 * interval_s:
        raise MovieError(
            f"frames of {names[0]} and {names[1]} are out of step by up to {worst:.3g} s: give "
            "two colours that one trigger recorded, or --frames for the part before"
        )


def _numbers(movie: Movie) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    if movie.numbers is not None:
        return movie.numbers
    return np.arange(movie.first_frame, movie.first_frame + movie.shape[0])
