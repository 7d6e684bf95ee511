"""A recording that is spread over several files."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Sequence

import numpy as np

from rotortrack.movies.facts import Facts
from rotortrack.movies.handle import Handle
from rotortrack.movies.layout import StoredFile
from rotortrack.movies.movie import Frames, Movie, check_range
from rotortrack.movies.tiff_movie import Again, TiffMovie
from rotortrack.movies.wording import one_sentence

# An image-per-file recording has thousands of files, and a process may open about a thousand.
_MOST_OPEN = 4


class SeriesMovie(Movie):
    """Several files as one movie; made by `open_movie`. A few files are open at a time.

    Parameters
    ----------
    files
        The files with frames, in their order, all of one frame size and number type.
    facts
        What is known of the recording.
    again
        Opens the same movie in another process.
    """

    def __init__(self, files: Sequence[StoredFile], facts: Facts, again: Again) -> None:
        first = files[0]
        self._files = tuple(files)
        self._facts = facts
        self._again = again
        self._starts = np.cumsum([0, *(file.layout.shape[0] for file in files)])
        self._open: OrderedDict[int, TiffMovie] = OrderedDict()
        # A file that one thread reads must not be closed by another.
        self._lock = threading.Lock()
        self.path = first.path
        self.paths = tuple(file.path for file in files)
        self.shape = (int(self._starts[-1]), *first.layout.shape[1:])
        self.dtype = first.layout.stored.newbyteorder("=")
        self.metadata = facts.metadata
        self.notes = facts.notes
        self.missing_frames = facts.missing_frames
        self.times_s = facts.times_s
        self.numbers = facts.numbers
        self.origin_px = (0, 0)
        self.first_frame = 0

    def __reduce__(self) -> tuple[Again, tuple[()]]:
        return self._again, ()

    def frames(self, start: int, stop: int) -> Frames:
        """Read frames into a new array of native byte order."""
        check_range(start, stop, self)
        first, last = np.searchsorted(self._starts, (start, stop - 1), side="right") - 1
        with self._lock:
            if first >= last:
                return self._read(min(int(first), len(self._files) - 1), start, stop)
            block: Frames = np.empty((stop - start, *self.shape[1:]), self.dtype)
            for index in range(first, last + 1):
                begin = max(start, int(self._starts[index]))
                end = min(stop, int(self._starts[index + 1]))
                block[begin - start : end - start] = self._read(index, begin, end)
        return block

    def reopen(self) -> SeriesMovie:
        """Give the same movie with file handles of its own; the index is shared."""
        return SeriesMovie(self._files, self._facts, self._again)

    def close(self) -> None:
        """Close all files."""
        with self._lock:
            for movie in self._open.values():
                movie.close()
            self._open.clear()

    def _read(self, index: int, start: int, stop: int) -> Frames:
        """Read frames, counted from the first of the recording, of one file."""
        movie = self._open.get(index)
        if movie is None:
            if len(self._open) == _MOST_OPEN:
                self._open.popitem(last=False)[1].close()
            file = self._files[index]
            with one_sentence(file.path, "opened"):
                movie = TiffMovie(
                    file,
                    Handle(file.path),
                    self._facts,
                    self._again,
                    first_frame=int(self._starts[index]),
                )
            self._open[index] = movie
        self._open.move_to_end(index)
        return movie.frames(start - movie.first_frame, stop - movie.first_frame)
