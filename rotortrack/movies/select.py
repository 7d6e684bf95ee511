"""A part of a movie that remembers where on the sensor and when in the recording it lies."""

from __future__ import annotations

import numpy as np

from rotortrack.errors import ConfigurationError
from rotortrack.movies.movie import Frames, Movie, check_range


def select(
    movie: Movie,
    region: tuple[int, int, int, int] | None = None,
    frames: tuple[int, int] | None = None,
) -> Movie:
    """Cut a movie to a region and a range of frames.

    Parameters
    ----------
    movie
        The movie, itself perhaps a selection.
    region
        x0, y0, width, height in pixels of the sensor; None keeps all.
    frames
        First frame and one past the last in numbers of the whole recording; None keeps all.

    Raises
    ------
    ConfigurationError
        The region or the frames do not lie within the movie; both are said at once.
    """
    if region is None and frames is None:
        return movie
    count, height, width = movie.shape
    left, top = movie.origin_px
    x0, y0, w, h = region or (left, top, width, height)
    start, stop = frames or (movie.first_frame, movie.first_frame + count)
    mistakes = []
    if not (left <= x0 and top <= y0 and x0 + w <= left + width and y0 + h <= top + height) or (
        min(w, h) < 1
    ):
        mistakes.append(
            f"region x {x0} to {x0 + w}, y {y0} to {y0 + h} does not lie within the movie's "
            f"x {left} to {left + width}, y {top} to {top + height}: choose one inside"
        )
    if not movie.first_frame <= start < stop <= movie.first_frame + count:
        mistakes.append(
            f"frames {start} to {stop} do not lie within the movie's {movie.first_frame} to "
            f"{movie.first_frame + count}: choose a range inside"
        )
    if mistakes:
        raise ConfigurationError(*mistakes)
    return _Selection(movie, (x0, y0, w, h), (start, stop))


class _Selection(Movie):
    """Part of a movie; region and frames in the numbers of the whole recording."""

    def __init__(
        self, movie: Movie, region: tuple[int, int, int, int], frames: tuple[int, int]
    ) -> None:
        x0, y0, width, height = region
        start, stop = frames
        self._whole = movie
        self._region = region
        self._frames = frames
        self._skipped = start - movie.first_frame
        top, left = y0 - movie.origin_px[1], x0 - movie.origin_px[0]
        self._window = np.s_[:, top : top + height, left : left + width]
        self.shape = (stop - start, height, width)
        self.dtype = movie.dtype
        self.metadata = movie.metadata
        self.path = movie.path
        self.paths = movie.paths
        self.notes = movie.notes
        self.missing_frames = movie.missing_frames
        cut = np.s_[self._skipped : self._skipped + stop - start]
        self.times_s = None if movie.times_s is None else movie.times_s[cut]
        self.numbers = None if movie.numbers is None else movie.numbers[cut]
        self.origin_px = (x0, y0)
        self.first_frame = start

    def frames(self, start: int, stop: int) -> Frames:
        check_range(start, stop, self)
        block = self._whole.frames(start + self._skipped, stop + self._skipped)
        # A copy frees the pixels outside the region instead of holding them by a view.
        return np.ascontiguousarray(block[self._window])

    def reopen(self) -> Movie:
        return _Selection(self._whole.reopen(), self._region, self._frames)

    def close(self) -> None:
        self._whole.close()
