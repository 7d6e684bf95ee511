"""TIFF movies of all usual forms, opened by content and read block by block."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from rotortrack.errors import MetadataWarning, MovieError, RotortrackWarning
from rotortrack.movies.descriptions import Claim, read_descriptions
from rotortrack.movies.directories import Directories, read_directories
from rotortrack.movies.handle import Handle
from rotortrack.movies.metadata import Metadata, clean
from rotortrack.movies.movie import NUMBER_TYPES, Frames, Movie, check_range

# What tifffile would log is said by our own errors and warnings, once and in plain words.
logging.getLogger("tifffile").addHandler(logging.NullHandler())
logging.getLogger("tifffile").propagate = False

_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_MOST_PIXELS = 2**28
_COPY_AGAIN = "copy it again from where it was recorded"


@dataclass(frozen=True)
class _Layout:
    """Where and how the frames are stored.

    Attributes
    ----------
    shape, stored
        Frames, rows, columns; number type with the byte order of the file.
    offsets, counts
        Place and length in bytes of each stored piece, shape (frame, piece).
    decode
        Turns the bytes of one piece into pixels; None where a frame is one piece of plain bytes.
    """

    shape: tuple[int, int, int]
    stored: np.dtype[Any]
    offsets: NDArray[np.int64]
    counts: NDArray[np.int64]
    decode: Callable[..., Any] | None
    tables: bytes | None


def open_movie(path: Path) -> Movie:
    """Open a TIFF movie: plain, BigTIFF, ImageJ, OME, Micro-Manager, compressed or not.

    The number of frames is taken from the pages, the description and the size of the file, which
    must agree. Exactly one axis besides y and x may be longer than 1; it is taken as time, whatever
    its name.

    Parameters
    ----------
    path
        The file; its name and ending do not matter.

    Raises
    ------
    MovieError
        The file is missing, empty, no TIFF, damaged, cut short (declared and readable frames are
        said), in colour, of several long axes, or of a number type or compression not read.
    """
    path = Path(path)
    _check_magic(path)
    with _one_sentence(path, "opened"):
        handle = Handle(path)
        try:
            layout, metadata = _read_layout(path, handle)
            movie = TiffMovie(path, handle, layout, metadata)
            if layout.decode is not None:
                movie.frames(0, 1)  # says now, not in an hour, that a codec is missing
        except BaseException:
            handle.close()
            raise
    return movie


class TiffMovie(Movie):
    """A TIFF movie; made by `open_movie`. Reading costs one system call a run of frames."""

    def __init__(self, path: Path, handle: Handle, layout: _Layout, metadata: Metadata) -> None:
        self.path: Path = path
        self.shape = layout.shape
        self.dtype = layout.stored.newbyteorder("=")
        self.metadata = metadata
        self.origin_px = (0, 0)
        self.first_frame = 0
        self._handle = handle
        self._layout = layout

    def __reduce__(self) -> tuple[Callable[[Path], Movie], tuple[Path]]:
        # A worker process opens the file itself: handles do not survive the way there.
        return open_movie, (self.path,)

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
            with _one_sentence(self.path, f"read at frame {index}"):
                self._decode(index, block[index - start])
        return block

    def reopen(self) -> TiffMovie:
        """Give the same movie with a file handle of its own; the index is shared."""
        with _one_sentence(self.path, "opened"):
            return TiffMovie(self.path, Handle(self.path), self._layout, self.metadata)

    def close(self) -> None:
        """Close the file."""
        self._handle.close()

    def _read_plain(self, start: int, block: Frames) -> None:
        """Fill `block` with frames of plain bytes, one read for each run without gaps."""
        size = block[0].nbytes if len(block) else 0
        places = self._layout.offsets[start : start + len(block), 0]
        breaks = np.flatnonzero(np.diff(places) != size) + 1
        buffer = block.reshape(-1).view(np.uint8).data
        for first, last in zip([0, *breaks], [*breaks, len(block)], strict=True):
            part = buffer[int(first) * size : int(last) * size]
            with _one_sentence(self.path, f"read at frame {start + int(first)}"):
                got = self._handle.read_into(part, int(places[first]) if len(places) else 0)
            if got < len(part):
                raise MovieError(
                    f"{self.path} became shorter while it was read and ends in frame "
                    f"{start + int(first) + got // size}: {_COPY_AGAIN}"
                )

    def _decode(self, index: int, frame: Frames) -> None:
        """Decode one frame piece by piece."""
        decode, tables = self._layout.decode, self._layout.tables
        assert decode is not None
        for piece, (place, count) in enumerate(
            zip(self._layout.offsets[index], self._layout.counts[index], strict=True)
        ):
            # Compression does not grow data by much: a longer piece is a damaged length, and
            # decoding it could fill the memory.
            if not 0 < count <= 2 * frame.nbytes + 65536:
                raise MovieError(
                    f"{self.path} is damaged: frame {index} has a piece of {count} bytes; "
                    f"{_COPY_AGAIN}"
                )
            data = self._handle.read(int(count), int(place))
            pixels, (_, _, top, left, _), _ = decode(data, piece, jpegtables=tables)
            height, width = frame.shape
            part = pixels[0, : height - top, : width - left, 0]
            frame[top : top + part.shape[0], left : left + part.shape[1]] = part


def _check_magic(path: Path) -> None:
    """Refuse what is not a TIFF file, by its first bytes."""
    if not path.exists():
        raise MovieError(f"{path} does not exist: check the name")
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "not a regular file"
        raise MovieError(f"{path} is {kind}: name one movie file")
    with _one_sentence(path, "opened"), path.open("rb") as file:
        magic = file.read(4)
    if not magic:
        raise MovieError(f"{path} is empty (0 bytes): {_COPY_AGAIN}")
    if magic not in _MAGIC:
        raise MovieError(
            f"{path} is not a TIFF file, whatever its name says: save the movie as TIFF"
        )


def _read_layout(path: Path, handle: Handle) -> tuple[_Layout, Metadata]:
    with tifffile.TiffFile(path) as tif:
        directories = read_directories(
            handle,
            path,
            byte_order=tif.byteorder,
            big=tif.is_bigtiff,
            first_offset=tif.pages.first.offset,
        )
        if not len(directories.offsets):
            raise MovieError(f"{path} holds no frames that can be read: {_COPY_AGAIN}")
        page = tif.pages[directories.first_page]
        if not isinstance(page, tifffile.TiffPage):
            page = page.aspage()
        stored = _number_type(path, page, tif.byteorder)
        claim, metadata = read_descriptions(tif, page, path, len(directories.offsets))
        _check_axes(path, claim)
        plain = _plain_pages(page, directories)
        if plain:
            size = page.imagewidth * page.imagelength * stored.itemsize
            offsets, declared = _plain_frames(path, handle, directories, claim, size)
            counts = np.full_like(offsets, size)
        else:
            offsets, counts = directories.offsets, directories.counts
            declared = _declared(claim, directories)
        _check_length(path, handle, offsets, counts, declared, claim)
        layout = _Layout(
            shape=(len(offsets), page.imagelength, page.imagewidth),
            stored=stored,
            offsets=offsets,
            counts=counts,
            decode=None if plain else page.decode,
            tables=page.jpegtables,
        )
    return layout, metadata


def _number_type(path: Path, page: tifffile.TiffPage, byte_order: str) -> np.dtype[Any]:
    """Check that the page is one plane of grey values of a supported type."""
    if page.samplesperpixel != 1:
        raise MovieError(
            f"{path} is a colour image ({page.samplesperpixel} samples a pixel): save one channel "
            "as a grey-scale stack (ImageJ: Image > Color > Split Channels)"
        )
    if page.imagedepth != 1:
        raise MovieError(f"{path} stores volumes, not frames: save each plane as its own page")
    if page.dtype is None or page.dtype not in NUMBER_TYPES:
        kind = page.dtype.name if page.dtype is not None else f"{page.bitspersample}-bit"
        raise MovieError(
            f"{path} holds {kind} pixels: save it as one of "
            f"{', '.join(known.name for known in NUMBER_TYPES)}"
        )
    width, height = page.imagewidth, page.imagelength
    if not 0 < width * height <= _MOST_PIXELS:
        raise MovieError(
            f"{path} declares frames of {width} x {height} pixels, which no camera has: "
            f"{_COPY_AGAIN}"
        )
    return page.dtype.newbyteorder("<" if byte_order == "<" else ">")


def _check_axes(path: Path, claim: Claim | None) -> None:
    if claim is None:
        return
    if len(claim.files) > 1:
        raise MovieError(
            f"{path} is one of {len(claim.files)} files of a movie of {claim.frames} frames: join "
            "them into one file (ImageJ: File > Import > Bio-Formats, then save as TIFF)"
        )
    if len(claim.long_axes) > 1:
        axes = ", ".join(f"{axis} = {length}" for axis, length in claim.long_axes.items())
        raise MovieError(
            f"{path} has more than one axis besides y and x ({clean(axes)}): save one channel and "
            "plane over time as a stack of its own (ImageJ: Image > Duplicate)"
        )


def _plain_pages(page: tifffile.TiffPage, directories: Directories) -> bool:
    """Whether every page is one run of plain bytes."""
    if not page.is_final:
        return False
    offsets, counts = directories.offsets, directories.counts
    return offsets.shape[1] == 1 or bool(np.all(offsets[:, :-1] + counts[:, :-1] == offsets[:, 1:]))


def _declared(claim: Claim | None, directories: Directories) -> int:
    """Count the frames that the file should have by its pages and its description."""
    pages_and_next = len(directories.offsets) + (directories.next_offset != 0)
    return max(claim.frames if claim else 0, pages_and_next)


def _plain_frames(
    path: Path, handle: Handle, directories: Directories, claim: Claim | None, size: int
) -> tuple[NDArray[np.int64], int]:
    """Find frames of `size` plain bytes, also those that no directory names.

    ImageJ writes one directory above 4 GB, and a cut file may have lost its last directories
    while the pixels are all there. Frames are then taken to follow the first one without gaps, but
    only where nothing speaks against it: the pages that are there do so, and the next directory,
    if one was named, lies behind the last frame.

    Returns
    -------
    offsets
        Place of each frame; at most one frame that the file does not hold is listed.
    declared
        How many frames the file should have.
    """
    offsets = directories.offsets[:, :1]
    declared = _declared(claim, directories)
    pages, first = len(offsets), int(offsets[0, 0])
    broken = directories.next_offset != 0
    room = (directories.next_offset - first) // size
    if broken and not (claim and claim.frames > pages):
        declared = max(declared, room)
    believed = (
        room >= declared if broken else pages == 1 and claim is not None and claim.one_directory
    )
    if declared == pages or not believed or np.any(np.diff(offsets[:, 0]) != size):
        return offsets, declared
    readable = min(declared, (handle.size - first) // size)
    if broken and readable == declared:
        warnings.warn(
            f"{path} has lost the directories of its last pages, but all {declared} frames are "
            f"there and are used: {_COPY_AGAIN} if you can",
            MetadataWarning,
            stacklevel=2,
        )
    listed = max(pages, min(declared, readable + 1))
    return (first + size * np.arange(listed, dtype=np.int64))[:, np.newaxis], declared


def _check_length(
    path: Path,
    handle: Handle,
    offsets: NDArray[np.int64],
    counts: NDArray[np.int64],
    declared: int,
    claim: Claim | None,
) -> None:
    """Compare the declared frames with those that lie wholly within the file."""
    if offsets.shape[1] == 0:
        raise MovieError(f"{path} is damaged: its pages name no pixels; {_COPY_AGAIN}")
    inside = np.all((offsets >= 0) & (offsets <= handle.size - counts), axis=1)
    readable = len(inside) if inside.all() else int(np.argmin(inside))
    if readable < declared:
        # Without a description that counts them, the pages tell of no more than the next one.
        what = (
            f"{declared} frames are declared by its {claim.source} description"
            if claim is not None and claim.frames == declared
            else f"at least {declared} frames are declared"
        )
        raise MovieError(f"{path} is cut short: {what}, {readable} can be read; {_COPY_AGAIN}")


@contextlib.contextmanager
def _one_sentence(path: Path, action: str) -> Iterator[None]:
    """Turn whatever a damaged file makes tifffile, a codec or the system raise into one error."""
    try:
        yield
    except (MovieError, RotortrackWarning):
        raise
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise MovieError(
            f"{path} cannot be {action} ({reason}): check that the file is there and readable"
        ) from error
    except Exception as error:
        text = clean(str(error)) or type(error).__name__
        if isinstance(error, ImportError) or "imagecodecs" in text:
            raise MovieError(
                f"{path} is compressed in a way that needs more codecs: install them with "
                "pip install 'rotortrack[codecs]'"
            ) from error
        raise MovieError(
            f"{path} is damaged and cannot be {action} ({text}): {_COPY_AGAIN}"
        ) from error
