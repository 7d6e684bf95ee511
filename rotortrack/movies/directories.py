"""Where the pixels of each page of a TIFF file lie.

tifffile gives one Python object a page and takes the first page's geometry for all. A movie of
100 000 pages needs two integers a page instead, and a page of another size must be noticed, so the
chain of directories is walked here (TIFF 6.0 section 2; BigTIFF doubles the field widths). What a
page means (number type, compression) is left to tifffile.
"""

from __future__ import annotations

import array
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import MovieError
from rotortrack.movies.handle import Handle

_SUBFILE_TYPE = 254
_THUMBNAIL_OR_MASK = 1 | 4
_WIDTH, _HEIGHT = 256, 257
# Tags that must agree between pages, with the value that an absent tag stands for.
_GEOMETRY = {
    _WIDTH: 0,
    _HEIGHT: 0,
    258: 1,  # bits per sample
    259: 1,  # compression
    266: 1,  # fill order
    277: 1,  # samples per pixel
    278: 2**32 - 1,  # rows per strip
    317: 1,  # predictor
    322: 0,  # tile width
    323: 0,  # tile length
    339: 1,  # sample format
}
_OFFSETS, _TILE_OFFSETS = 273, 324
_COUNTS, _TILE_COUNTS = 279, 325
_WANTED = {_SUBFILE_TYPE, *_GEOMETRY, _OFFSETS, _TILE_OFFSETS, _COUNTS, _TILE_COUNTS}
_INTEGERS = {1: "u1", 3: "u2", 4: "u4", 13: "u4", 16: "u8", 18: "u8"}
# One read holds any usual directory (classic: 85 tags); a longer one costs a second read.
_FIRST_READ = 1024
_MOST_TAGS = 4096
_MOST_OFFSET = 2**62


@dataclass(frozen=True)
class Directories:
    """Pages of a file as arrays.

    Attributes
    ----------
    offsets, counts
        Place and length in bytes of each strip or tile, shape (page, strip); a count of 0 where
        the file does not say.
    first_page
        Index of the first page that is neither thumbnail nor mask.
    next_offset
        Where the directory after the last readable one should be; 0 when the chain ended well.
    """

    offsets: NDArray[np.int64]
    counts: NDArray[np.int64]
    first_page: int
    next_offset: int


@dataclass(frozen=True)
class _Format:
    """Field layout of classic or BigTIFF in one byte order."""

    order: str
    big: bool

    @property
    def count(self) -> str:
        return self.order + ("Q" if self.big else "H")

    @property
    def entry(self) -> str:
        return self.order + ("HHQ8s" if self.big else "HHI4s")

    @property
    def offset(self) -> str:
        return self.order + ("Q" if self.big else "I")


_Entry = tuple[int, int, bytes]


def read_directories(
    handle: Handle, path: Path, *, byte_order: str, big: bool, first_offset: int
) -> Directories:
    """Walk the chain of directories as far as it can be read.

    Parameters
    ----------
    handle, path
        The open file, and its name for error messages.
    byte_order
        ``<`` or ``>``.
    big
        Whether it is a BigTIFF.
    first_offset
        Place of the first directory.

    Raises
    ------
    MovieError
        The chain bites its tail, or a page has another geometry than the first.
    """
    layout = _Format(byte_order, big)
    offsets, counts = array.array("q"), array.array("q")
    geometry: list[int] = []
    first_signature: list[_Entry | None] = []
    strips = pages = skipped = first_page = 0
    visited: set[int] = set()
    place = first_offset
    while place:
        if place in visited:
            raise MovieError(
                f"{path} is damaged: its page {pages + skipped} points back to an earlier page; "
                "copy it again from where it was recorded"
            )
        visited.add(place)
        try:
            fields, following = _directory(handle, layout, place)
            kind = _scalar(layout, fields.get(_SUBFILE_TYPE), 0)
            if kind & _THUMBNAIL_OR_MASK:
                skipped += 1
                place = following
                continue
            signature = [fields.get(tag) for tag in _GEOMETRY]
            # Most pages repeat the first one to the byte, which spares their decoding.
            found = geometry if signature == first_signature else _geometry(layout, signature)
            page_offsets = _values(handle, layout, fields, _OFFSETS, _TILE_OFFSETS)
            page_counts = _values(handle, layout, fields, _COUNTS, _TILE_COUNTS)
        except _UnreadableError:
            break
        if not pages:
            geometry, strips, first_page = found, len(page_offsets), skipped
            first_signature = signature
        elif found != geometry or len(page_offsets) != strips:
            raise MovieError(_stray(path, pages, geometry, found))
        if len(page_counts) != strips:
            page_counts = [0] * strips
        offsets.extend(page_offsets)
        counts.extend(page_counts)
        pages += 1
        place = following
    return Directories(
        offsets=np.frombuffer(offsets, np.int64).reshape(pages, strips),
        counts=np.frombuffer(counts, np.int64).reshape(pages, strips),
        first_page=first_page,
        next_offset=place,
    )


