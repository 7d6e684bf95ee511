"""One file, read at given places."""

from __future__ import annotations

import functools
import os
import threading
from pathlib import Path

_MOST_HOLES = 1000


class Handle:
    """A file opened for one reader.

    Reading names the place with each call instead of moving a shared position, so that two threads
    that share a handle by mistake still read the right bytes. Memory mapping is avoided on
    purpose: mapped pages count as the process's memory.

    Attributes
    ----------
    size
        Length of the file in bytes.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb", buffering=0)
        self._lock = threading.Lock()
        self.size = os.fstat(self._file.fileno()).st_size

    def read_into(self, buffer: memoryview, offset: int) -> int:
        """Fill `buffer` from `offset`; return how many bytes the file had."""
        done = 0
        while done < len(buffer):
            got = self._read_once(buffer[done:], offset + done)
            if got == 0:
                break
            done += got
        return done

    def read(self, size: int, offset: int) -> bytes:
        """Read up to `size` bytes at `offset`; fewer where the file ends."""
        size = max(0, min(size, self.size - offset))
        buffer = bytearray(size)
        return bytes(buffer[: self.read_into(memoryview(buffer), offset)])

    @functools.cached_property
    def stored(self) -> int:
        """Bytes of the file that are not holes."""
        if not hasattr(os, "SEEK_DATA"):
            return self.size
        total = place = 0
        for _ in range(_MOST_HOLES):
            try:
                start = os.lseek(self._file.fileno(), place, os.SEEK_DATA)
            except OSError:  # none but holes up to the end
                return total
            place = os.lseek(self._file.fileno(), start, os.SEEK_HOLE)
            total += place - start
        return total + self.size - place

    def close(self) -> None:
        """Close the file; closing twice does no harm."""
        self._file.close()

    def _read_once(self, buffer: memoryview, offset: int) -> int:
        if hasattr(os, "preadv"):
            return os.preadv(self._file.fileno(), [buffer], offset)
        with self._lock:
            self._file.seek(offset)
            return self._file.readinto(buffer) or 0
