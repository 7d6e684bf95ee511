"""What a TIFF file says of itself: how many frames along which axes, and its metadata.

Descriptions are claims. The number of pages and the size of the file are checked against them by
the reader.
"""

from __future__ import annotations

import dataclasses
import json
import math
import struct
import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from rotortrack.errors import MetadataWarning
from rotortrack.movies.directories import MM_TAG
from rotortrack.movies.metadata import Value, collect, merge, nanometres, seconds
from rotortrack.movies.ome import Ome, join_times_s, read_ome, square

_UNIT_OF_RESOLUTION = {3: "cm", 4: "mm", 5: "um"}
_STK_PLANES_TAG = 33629
_NDTIFF, _SUMMARY = 483729, 2355492  # marks in Micro-Manager's header
# Descriptions that become Python objects; OME-XML is streamed.
_LONGEST_OTHER = 2**22


@dataclass(frozen=True)
class Claim:
    """Frames that a description declares.

    Attributes
    ----------
    source
        Which description: `ImageJ`, `OME`, `tifffile` or `MetaMorph`.
    axes
        Lengths by axis name from the slowest to the fastest, those of a page left out; their
        product is the number of planes that the whole recording was planned to have.
    one_directory
        Whether this kind of file may hold all frames behind a single directory.
    recorded
        Number of planes that were recorded, where the description lists fewer than planned.
    images
        Number of planes of each image, where these are not of one size; no axes are named then.
    shared
        Whether several planes of the description are one stored plane.
    files
        Number of planes by name of the files over which the recording is spread, in its order.
    here
        Number of planes in this file where it is one of several, 0 where that is not known.
    main_file
        Name of the file whose description stands for this one's.
    alone
        What counts where that file is missing: another description of this file, if it has one.
    trailing
        Axes of a page.
    scrambled
        Whether planes are stored in another order than that of their numbers.
    times_s
        Time of each plane of the whole recording (s), NaN where a plane has none; None where none
        has one.
    """

    source: str
    axes: Mapping[str, int]
    one_directory: bool
    recorded: int | None = None
    images: tuple[int, ...] = ()
    shared: bool = False
    files: Mapping[str, int] = field(default_factory=dict)
    here: int | None = None
    main_file: str | None = None
    alone: Claim | None = None
    trailing: str = "YX"
    scrambled: bool = False
    times_s: NDArray[np.float64] | None = None

    @property
    def planes(self) -> int:
        """Number of planes that are declared to lie in this file."""
        if self.here is not None:
            return self.here
        return math.prod(self.axes.values()) if self.recorded is None else self.recorded

    @property
    def long_axes(self) -> dict[str, int]:
        """Axes that are longer than 1."""
        return {axis: length for axis, length in self.axes.items() if length > 1}


def read_descriptions(
    tif: tifffile.TiffFile, page: tifffile.TiffPage, name: str
) -> tuple[Claim | None, dict[str, Value]]:
    """Read all descriptions of an open file with its first page and its name.

    Returns
    -------
    claim
        The declared frames by the first description that declares any (OME, ImageJ, MetaMorph,
        tifffile), or None.
    metadata
        All values; OME wins over ImageJ over Micro-Manager's settings over plain TIFF tags.

    Warns
    -----
    MetadataWarning
        The OME description cannot be read.
    """
    ome = None
    if tif.is_ome:
        ome = read_ome(page.description)
        if ome is None:
            warnings.warn(
                f"{name}: its OME description is no whole XML and is not used: check the number of "
                "frames, and give --pixel-size-nm and --frame-interval-s",
                MetadataWarning,
                stacklevel=2,
            )
    imagej = (tif.imagej_metadata or {}) if len(page.description) <= _LONGEST_OTHER else {}
    claim = _ome_claim(ome, name)
    if claim is None or claim.main_file is not None:
        others = _imagej_claim(imagej) or _metamorph_claim(page) or _shaped_claim(page)
        claim = others if claim is None else dataclasses.replace(claim, alone=others)
    metadata = merge(
        _tag_metadata(page),
        _micromanager_metadata(tif, page),
        _imagej_metadata(page, imagej),
        ome.metadata() if ome else {},
    )
    return claim, metadata


def _ome_claim(ome: Ome | None, name: str) -> Claim | None:
    if ome is None:
        return None
    images = ome.of_file(name)
    if not images and ome.main_file is None:
        return None
    if not images:
        return Claim("OME", {}, one_directory=False, here=0, main_file=ome.main_file)
    image = images[0]
    sizes = {axis: image.size(axis) for axis in reversed(image.order)}
    alike = all(
        other.recorded == image.recorded and all(other.size(axis) == sizes[axis] for axis in sizes)
        for other in images
    )
    recorded = sum(other.recorded for other in images)
    files: Counter[str] = Counter()
    for other in images:
        files.update({file: other.pages(file) for file in other.names})
    return Claim(
        "OME",
        {"S": len(images), **sizes} if alike else {},
        one_directory=False,
        recorded=None if alike and recorded == len(images) * image.planned else recorded,
        images=() if alike else tuple(other.recorded for other in images),
        shared=any(other.shared for other in images),
        files=files,
        here=files.get(name, 0) if len(files) > 1 else None,
        scrambled=any(image.scrambled for image in images),
        times_s=join_times_s(images),
    )


