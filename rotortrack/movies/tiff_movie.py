"""The movie of one TIFF file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rotortrack.errors import MovieError
from rotortrack.movies.facts import Facts
from rotortrack.movies.handle import Handle
from rotortrack.movies.layout import StoredFile
from rotortrack.movies.movie import Frames, Movie, check_range
from rotortrack.movies.wording import COPY_AGAIN, one_sentence

Again = Callable[[], Movie]
"""Opens the same movie from its files, also in another process."""


class TiffMovie(Movie):
    """A TIFF movie; made by `open_movie`. Reading costs one system call a run of frames.

    Parameters
    ----------
    file, handle
        The file, its planes being the frames, and its open handle.
    facts
        What is known of the recording.
    again
        Opens the same movie in another process.
    first_frame
        Number of its first frame in the recording.
    """

    def __init__(
        self,
        file: StoredFile,
        handle: Handle,
        facts: Facts,
        again: Again,
        *,
        first_frame: int = 0,
    ) -> None:
        self.path = file.path
        self.paths = (file.path,)
        self.shape = file.layout.shape
        self.dtype = file.layout.stored.newbyteorder("=")
        self.metadata = facts.metadata
        self.notes = facts.notes
        self.missing_frames = facts.missing_frames
        self.times_s = facts.times_s
        self.numbers = facts.numbers
        self.origin_px = (0, 0)
        self.first_frame = first_frame
        self._file = file
        self._layout = file.layout
        self._facts = facts
        self._handle = handle
        self._again = again

    def __reduce__(self) -> tuple[Again, tuple[()]]:
        # A worker process opens the file itself: handles do not survive the way there.
        return self._again, ()

    def frames(self, start: int, stop: int) -> Frames:
        """Read frames into a new array of native byte order."""
        check_range(start, stop, self)
        layout = self._layout
        block: Frames = np.empty((stop - start, *self.shape[1:]), self.dtype)
        if layout.decode is None:
            self._read_plain(start, block.view(layout.stored))
            if not layout.stored.isnative:
                block.byteswap(inplace=True)
            return block
        for index in range(start, stop):
            with one_sentence(
                self.path, f"read at frame {self.first_frame + index}", self._before(index)
            ):
                self._decode(index, block[index - start])
        return block

    def reopen(self) -> TiffMovie:
        """Give the same movie with a file handle of its own; the index is shared."""
        with one_sentence(self.path, "opened"):
            return TiffMovie(
                self._file,
                Handle(self.path),
                self._facts,
                self._again,
                first_frame=self.first_frame,
            )

    def close(self) -> None:
        """Close the file."""
        self._handle.close()

    def _before(self, index: int) -> str:
        """Say what can be done about the damaged frame `index`."""
        number = self.first_frame + index
        read = f"--frames 0 {number} reads what is before it, or " if number else ""
        return f"{read}{COPY_AGAIN}"

    def _read_plain(self, start: int, block: Frames) -> None:
        """Fill `block` with frames of plain bytes, one read for each run without gaps."""
        size = block[0].nbytes if len(block) else 0
        places = np.asarray(self._layout.offsets[start : start + len(block)], np.int64)
        breaks = np.flatnonzero(np.diff(places) != size) + 1
        buffer = block.reshape(-1).view(np.uint8).data
        for first, last in zip([0, *breaks], [*breaks, len(block)], strict=True):
            part = buffer[int(first) * size : int(last) * size]
            number = self.first_frame + start + int(first)
            with one_sentence(self.path, f"read at frame {number}"):
                got = self._handle.read_into(part, int(places[first]) if len(places) else 0)
            if got < len(part):
                raise MovieError(
                    f"{self.path} became shorter while it was read and ends in frame "
                    f"{number + got // size}: {COPY_AGAIN}"
                )

    def _decode(self, index: int, frame: Frames) -> None:
        """Decode one frame piece by piece."""
        decode, tables, counts = self._layout.decode, self._layout.tables, self._layout.counts
        assert decode is not None
        assert counts is not None
        assert not isinstance(self._layout.offsets, range)
        for piece, (place, count) in enumerate(
            zip(self._layout.offsets[index], counts[index], strict=True)
        ):
            # Compression does not grow data by much: a longer piece is a damaged length, and
            # decoding it could fill the memory.
            if not 0 < count <= 2 * frame.nbytes + 65536:
                raise ValueError(f"a piece of {count} bytes")
            data = self._handle.read(int(count), int(place))
            pixels, (_, _, top, left, _), _ = decode(data, piece, jpegtables=tables)
            height, width = frame.shape
            part = pixels[0, : height - top, : width - left, 0]
            frame[top : top + part.shape[0], left : left + part.shape[1]] = part
