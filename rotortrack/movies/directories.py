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
from rotortrack.movies.wording import COPY_AGAIN

MM_TAG = 51123
"""Tag of Micro-Manager's description of a page, JSON."""

_SUBFILE_TYPE = 254
_THUMBNAIL_OR_MASK = 1 | 4
_WIDTH, _HEIGHT = 256, 257
_ROWS_PER_STRIP = 278
# Tags that must agree between pages, with the value that an absent tag stands for.
_GEOMETRY = {
    _WIDTH: 0,
    _HEIGHT: 0,
    258: 1,  # bits per sample
    259: 1,  # compression
    266: 1,  # fill order
    277: 1,  # samples per pixel
    _ROWS_PER_STRIP: 2**32 - 1,
    317: 1,  # predictor
    322: 0,  # tile width
    323: 0,  # tile length
    339: 1,  # sample format
}
_OFFSETS, _TILE_OFFSETS = 273, 324
_COUNTS, _TILE_COUNTS = 279, 325
_WANTED = {_SUBFILE_TYPE, *_GEOMETRY, _OFFSETS, _TILE_OFFSETS, _COUNTS, _TILE_COUNTS, MM_TAG}
_INTEGERS = {1: "u1", 3: "u2", 4: "u4", 13: "u4", 16: "u8", 18: "u8"}
# One read holds any usual directory (classic: 85 tags); a longer one costs a second read.
_FIRST_READ = 1024
_MOST_TAGS = 4096
_MOST_OFFSET = 2**62
_MOST_STRIPS = 2**20
# Bytes of directories, and places of pixels, that need not be held against the size of the file:
# beyond them a hostile file lets its pages overlap.
_SPARE_BYTES = 2**22
_SPARE_PLACES = 2**21

