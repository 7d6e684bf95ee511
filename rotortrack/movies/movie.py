"""The movie protocol and the movie in memory."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import MovieError
from rotortrack.movies.metadata import NOTHING, Metadata

Frames = NDArray[Any]
"""Raw counts of shape (frame, y, x) in the movie's own number type."""

NUMBER_TYPES = tuple(
    np.dtype(name) for name in ("uint8", "uint16", "uint32", "int16", "int32", "float32", "float64")
)


@runtime_checkable
class Movie(Protocol):
    """A stack of frames read block by block.

    A movie object belongs to one worker; another worker takes its own by `reopen`.

    Attributes
    ----------
    shape
        Frames, rows, columns.
    dtype
        Number type of the counts, native byte order.
    metadata
        What is known of the movie, each value with its origin.
    path
        The file, the first one of several, or None for a movie in memory.
    paths
        All files in the order of their frames; none for a movie in memory.
    notes
        How the files were understood, one sentence each.
    missing_frames
        Declared frames that cannot be read; 0 unless the file was salvaged.
    times_s
        Recorded time of each frame (s), or None where the file tells none.
    numbers
        Number of each frame when dropped ones are counted too, with gaps; None where
        `first_frame` plus the index is the number.
    origin_px
        x and y of the first pixel on the sensor.
    first_frame
        Number of the first frame in the whole recording.
    """

    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    metadata: Metadata
    path: Path | None
    paths: tuple[Path, ...]
    notes: tuple[str, ...]
    missing_frames: int
    times_s: NDArray[np.float64] | None
    numbers: NDArray[np.int64] | None
    origin_px: tuple[int, int]
    first_frame: int

    def frames(self, start: int, stop: int) -> Frames:
        """Read the frames `start` to `stop` (excluded), counted from this movie's own first.

        Raises
        ------
        MovieError
            The frames are not in the movie or cannot be read.
        """
        ...

    def reopen(self) -> Movie:
        """Give the same movie with a file handle of its own."""
        ...

    def close(self) -> None:
        """Release the file."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def check_range(start: int, stop: int, movie: Movie) -> None:
    """Refuse frame numbers that `movie` does not have."""
    if not 0 <= start <= stop <= movie.shape[0]:
        raise MovieError(
            f"frames {start} to {stop} of {movie.path or 'a movie in memory'} are asked for, but "
            f"it has {movie.shape[0]}: ask for frames within it"
        )


class ArrayMovie(Movie):
    """A movie in memory.

    Parameters
    ----------
    counts
        Array of shape (frame, y, x) of one of `NUMBER_TYPES`, any byte order.
    metadata
        What is known of it.

    Raises
    ------
    MovieError
        The array has another shape or number type, or no pixels.

    Examples
    --------
    >>> import numpy as np
    >>> import rotortrack as rt
    >>> movie = rt.ArrayMovie(np.zeros((10, 32, 48), np.uint16))
    >>> movie.shape
    (10, 32, 48)
    >>> movie.frames(2, 5).shape
    (3, 32, 48)
    """

    def __init__(self, counts: Frames, metadata: Metadata = NOTHING) -> None:
        if counts.ndim != 3 or 0 in counts.shape:
            raise MovieError(
                f"an array of shape {counts.shape} is not a movie: give frames, rows and columns, "
                "at least one of each"
            )
        self.dtype = counts.dtype.newbyteorder("=")
        if self.dtype not in NUMBER_TYPES:
            raise MovieError(
                f"an array of {counts.dtype.name} is not a movie: convert it to one of "
                f"{', '.join(kind.name for kind in NUMBER_TYPES)}"
            )
        self._counts = counts.astype(self.dtype, copy=False)
        self.shape = (counts.shape[0], counts.shape[1], counts.shape[2])
        self.metadata = metadata
        self.path = None
        self.paths = ()
        self.notes = ()
        self.missing_frames = 0
        self.times_s = None
        self.numbers = None
        self.origin_px = (0, 0)
        self.first_frame = 0

    def frames(self, start: int, stop: int) -> Frames:
        """Give a view of the frames."""
        check_range(start, stop, self)
        return self._counts[start:stop]

    def reopen(self) -> ArrayMovie:
        """Give itself: reading memory needs no handle."""
        return self
