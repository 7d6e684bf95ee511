"""Where and how the planes of one TIFF file are stored, and how many of them there are.

The number of planes is taken from the pages, the description and the size of the file, which must
agree. Places that follow one another are kept as a range, so that a file that claims a billion
planes costs no memory.
"""

from __future__ import annotations

import dataclasses
import logging
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from rotortrack.errors import MetadataWarning, MovieError, SalvageWarning
from rotortrack.movies.codecs import Decode, decoder
from rotortrack.movies.descriptions import Claim, read_descriptions
from rotortrack.movies.directories import Directories, read_directories
from rotortrack.movies.handle import Handle
from rotortrack.movies.metadata import NOTHING, Metadata
from rotortrack.movies.movie import NUMBER_TYPES
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.times import MM_ORIGIN, OME_ORIGIN, read_elapsed_s
from rotortrack.movies.wording import COPY_AGAIN, one_sentence

# What tifffile would log is said by our own errors and warnings, once and in plain words.
logging.getLogger("tifffile").addHandler(logging.NullHandler())
logging.getLogger("tifffile").propagate = False

_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")

Places = NDArray[np.int64] | range


@dataclass(frozen=True)
class Layout:
    """Where and how planes are stored.

    Attributes
    ----------
    shape, stored
        Planes, rows, columns; number type with the byte order of the file.
    offsets
        Place of each plane that is one run of plain bytes, shape (plane,); otherwise of each
        stored piece, shape (plane, piece).
    counts
        Length in bytes of each piece; None for plain bytes.
    decode
        Turns the bytes of one piece into pixels; None for plain bytes.
    tables
        JPEG tables that all pieces share.
    """

    shape: tuple[int, int, int]
    stored: np.dtype[Any]
    offsets: Places
    counts: NDArray[np.int64] | None
    decode: Decode | None
    tables: bytes | None

    def pick(self, planes: range) -> Layout:
        """Keep some of the planes."""
        if planes == range(self.shape[0]):
            return self
        cut = slice(planes.start, planes.stop, planes.step)
        return dataclasses.replace(
            self,
            shape=(len(planes), *self.shape[1:]),
            offsets=self.offsets[cut],
            counts=None if self.counts is None else self.counts[cut],
        )


@dataclass(frozen=True)
class StoredFile:
    """One file as it was understood.

    Attributes
    ----------
    path, layout
        The file, and where its planes lie.
    claim
        What its description declares, or None.
    metadata
        What it says of the recording.
    declared
        How many planes it should have; more than its layout had where it was salvaged.
    times_s
        Recorded time of each plane (s), NaN where a plane has none, or None where the file tells
        none.
    times_origin
        Where the times come from.
    """

    path: Path
    layout: Layout
    claim: Claim | None
    metadata: Metadata
    declared: int
    times_s: NDArray[np.float64] | None = None
    times_origin: str = ""

    @property
    def planes(self) -> int:
        """How many planes can be read."""
        return self.layout.shape[0]

    @property
    def missing(self) -> int:
        """How many declared planes cannot be read."""
        return self.declared - self.planes

    def timed(self, times_s: NDArray[np.float64] | None, origin: str) -> StoredFile:
        """Add the times of the planes where there are enough."""
        if times_s is None or len(times_s) < self.planes:
            return self
        return dataclasses.replace(self, times_s=times_s[: self.planes], times_origin=origin)

    def pick(self, planes: range) -> StoredFile:
        """Keep some of the planes."""
        cut = slice(planes.start, planes.stop, planes.step)
        return dataclasses.replace(
            self,
            layout=self.layout.pick(planes),
            declared=len(planes),
            times_s=None if self.times_s is None else self.times_s[cut],
        )


def open_file(
    path: Path,
    options: MovieOptions,
    *,
    claim: Claim | None = None,
    alone: bool = True,
    name: str | None = None,
) -> StoredFile:
    """Open one file, read where its planes lie, and close it.

    Parameters
    ----------
    path
        The file.
    options
        `max_frame_megapixels` bounds the frames, `salvage` accepts a file that is cut short.
    claim
        Stands for the file's own description, which is then not read.
    alone
        Whether a description that names no files counts the planes of this file alone.
    name
        File of whose planes the description is asked; its own when not given.

    Raises
    ------
    MovieError
        The file is missing, empty, no TIFF, damaged, cut short, in colour, or of a size, number
        type or compression that is not read.

    Warns
    -----
    SalvageWarning
        The file is cut short and was salvaged.
    MetadataWarning
        Directories of the last pages are lost, but all planes are there.
    """
    _check_magic(path)
    with one_sentence(path, "opened"):
        handle = Handle(path)
        try:
            return _read(path, handle, options, claim, alone, name or path.name)
        finally:
            handle.close()


