"""The bytes of a text table, whatever it is packed and encoded with: gzip by ending, UTF-16."""

from __future__ import annotations

import codecs
import contextlib
import gzip
import io
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

from rotortrack.errors import TableError

_CHUNK_BYTES = 1 << 18

_MOST_EXPANSION = 200
"""Gzip packs tables of measured numbers three to one; the most orderly ones stay below this."""

_HARMLESS_BYTES = 64_000_000
"""So much may come out of however small a file."""


def open_bytes(path: Path) -> IO[bytes]:
    """Open a table: unpacked where its name ends in ``.gz``, as UTF-8 where it is UTF-16.

    Spreadsheets call UTF-16 "Unicode text"; its byte order mark tells it.

    Raises
    ------
    TableError
        While reading: the file expands as no table does.
    """
    stream: io.BufferedReader = path.open("rb")
    if path.suffix.lower() == ".gz":
        stream = io.BufferedReader(_Unpacked(stream, path), _CHUNK_BYTES)
    try:
        if stream.peek(2)[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
            return io.BufferedReader(_Recoded(stream), _CHUNK_BYTES)
    except BaseException:
        stream.close()
        raise
    return stream


@contextlib.contextmanager
def create_bytes(path: Path) -> Iterator[IO[bytes]]:
    """Create a table, plain or gzip-compressed by its ending, the same bytes at every time."""
    with path.open("wb") as file:
        if path.suffix.lower() != ".gz":
            yield file
            return
        with gzip.GzipFile("", "wb", fileobj=file, compresslevel=4, mtime=0) as packed:
            yield cast("IO[bytes]", packed)


class _Readable(io.RawIOBase):
    """A stream made from another one, which it closes."""

    def __init__(self, source: IO[bytes]) -> None:
        super().__init__()
        self._source = source

    def readable(self) -> bool:
        return True

    def close(self) -> None:
        self._source.close()
        super().close()


class _Unpacked(_Readable):
    """Gunzips, and stops where far more comes out than tables of numbers can hold."""

    def __init__(self, source: IO[bytes], path: Path) -> None:
        super().__init__(source)
        self._path = path
        self._unpacked = gzip.GzipFile(fileobj=source, mode="rb")
        self._given = 0

    def readinto(self, buffer: Any) -> int:
        count = self._unpacked.readinto(buffer)
        self._given += count
        if self._given > max(_HARMLESS_BYTES, _MOST_EXPANSION * self._source.tell()):
            raise TableError(
                f"{self._path} expands to more than {_MOST_EXPANSION} times its size, as no table "
                "of measurements does: if it is one, unpack it with gunzip and give the .csv"
            )
        return count


class _Recoded(_Readable):
    """Turns UTF-16 into UTF-8, piece by piece."""

    def __init__(self, source: IO[bytes]) -> None:
        super().__init__(source)
        self._decoder = codecs.getincrementaldecoder("utf-16")()
        self._ready = memoryview(b"")

    def readinto(self, buffer: Any) -> int:
        while not self._ready:
            piece = self._source.read(_CHUNK_BYTES)
            text = self._decoder.decode(piece, final=not piece)
            self._ready = memoryview(text.encode("utf-8"))
            if not piece and not self._ready:
                return 0
        count = min(len(buffer), len(self._ready))
        buffer[:count] = self._ready[:count]
        self._ready = self._ready[count:]
        return count
