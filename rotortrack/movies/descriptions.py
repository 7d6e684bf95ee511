"""What a TIFF file says of itself: how many frames along which axes, and its metadata.

Descriptions are claims. The number of pages and the size of the file are checked against them by
the reader.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tifffile

from rotortrack.movies.metadata import Value, collect, merge, nanometres, seconds
from rotortrack.movies.ome import Ome, read_ome, square

_UNIT_OF_RESOLUTION = {3: "cm", 4: "mm", 5: "um"}
_MM_TAG = 51123
_STK_PLANES_TAG = 33629
_LONGEST_DESCRIPTION = 256 * 2**20
# Fewer frames do not average out the jitter of the computer's clock.
_FEWEST_TIMED_FRAMES = 10


@dataclass(frozen=True)
class Claim:
    """Frames that a description declares.

    Attributes
    ----------
    source
        Which description: `ImageJ`, `OME`, `tifffile` or `MetaMorph`.
    axes
        Lengths by axis name, time `T` among them; the product is the number of planes.
    one_directory
        Whether this kind of file may hold all frames behind a single directory.
    files
        Names of the files over which the frames are spread.
    """

    source: str
    axes: Mapping[str, int]
    one_directory: bool
    files: tuple[str, ...] = ()

    @property
    def frames(self) -> int:
        """Number of declared planes."""
        return math.prod(self.axes.values())

    @property
    def long_axes(self) -> dict[str, int]:
        """Axes that are longer than 1."""
        return {axis: length for axis, length in self.axes.items() if length > 1}


def read_descriptions(
    tif: tifffile.TiffFile, page: tifffile.TiffPage, path: Path, pages: int
) -> tuple[Claim | None, dict[str, Value]]:
    """Read all descriptions of an open file with its first page and number of pages.

    Returns
    -------
    claim
        The declared frames by the first description that declares any (OME, ImageJ, MetaMorph,
        tifffile), or None.
    metadata
        All values; Micro-Manager's measured times win over OME over ImageJ over Micro-Manager's
        settings over plain TIFF tags.
    """
    ome = None
    if tif.is_ome and len(page.description) <= _LONGEST_DESCRIPTION:
        ome = read_ome(page.description)
    imagej = tif.imagej_metadata or {}
    claim = (
        _ome_claim(ome, path.name)
        or _imagej_claim(imagej)
        or _metamorph_claim(page)
        or _shaped_claim(page)
    )
    metadata = merge(
        _tag_metadata(page),
        _micromanager_metadata(tif, page),
        _imagej_metadata(page, imagej),
        ome.metadata() if ome else {},
        _elapsed_metadata(tif, page, pages),
    )
    return claim, metadata


def _ome_claim(ome: Ome | None, name: str) -> Claim | None:
    images = ome.of_file(name) if ome else ()
    if not images:
        return None
    axes = {"S": len(images), **{axis: images[0].size(axis) for axis in "CZT"}}
    return Claim("OME", axes, one_directory=False, files=tuple(sorted(images[0].files)))


def _imagej_claim(imagej: Mapping[str, Any]) -> Claim | None:
    keys = {"C": "channels", "Z": "slices", "T": "frames"}
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
    try:
        found = json.loads(text) if text and text.startswith("{") else {}
    except ValueError:
        return None
    shape = found.get("shape", []) if isinstance(found, dict) else []
    if not isinstance(shape, list) or not all(isinstance(n, int) and n > 0 for n in shape):
        return None
    leading = shape[:-2]
    names = found.get("axes")
    if not isinstance(names, str) or len(names) != len(shape) or len({*names}) < len(names):
        names = [f"axis {number}" for number in range(len(shape))]
    axes = dict(zip(names[: len(leading)], leading, strict=True))
    return Claim("tifffile", axes, one_directory=True) if leading else None


def _tag_metadata(page: tifffile.TiffPage) -> dict[str, Value]:
    """Read a pixel size in metric units; dots per inch describe a print and say nothing."""
    unit = _UNIT_OF_RESOLUTION.get(int(page.resolutionunit))
    return collect(
        "file (TIFF resolution)",
        pixel_size_nm=_pixel_size(page, unit) if unit else None,
        software=page.software,
    )


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
    summary = (tif.micromanager_metadata or {}).get("Summary")
    summary = summary if isinstance(summary, dict) else {}

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


def _elapsed_metadata(
    tif: tifffile.TiffFile, page: tifffile.TiffPage, pages: int
) -> dict[str, Value]:
    """Measure the frame interval from the times at which Micro-Manager received the frames.

    The interval in its settings is a wish: 0 for "as fast as possible", and kept even where the
    exposure is longer.
    """
    if not tif.is_micromanager or pages < _FEWEST_TIMED_FRAMES:
        return {}
    last = tif.pages[pages - 1]
    if not isinstance(last, tifffile.TiffPage):
        return {}
    times = [
        seconds(_micromanager_fields(frame).get("ElapsedTime-ms"), "ms") for frame in (page, last)
    ]
    if times[0] is None or times[1] is None:
        return {}
    return collect(
        "file (Micro-Manager elapsed times)",
        frame_interval_s=(times[1] - times[0]) / (pages - 1),
    )


def _micromanager_fields(page: tifffile.TiffPage) -> Mapping[str, Any]:
    tag = page.tags.get(_MM_TAG)
    return tag.value if tag is not None and isinstance(tag.value, dict) else {}


def _whole(value: object) -> int:
    """Read a positive count; anything else counts as 1."""
    return value if isinstance(value, int) and value > 0 else 1