def _check_magic(path: Path) -> None:
    """Refuse what is not a TIFF file, by its first bytes."""
    if not path.exists():
        raise MovieError(f"{path} does not exist: check the name")
    if not path.is_file():
        if path.is_dir():
            raise MovieError(
                f"{path} is a folder: name its files in their order, such as $(ls -v {path}/*.tif)"
            )
        raise MovieError(f"{path} is not a regular file: name one movie file")
    with one_sentence(path, "opened"), path.open("rb") as file:
        magic = file.read(4)
    if not magic:
        raise MovieError(f"{path} is empty (0 bytes): {COPY_AGAIN}")
    if magic not in _MAGIC:
        raise MovieError(
            f"{path} is not a TIFF file, whatever its name says: save the movie as TIFF"
        )


def _read(
    path: Path,
    handle: Handle,
    options: MovieOptions,
    claim: Claim | None,
    alone: bool,
    name: str,
) -> StoredFile:
    directories = read_directories(handle, path)
    if not len(directories.offsets):
        raise MovieError(f"{path} is damaged and holds no frames that can be read: {COPY_AGAIN}")
    with tifffile.TiffFile(path) as tif:
        page = tif.pages[directories.first_page]
        if not isinstance(page, tifffile.TiffPage):
            page = page.aspage()
        stored = _number_type(path, page, tif.byteorder, options.max_frame_megapixels)
        metadata = NOTHING
        if claim is None:
            claim, metadata = read_descriptions(tif, page, name)
            if claim is not None and not alone and not claim.files:
                claim = dataclasses.replace(claim, here=0)
        size = page.imagewidth * page.imagelength * stored.itemsize
        offsets: Places
        counts = decode = None
        if _plain_pages(page, directories):
            offsets, declared = _plain_frames(path, handle, directories, claim, size)
            readable = _readable(handle, offsets, size)
        elif not directories.offsets.shape[1]:
            raise MovieError(f"{path} is damaged: its pages name no pixels; {COPY_AGAIN}")
        else:
            offsets, counts = directories.offsets, directories.counts
            decode = decoder(page, stored.itemsize)
            declared = _declared(claim, directories)
            readable = _readable(handle, offsets, counts)
        if page.compression == 1 and not isinstance(offsets, range):
            lengths = np.full(len(offsets), size) if counts is None else counts
            _check_overlap(path, offsets[:readable], lengths[:readable], directories.occupied)
        if readable < declared:
            _cut_short(path, readable, declared, claim, salvage=options.salvage)
        layout = Layout(
            shape=(len(offsets), page.imagelength, page.imagewidth),
            stored=stored,
            offsets=offsets,
            counts=counts,
            decode=decode,
            tables=page.jpegtables,
        )
    times_s, origin = read_elapsed_s(handle, directories.texts[:readable]), MM_ORIGIN
    if times_s is None and claim is not None and claim.here is None:
        times_s, origin = claim.times_s, OME_ORIGIN
    file = StoredFile(path, layout.pick(range(readable)), claim, metadata, declared)
    return file.timed(times_s, origin)


def _number_type(
    path: Path, page: tifffile.TiffPage, byte_order: str, max_megapixels: float
) -> np.dtype[Any]:
    """Check that the page is one plane of grey values of a supported type and size."""
    width, height = page.imagewidth, page.imagelength
    largest = max(width * height, page.tilewidth * page.tilelength)
    tiles = f" in tiles of {page.tilewidth} x {page.tilelength}" if page.is_tiled else ""
    if width * height == 0 or largest > max_megapixels * 1e6:
        raise MovieError(
            f"{path} declares frames of {width} x {height} pixels{tiles}, which is not within the "
            f"{max_megapixels:g} megapixels that are accepted: if the camera has them, give "
            f"--max-frame-megapixels, else {COPY_AGAIN}"
        )
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
    return page.dtype.newbyteorder("<" if byte_order == "<" else ">")


