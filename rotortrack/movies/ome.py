"""What an OME-XML description says of the file that holds it.

The text is streamed through expat: a movie of 100 000 frames has as many elements, and no tree of
them is needed. Declarations of entities are refused, so a description cannot blow up.
"""

from __future__ import annotations

import array
import functools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from rotortrack.movies.metadata import Value, collect, nanometres, seconds

ORIGIN = "file (OME)"
_SQUARE = 0.01
# More than any recording has; each costs memory.
_MOST_IMAGES = 10_000
_MOST_FILES = 100_000
_MOST_TIMED = 10_000_000


@dataclass
class OmeImage:
    """One image of a description: its sizes, and which planes lie in which file.

    Attributes
    ----------
    pixels, plane
        Attributes of the pixels and of the first plane.
    files
        Number of planes by name of file; the name is empty where the description gives none.
    first_planes
        Number of the first plane of each file, where the description numbers them.
    scrambled
        Whether planes lie in a file in another order than that of their numbers.
    """

    pixels: Mapping[str, str] = field(default_factory=dict)
    plane: Mapping[str, str] = field(default_factory=dict)
    files: Counter[str] = field(default_factory=Counter)
    first_planes: dict[str, int] = field(default_factory=dict)
    scrambled: bool = False
    _pages: dict[str, array.array[int]] = field(default_factory=dict)
    _lists_pages: bool = True
    _shifts: dict[str, int] = field(default_factory=dict)
    _timed: array.array[int] = field(default_factory=lambda: array.array("q"))
    _times_s: array.array[float] = field(default_factory=lambda: array.array("d"))

    def size(self, axis: str) -> int:
        """Length of the axis `C`, `Z` or `T`."""
        return _whole(self.pixels.get(f"Size{axis}"), 1)

    @property
    def order(self) -> str:
        """The axes C, Z and T from the fastest to the slowest."""
        order = self.pixels.get("DimensionOrder", "XYCZT")[2:]
        return order if sorted(order) == sorted("CZT") else "CZT"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the files in the order of their planes."""
        names = [name for name in self.files if name]
        if all(name in self.first_planes for name in names):
            names.sort(key=self.first_planes.__getitem__)
        return tuple(names)

    def add(self, name: str, block: _Block) -> None:
        """Take note of planes that lie in the file `name`."""
        self.files[name] += block.planes
        self._lists_pages &= block.lists_pages
        self._pages.setdefault(name, array.array("q")).extend((block.page, block.planes))
        if block.first is not None:
            shift = block.first - block.page
            self.scrambled |= self._shifts.setdefault(name, shift) != shift
            first = self.first_planes.get(name, block.first)
            self.first_planes[name] = min(first, block.first)

    @property
    def planned(self) -> int:
        """Number of planes by the lengths of the axes."""
        return self.size("C") * self.size("Z") * self.size("T")

    @functools.cached_property
    def recorded(self) -> int:
        """Number of pages that hold them; less where the description lists fewer."""
        # A lone page may be the first one alone.
        if not self._lists_pages or sum(self.files.values()) < 2:
            return self.planned
        return min(self.planned, sum(map(self.pages, self.files)))

    @property
    def shared(self) -> bool:
        """Whether several planes lie in one page, as where a channel skips frames."""
        return self.recorded < min(self.planned, sum(self.files.values()))

    def pages(self, name: str) -> int:
        """Count the pages that the planes in the file `name` take up."""
        if not self._lists_pages:
            return self.files[name]
        listed = self._pages.get(name, ())
        if len(listed) == 2:
            return self.files[name]
        starts, counts = np.array(listed, np.int64).reshape(-1, 2).T
        order = np.argsort(starts, kind="stable")
        starts, ends = starts[order], (starts + counts)[order]
        seen = np.maximum.accumulate(np.append(0, ends))[:-1]
        return int(np.maximum(0, ends - np.maximum(starts, seen)).sum())

    def number(self, first: Mapping[str, int]) -> int:
        """Give the number of a plane by its indices along C, Z and T."""
        return sum(index * self._strides[axis] for axis, index in first.items())

    def add_time(self, plane: Mapping[str, str]) -> None:
        """Take note of the time of a plane."""
        time_s = seconds(plane.get("DeltaT"), plane.get("DeltaTUnit", "s"))
        number = self.number({axis: _index(plane.get(f"The{axis}")) for axis in "CZT"})
        if time_s is not None and number < _MOST_TIMED:
            self._timed.append(number)
            self._times_s.append(time_s)

    def times_s(self) -> NDArray[np.float64] | None:
        """Give the time of each recorded plane by its number, NaN where a plane has none.

        None where no plane has one.
        """
        if not self._timed:
            return None
        numbers = np.array(self._timed, np.int64)
        there = numbers < self.recorded
        times_s = np.full(self.recorded, np.nan)
        times_s[numbers[there]] = np.array(self._times_s, np.float64)[there]
        return times_s

    @functools.cached_property
    def _strides(self) -> Mapping[str, int]:
        """How far planes that follow one another along each axis are apart in their numbers."""
        strides, stride = {}, 1
        for axis in self.order:
            strides[axis] = stride
            stride *= self.size(axis)
        return strides


@dataclass(frozen=True)
class _Block:
    """Planes that follow one another: how many, the number of the first, and its page."""

    planes: int
    first: int | None
    page: int
    lists_pages: bool


@dataclass(frozen=True)
class Ome:
    """Images of a description, and the detector and the file that describes all where named."""

    images: tuple[OmeImage, ...]
    detector: str | None
    main_file: str | None = None

    def of_file(self, name: str) -> tuple[OmeImage, ...]:
        """Pick the images in the file `name`, or the first when the file was renamed."""
        named = tuple(image for image in self.images if name in image.files)
        unnamed = tuple(image for image in self.images if not image.names)
        return named or unnamed or self.images[:1]

    def metadata(self) -> dict[str, Value]:
        """Read pixel size, frame interval, exposure and detector of the first image."""
        if not self.images:
            return {}
        pixels, plane = self.images[0].pixels, self.images[0].plane
        width = nanometres(pixels.get("PhysicalSizeX"), pixels.get("PhysicalSizeXUnit", "µm"))
        height = nanometres(
            pixels.get("PhysicalSizeY", pixels.get("PhysicalSizeX")),
            pixels.get("PhysicalSizeYUnit", pixels.get("PhysicalSizeXUnit", "µm")),
        )
        return collect(
            ORIGIN,
            pixel_size_nm=square(width, height),
            frame_interval_s=seconds(
                pixels.get("TimeIncrement"), pixels.get("TimeIncrementUnit", "s")
            ),
            exposure_s=seconds(plane.get("ExposureTime"), plane.get("ExposureTimeUnit", "s")),
            camera=self.detector,
        )


def square(width: float | None, height: float | None) -> float | None:
    """Give the size of a square pixel; None when it is not square within 1 %."""
    if width is None or height is None or abs(width - height) > _SQUARE * abs(width):
        return None
    return width


def join_times_s(images: Sequence[OmeImage]) -> NDArray[np.float64] | None:
    """Give the times of the planes of images that follow one another, as those of one image."""
    # Planes that share pages, or are in another order than their numbers, have no known place.
    if any(image.scrambled or image.shared for image in images):
        return None
    if sum(image.recorded for image in images) > _MOST_TIMED:
        return None
    parts = [image.times_s() for image in images]
    if all(part is None for part in parts):
        return None
    return np.concatenate(
        [
            np.full(image.recorded, np.nan) if part is None else part
            for image, part in zip(images, parts, strict=True)
        ]
    )


def read_ome(text: str) -> Ome | None:
    """Read an OME-XML description; None when it is not well-formed or declares entities."""
    reader = _Reader()
    parser = expat.ParserCreate()
    parser.StartElementHandler = reader.start
    parser.EntityDeclHandler = _refuse_entity
    try:
        # As bytes with a stated encoding: the text was decoded already, whatever its header says.
        parser.Parse(text.encode("utf-8"), True)
        reader.end_block()
    except (expat.ExpatError, _AbsurdError):
        return None
    return Ome(tuple(reader.images), reader.detector, reader.main_file)


class _AbsurdError(Exception):
    """The description holds what no writer of OME-XML writes, such as an entity."""


def _refuse_entity(*_declaration: object) -> None:
    raise _AbsurdError


class _Reader:
    """Collects the few elements of interest."""

    def __init__(self) -> None:
        self.images: list[OmeImage] = []
        self.detector: str | None = None
        self.main_file: str | None = None
        self._block: _Block | None = None
        self._name = ""

    def end_block(self) -> None:
        """Count the planes of the last block."""
        if self._block is None:
            return
        image = self.images[-1]
        image.add(self._name, self._block)
        if len(image.files) > _MOST_FILES:
            raise _AbsurdError
        self._block, self._name = None, ""

    def start(self, name: str, attributes: dict[str, str]) -> None:
        element = name.rpartition(":")[2]
        if element == "Detector" and self.detector is None:
            self.detector = attributes.get("Model") or attributes.get("Manufacturer")
        elif element == "BinaryOnly":
            self.main_file = attributes.get("MetadataFile")
        elif element == "Image":
            self.end_block()
            self.images.append(OmeImage())
            if len(self.images) > _MOST_IMAGES:
                raise _AbsurdError
        elif not self.images:
            return
        elif element == "Pixels":
            self.images[-1].pixels = attributes
        elif element == "TiffData":
            self.end_block()
            self._block = _block(self.images[-1], attributes)
        elif element == "UUID" and "FileName" in attributes:
            self._name = attributes["FileName"]
        elif element == "Plane":
            self.images[-1].add_time(attributes)
            if not self.images[-1].plane:
                self.images[-1].plane = attributes


def _block(image: OmeImage, attributes: Mapping[str, str]) -> _Block:
    every = image.size("C") * image.size("Z") * image.size("T")
    planes = _whole(attributes.get("PlaneCount"), 1 if "IFD" in attributes else every)
    first = {
        axis: _index(attributes[f"First{axis}"]) for axis in "CZT" if f"First{axis}" in attributes
    }
    return _Block(
        planes,
        image.number(first) if first else None,
        _index(attributes.get("IFD")),
        "IFD" in attributes,
    )


def _index(text: str | None) -> int:
    return int(text) if text is not None and text.isdecimal() and len(text) <= 12 else 0


def _whole(text: str | None, absent: int) -> int:
    """Read a count; what is no positive number of sensible length counts as absent."""
    if text is None or not text.isdecimal() or len(text) > 12:
        return absent
    return max(int(text), 1)