# tifffile reads the tags of the first page as a whole, so that their lengths are checked before. An
# OME description of 100 000 frames has 50 MB; numbers become Python objects ten times their size.
_MOST_TEXT = 2**27
_MOST_NUMBERS = 2**24
_PARSED_TEXT = {MM_TAG}
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
_SIZES |= {16: 8, 17: 8, 18: 8}
_TEXTS = {1, 2, 7}


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
    texts
        Place and length in bytes of Micro-Manager's description of each page, shape (page, 2);
        no rows where a page has none.
    occupied
        Place and length in bytes of the header and of every directory, shape (directory, 2).
    texts_begin
        Where the first text or number of the first page stands behind its pixels; 0 when none does.
    """

    offsets: NDArray[np.int64]
    counts: NDArray[np.int64]
    first_page: int
    next_offset: int
    texts: NDArray[np.int64]
    occupied: NDArray[np.int64]
    texts_begin: int


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


def read_directories(handle: Handle, path: Path) -> Directories:
    """Walk the chain of directories as far as it can be read.

    Parameters
    ----------
    handle, path
        The open file, and its name for error messages.

    Raises
    ------
    MovieError
        The chain bites its tail, pages overlap, a page has another geometry than the first, or
        the first page holds more text than any program writes.
    """
    layout, place = _header(handle)
    offsets, counts, texts = array.array("q"), array.array("q"), array.array("q")
    occupied = array.array("q", [0, 16 if layout.big else 8])
    geometry: list[int] = []
    first_signature: list[_Entry | None] = []
    strips = pages = skipped = first_page = texts_begin = 0
    visited: set[int] = set()
    used = 0
    while place:
        if place in visited:
            raise MovieError(
                f"{path} is damaged: its page {pages + skipped} points back to an earlier page; "
                f"{COPY_AGAIN}"
            )
        visited.add(place)
        try:
            data, following = _directory(handle, layout, place)
            used += len(data)
            occupied.extend((place, len(data)))
            excess = max(used - _SPARE_BYTES, 16 * (len(offsets) - _SPARE_PLACES))
            if excess > 0 and excess > handle.stored:
                raise MovieError(f"{path} is damaged: its pages overlap; {COPY_AGAIN}")
            if not pages:
                _check_lengths(path, layout, data)
            fields = {
                tag: (kind, count, raw)
                for tag, kind, count, raw in struct.iter_unpack(layout.entry, data)
                if tag in _WANTED
            }
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
            texts_begin = _first_value_behind(layout, data, max(page_offsets, default=0))
        elif found != geometry or len(page_offsets) != strips:
            raise MovieError(_stray(path, pages, geometry, found))
        if len(page_counts) != strips:
            page_counts = [0] * strips
        offsets.extend(page_offsets)
        counts.extend(page_counts)
        if len(texts) == 2 * pages and MM_TAG in fields:
            texts.extend(_text(layout, fields[MM_TAG]))
        pages += 1
        place = following
    return Directories(
        offsets=np.frombuffer(offsets, np.int64).reshape(pages, strips),
        counts=np.frombuffer(counts, np.int64).reshape(pages, strips),
        first_page=first_page,
        next_offset=place,
        texts=np.frombuffer(texts if len(texts) == 2 * pages else b"", np.int64).reshape(-1, 2),
        occupied=np.frombuffer(occupied, np.int64).reshape(-1, 2),
        texts_begin=texts_begin,
    )


class _UnreadableError(Exception):
    """A directory is cut off or holds nonsense; the walk ends before it."""


def _header(handle: Handle) -> tuple[_Format, int]:
    """Read the byte order, the width of fields, and the place of the first directory."""
    data = handle.read(16, 0)
    order = "<" if data[:2] == b"II" else ">"
    big = len(data) == 16 and struct.unpack(order + "H", data[2:4]) == (43,)
    layout = _Format(order, big)
    at = 8 if big else 4
    size = struct.calcsize(layout.offset)
    (first,) = struct.unpack(layout.offset, data[at : at + size].ljust(size, b"\0"))
    return layout, first


def _check_lengths(path: Path, layout: _Format, data: bytes) -> None:
    """Refuse a directory whose values would fill the memory."""
    for tag, kind, count, _ in struct.iter_unpack(layout.entry, data):
        size = count * _SIZES.get(kind, 0)
        limit = _MOST_TEXT if kind in _TEXTS and tag not in _PARSED_TEXT else _MOST_NUMBERS
        if size > limit:
            raise MovieError(
                f"{path} declares {size} bytes of description (tag {tag}) in its first page, more "
                f"than the {limit} that are accepted: save it as a plain TIFF stack"
            )


def _first_value_behind(layout: _Format, data: bytes, place: int) -> int:
    """Find the nearest value of a directory behind `place`; 0 when there is none."""
    places = (
        struct.unpack(layout.offset, raw)[0]
        for _, kind, count, raw in struct.iter_unpack(layout.entry, data)
        if count * _SIZES.get(kind, 0) > len(raw)
    )
    return min((found for found in places if found > place), default=0)


def _directory(handle: Handle, layout: _Format, place: int) -> tuple[bytes, int]:
    """Read the entries of one directory and the place of the next."""
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
    (following,) = struct.unpack_from(layout.offset, data, end)
    return data[head:end], following


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
    found = {
        tag: _scalar(layout, field, absent)
        for field, (tag, absent) in zip(signature, _GEOMETRY.items(), strict=True)
    }
    # More rows than the page has, as where the tag is absent, mean one strip.
    found[_ROWS_PER_STRIP] = min(found[_ROWS_PER_STRIP], found[_HEIGHT])
    return [*found.values()]


def _text(layout: _Format, field: _Entry) -> tuple[int, ...]:
    """Take the place and the length of a text that is too long for the directory."""
    kind, count, raw = field
    (place,) = struct.unpack(layout.offset, raw)
    known = kind in _TEXTS and len(raw) < count <= _MOST_NUMBERS and place <= _MOST_OFFSET
    return (place, count) if known else ()


def _values(
    handle: Handle, layout: _Format, fields: Mapping[int, _Entry], tag: int, tile_tag: int
) -> list[int]:
    """Take the places or lengths of all strips or tiles of a page."""
    field = fields.get(tile_tag) or fields.get(tag)
    if field is None:
        return []
    kind, count, raw = field
    if kind not in _INTEGERS or count > _MOST_STRIPS:
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