def _plain_pages(page: tifffile.TiffPage, directories: Directories) -> bool:
    """Whether every page is one run of plain bytes."""
    if not page.is_final:
        return False
    offsets, counts = directories.offsets, directories.counts
    if not offsets.shape[1]:
        return False
    return offsets.shape[1] == 1 or bool(np.all(offsets[:, :-1] + counts[:, :-1] == offsets[:, 1:]))


def _declared(claim: Claim | None, directories: Directories) -> int:
    """Count the planes that the file should have by its pages and its description."""
    pages_and_next = len(directories.offsets) + (directories.next_offset != 0)
    return max(claim.planes if claim else 0, pages_and_next)


def _plain_frames(
    path: Path, handle: Handle, directories: Directories, claim: Claim | None, size: int
) -> tuple[Places, int]:
    """Find frames of `size` plain bytes, also those that no directory names.

    ImageJ writes one directory above 4 GB, and a cut file may have lost its last directories
    while the pixels are all there. Frames are then taken to follow the first one without gaps, but
    only where nothing speaks against it: the pages that are there do so, and directories and texts
    lie behind the last frame.

    Returns
    -------
    offsets
        Place of each frame; at most one frame that the file does not hold is listed.
    declared
        How many frames the file should have.
    """
    offsets = directories.offsets[:, 0]
    declared = _declared(claim, directories)
    pages, first = len(offsets), int(offsets[0])
    broken = directories.next_offset != 0
    if np.any(np.diff(offsets) != size):
        return offsets, declared
    known = np.append(directories.occupied[:, 0], directories.texts_begin)
    end = min(directories.next_offset, known[known > offsets[-1]].min(initial=2**62))
    room = (int(end) - first) // size
    if broken and not (claim and claim.planes > pages):
        declared = max(declared, room)
    believed = (
        room >= declared if broken else pages == 1 and claim is not None and claim.one_directory
    )
    if declared == pages or not believed:
        return offsets, declared
    readable = min(declared, max(0, handle.size - first) // size)
    if broken and readable == declared:
        warnings.warn(
            f"{path} has lost the directories of its last pages, but all {declared} frames are "
            f"there and are used: {COPY_AGAIN} if you can",
            MetadataWarning,
            stacklevel=2,
        )
    listed = max(pages, min(declared, readable + 1))
    return range(first, first + listed * size, size), declared


def _readable(handle: Handle, offsets: Places, counts: NDArray[np.int64] | int) -> int:
    """Count the leading planes that lie wholly within the file."""
    if isinstance(offsets, range):
        assert isinstance(counts, int)
        return min(len(offsets), max(0, (handle.size - offsets.start) // counts))
    inside = ((offsets >= 0) & (offsets <= handle.size - counts)).reshape(len(offsets), -1)
    inside = np.all(inside, axis=1)
    return len(inside) if inside.all() else int(np.argmin(inside))


def _check_overlap(
    path: Path,
    offsets: NDArray[np.int64],
    lengths: NDArray[np.int64],
    occupied: NDArray[np.int64],
) -> None:
    """Refuse places of plain pixels that a damaged number made: no other program would notice.

    Pixels do not lie where directories lie, nor partly where other pixels lie; equal frames may
    share one place. Lengths of compressed pieces are not exact enough for this.
    """
    starts = np.concatenate([offsets.ravel(), occupied[:, 0]])
    ends = starts + np.concatenate([lengths.ravel(), occupied[:, 1]])
    order = np.lexsort((ends, starts))
    starts, ends = starts[order], ends[order]
    same = (starts[1:] == starts[:-1]) & (ends[1:] == ends[:-1])
    if np.any((starts[1:] < ends[:-1]) & ~same):
        raise MovieError(
            f"{path} is damaged: the places that it names for its frames overlap; {COPY_AGAIN}"
        )


def _cut_short(
    path: Path, readable: int, declared: int, claim: Claim | None, *, salvage: bool
) -> None:
    """Refuse a file that is cut short, or warn where it is salvaged."""
    # Without a description that counts them, the pages tell of no more than the next one.
    what = (
        f"{declared} frames are declared by its {claim.source} description"
        if claim is not None and claim.planes == declared
        else f"at least {declared} frames are declared"
    )
    if readable and salvage:
        warnings.warn(
            f"{path} is cut short: {what}, {readable} are used; {COPY_AGAIN} if you can",
            SalvageWarning,
            stacklevel=2,
        )
        return
    remedy = ", or read what is there with --salvage" if readable else ""
    raise MovieError(f"{path} is cut short: {what}, {readable} can be read; {COPY_AGAIN}{remedy}")