class _UnreadableError(Exception):
    """A directory is cut off or holds nonsense; the walk ends before it."""


def _directory(handle: Handle, layout: _Format, place: int) -> tuple[Mapping[int, _Entry], int]:
    """Read the wanted fields of one directory and the place of the next."""
    head, entry = struct.calcsize(layout.count), struct.calcsize(layout.entry)
    data = handle.read(_FIRST_READ, place)
    if len(data) < head:
        raise _UnreadableError
    (tags,) = struct.unpack_from(layout.count, data)
    end = head + tags * entry
    size = end + struct.calcsize(layout.offset)
    if not 0 < tags <= _MOST_TAGS:
        raise _UnreadableError
    if len(data) < size:
        data = handle.read(size, place)
        if len(data) < size:
            raise _UnreadableError
    fields = {
        tag: (kind, count, raw)
        for tag, kind, count, raw in struct.iter_unpack(layout.entry, data[head:end])
        if tag in _WANTED
    }
    (following,) = struct.unpack_from(layout.offset, data, end)
    return fields, following


def _scalar(layout: _Format, field: _Entry | None, absent: int) -> int:
    """Take a number that stands in the directory itself."""
    if field is None:
        return absent
    kind, count, raw = field
    if kind not in _INTEGERS or count < 1:
        raise _UnreadableError
    dtype = _INTEGERS[kind]
    if count * int(dtype[1]) > len(raw):
        return -1  # many samples a pixel: refused by the reader of the first page
    return int.from_bytes(raw[: int(dtype[1])], "little" if layout.order == "<" else "big")


def _geometry(layout: _Format, signature: list[_Entry | None]) -> list[int]:
    return [
        _scalar(layout, field, absent)
        for field, absent in zip(signature, _GEOMETRY.values(), strict=True)
    ]


def _values(
    handle: Handle, layout: _Format, fields: Mapping[int, _Entry], tag: int, tile_tag: int
) -> list[int]:
    """Take the places or lengths of all strips or tiles of a page."""
    field = fields.get(tile_tag) or fields.get(tag)
    if field is None:
        return []
    kind, count, raw = field
    if kind not in _INTEGERS:
        raise _UnreadableError
    if count == 1:
        values = [_scalar(layout, field, 0)]
    else:
        dtype = np.dtype(layout.order + _INTEGERS[kind])
        size = count * dtype.itemsize
        if size > len(raw):
            (place,) = struct.unpack(layout.offset, raw)
            raw = handle.read(size, place)
            if len(raw) < size:
                raise _UnreadableError
        values = np.frombuffer(raw, dtype, count).tolist()
    if values and max(values) > _MOST_OFFSET:
        raise _UnreadableError
    return values


def _stray(path: Path, page: int, first: list[int], other: list[int]) -> str:
    tags = list(_GEOMETRY)
    sizes = [
        f"{found[tags.index(_WIDTH)]} x {found[tags.index(_HEIGHT)]} pixels"
        for found in (first, other)
    ]
    what = (
        f"has {sizes[1]}, the first {sizes[0]}"
        if sizes[0] != sizes[1]
        else "is stored in another number type or compression than the first"
    )
    return f"{path} is not one movie: its page {page} {what}; save the frames as one stack"
