"""What an OME-XML description says of the file that holds it.

The text is streamed through expat: a movie of 100 000 frames has as many elements, and no tree of
them is needed. Declarations of entities are refused, so a description cannot blow up.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from rotortrack.movies.metadata import Value, collect, nanometres, seconds

ORIGIN = "file (OME)"
_SQUARE = 0.01


@dataclass
class OmeImage:
    """One image of a description: its sizes, and how many planes lie in which file."""

    pixels: Mapping[str, str] = field(default_factory=dict)
    plane: Mapping[str, str] = field(default_factory=dict)
    files: Counter[str] = field(default_factory=Counter)

    def size(self, axis: str) -> int:
        """Length of the axis `C`, `Z` or `T`."""
        return _whole(self.pixels.get(f"Size{axis}"), 1)


@dataclass(frozen=True)
class Ome:
    """Images of a description, and the detector where it is named."""

    images: tuple[OmeImage, ...]
    detector: str | None

    def of_file(self, name: str) -> tuple[OmeImage, ...]:
        """Pick the images in the file `name`, or the first when the file was renamed."""
        named = tuple(image for image in self.images if name in image.files)
        unnamed = tuple(image for image in self.images if not image.files)
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


def read_ome(text: str) -> Ome | None:
    """Read an OME-XML description; None when it is not well-formed or declares entities."""
    reader = _Reader()
    parser = expat.ParserCreate()
    parser.StartElementHandler = reader.start
    parser.EntityDeclHandler = _refuse_entity
    try:
        # As bytes with a stated encoding: the text was decoded already, whatever its header says.
        parser.Parse(text.encode("utf-8"), True)
    except (expat.ExpatError, _EntityError):
        return None
    return Ome(tuple(reader.images), reader.detector)


class _EntityError(Exception):
    """The description declares an entity, which no writer of OME-XML does."""


def _refuse_entity(*_declaration: object) -> None:
    raise _EntityError


class _Reader:
    """Collects the few elements of interest."""

    def __init__(self) -> None:
        self.images: list[OmeImage] = []
        self.detector: str | None = None
        self._planes = 0

    def start(self, name: str, attributes: dict[str, str]) -> None:
        element = name.rpartition(":")[2]
        if element == "Detector" and self.detector is None:
            self.detector = attributes.get("Model") or attributes.get("Manufacturer")
        elif element == "Image":
            self.images.append(OmeImage())
        elif not self.images:
            return
        elif element == "Pixels":
            self.images[-1].pixels = attributes
        elif element == "TiffData":
            image = self.images[-1]
            every = image.size("C") * image.size("Z") * image.size("T")
            self._planes = _whole(attributes.get("PlaneCount"), 1 if "IFD" in attributes else every)
        elif element == "UUID" and "FileName" in attributes:
            self.images[-1].files[attributes["FileName"]] += self._planes
        elif element == "Plane" and not self.images[-1].plane:
            self.images[-1].plane = attributes


def _whole(text: str | None, absent: int) -> int:
    """Read a count; what is no positive number of sensible length counts as absent."""
    if text is None or not text.isdecimal() or len(text) > 12:
        return absent
    return max(int(text), 1)
