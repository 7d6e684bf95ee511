"""TIFF movies of all usual forms, opened by content and read block by block."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

from rotortrack.errors import MovieError
from rotortrack.movies.handle import Handle
from rotortrack.movies.movie import Movie
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.recording import gather
from rotortrack.movies.series import SeriesMovie
from rotortrack.movies.tiff_movie import TiffMovie
from rotortrack.movies.wording import one_sentence


def open_movie(paths: Path | Sequence[Path], options: MovieOptions | None = None) -> Movie:
    """Open a TIFF movie: plain, BigTIFF, ImageJ, OME, Micro-Manager, compressed or not.

    The number of frames is taken from the pages, the description and the size of the file, which
    must agree. Exactly one axis besides y and x may be longer than 1; it is taken as time, whatever
    its name.

    Parameters
    ----------
    paths
        The file, whose name and ending do not matter, or several files in the order of their
        frames. One file of an OME or Micro-Manager set stands for the whole set.
    options
        `axes`, `channel` and `z_slice` say which planes are frames, `salvage` accepts a file that
        is cut short, `max_frame_megapixels` bounds the frames.

    Raises
    ------
    MovieError
        A file is missing, empty, no TIFF, damaged, cut short (declared and readable frames are
        said), in colour, of several long axes, or of a number type or compression not read; or
        several files are not one recording in its order.

    Warns
    -----
    SalvageWarning
        Frames are missing and the others are used.
    MetadataWarning
        The options contradict the file.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import rotortrack as rt
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "movie.tif"
    ...     rt.write_movie(path, np.zeros((10, 32, 48), np.uint16), shape=(10, 32, 48))
    ...     with rt.open_movie(path) as movie:
    ...         movie.shape
    (10, 32, 48)
    """
    given = (Path(paths),) if isinstance(paths, str | Path) else tuple(Path(path) for path in paths)
    if not given:
        raise MovieError("no movie file is named: give at least one")
    options = options or MovieOptions()
    again = functools.partial(open_movie, given, options)
    recording = gather(given, options)
    movie: Movie
    if len(recording.files) == 1:
        (file,) = recording.files
        with one_sentence(file.path, "opened"):
            movie = TiffMovie(file, Handle(file.path), recording.facts, again)
    else:
        movie = SeriesMovie(recording.files, recording.facts, again)
    if recording.files[0].layout.decode is not None:
        try:
            movie.frames(0, 1)  # says now, not in an hour, that a codec is missing
        except BaseException:
            movie.close()
            raise
    return movie