def _imagej_claim(imagej: Mapping[str, Any]) -> Claim | None:
    keys = {"T": "frames", "Z": "slices", "C": "channels"}
    axes = {axis: _whole(imagej.get(key)) for axis, key in keys.items()}
    product = math.prod(axes.values())
    images = _whole(imagej.get("images"))
    if images > 1 and images != product and sum(length > 1 for length in axes.values()) < 2:
        # The number of images is what ImageJ itself trusts when it opens the file.
        axes = {"T": images}
    return Claim("ImageJ", axes, one_directory=True) if math.prod(axes.values()) > 1 else None


def _metamorph_claim(page: tifffile.TiffPage) -> Claim | None:
    tag = page.tags.get(_STK_PLANES_TAG) if page.is_stk else None
    return Claim("MetaMorph", {"T": int(tag.count)}, one_directory=True) if tag else None


def _shaped_claim(page: tifffile.TiffPage) -> Claim | None:
    """Read the shape that tifffile writes, ``{"shape": [60, 64, 96]}``."""
    text = page.shaped_description
    if text and len(text) > _LONGEST_OTHER:
        return None
    try:
        found = json.loads(text) if text and text.startswith("{") else {}
    except ValueError:
        return None
    shape = found.get("shape", []) if isinstance(found, dict) else []
    if not isinstance(shape, list) or not all(isinstance(n, int) and n > 0 for n in shape):
        return None
    leading = shape[:-2]
    names = found.get("axes")
    trailing = "YX"
    if not isinstance(names, str) or len(names) != len(shape) or len({*names}) < len(names):
        names = [f"axis {number}" for number in range(len(shape))]
    elif names[-2:] != "YX":
        trailing = names
    axes = dict(zip(names[: len(leading)], leading, strict=True))
    return Claim("tifffile", axes, one_directory=True, trailing=trailing) if leading else None


def _tag_metadata(page: tifffile.TiffPage) -> dict[str, Value]:
    """Read a pixel size in metric units; dots per inch describe a print and say nothing."""
    unit = _UNIT_OF_RESOLUTION.get(int(page.resolutionunit))
    size_nm = _pixel_size(page, unit) if unit else None
    return {
        **collect("file (TIFF resolution)", pixel_size_nm=size_nm),
        **collect("file (TIFF)", software=page.software),
    }


def _imagej_metadata(page: tifffile.TiffPage, imagej: Mapping[str, Any]) -> dict[str, Value]:
    unit = imagej.get("unit")
    return collect(
        "file (ImageJ)",
        pixel_size_nm=_pixel_size(page, unit) if unit else None,
        frame_interval_s=seconds(imagej.get("finterval"), imagej.get("tunit", "s")),
    )


def _pixel_size(page: tifffile.TiffPage, unit: object) -> float | None:
    """Read the size of a pixel in nm from the resolution tags, which count pixels a unit."""
    sizes = []
    for name in ("XResolution", "YResolution"):
        tag = page.tags.get(name)
        if tag is None or not isinstance(tag.value, tuple) or not all(tag.value):
            return None
        pixels, units = tag.value
        sizes.append(nanometres(units / pixels, unit))
    return square(*sizes)


def _micromanager_metadata(tif: tifffile.TiffFile, page: tifffile.TiffPage) -> dict[str, Value]:
    if not tif.is_micromanager:
        return {}
    fields = _micromanager_fields(page)
    summary = _micromanager_summary(tif)

    def field(*names: str) -> object:
        for source in (fields, summary):
            for name in names:
                value = source.get(name)
                # Version 2 gamma wraps each value: {"PropVal": 0.11}.
                value = value.get("PropVal") if isinstance(value, dict) else value
                if value not in (None, ""):
                    return value
        return None

    return collect(
        "file (Micro-Manager)",
        pixel_size_nm=nanometres(field("PixelSizeUm", "PixelSize_um"), "um"),
        frame_interval_s=seconds(field("Interval_ms"), "ms"),
        exposure_s=seconds(field("Exposure-ms", "Exposure"), "ms"),
        camera=field("Camera", "Core-Camera"),
        bit_depth=field("BitDepth"),
        sensor_region=field("ROI"),
    )


def _micromanager_summary(tif: tifffile.TiffFile) -> Mapping[str, Any]:
    """Read the settings behind the header, whose length stands in the header."""
    tif.filehandle.seek(8)
    head = tif.filehandle.read(32)
    if len(head) < 32:
        return {}
    words = struct.unpack(tif.byteorder + "8I", head)
    place = 7 if words[0] != _NDTIFF else 3 if words[2] == _SUMMARY else 4
    if words[place] > _LONGEST_OTHER:
        return {}
    found = tifffile.tifffile.read_micromanager_metadata(tif.filehandle, {"Summary"})
    summary = found.get("Summary")
    return summary if isinstance(summary, dict) else {}


def _micromanager_fields(page: tifffile.TiffPage) -> Mapping[str, Any]:
    tag = page.tags.get(MM_TAG)
    return tag.value if tag is not None and isinstance(tag.value, dict) else {}


def _whole(value: object) -> int:
    """Read a positive count; anything else counts as 1."""
    return value if isinstance(value, int) and value > 0 else 1
