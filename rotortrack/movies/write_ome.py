"""The OME-XML description of a movie that is written: sizes, and when each frame was taken."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

_SCHEMA = "http://www.openmicroscopy.org/Schemas/OME/2016-06"
_TYPES = {"float32": "float", "float64": "double"}


def ome_description(
    name: str,
    shape: tuple[int, int, int],
    dtype: np.dtype[np.generic],
    *,
    pixel_size_nm: float | None = None,
    frame_interval_s: float | None = None,
    exposure_s: float | None = None,
    times_s: NDArray[np.float64] | None = None,
) -> str:
    """Describe a movie of one page a frame.

    Parameters
    ----------
    name
        Of the file.
    shape, dtype
        Frames, rows, columns; type of a pixel.
    pixel_size_nm, frame_interval_s, exposure_s
        Written when given.
    times_s
        When each frame was received, shape (frames,); written when given.
    """
    frames, height, width = shape
    facts: dict[str, object] = {
        "ID": "Pixels:0",
        "DimensionOrder": "XYCZT",
        "Type": _TYPES.get(dtype.name, dtype.name),
        "SizeX": width,
        "SizeY": height,
        "SizeC": 1,
        "SizeZ": 1,
        "SizeT": frames,
    }
    if pixel_size_nm is not None:
        facts |= dict.fromkeys(("PhysicalSizeX", "PhysicalSizeY"), pixel_size_nm / 1e3)
    if frame_interval_s is not None:
        facts["TimeIncrement"] = frame_interval_s
    text = "".join(
        [
            f'<?xml version="1.0" encoding="UTF-8"?><OME xmlns="{_SCHEMA}">',
            f'<Image ID="Image:0" Name={quoteattr(name)}><Pixels {_attributes(facts)}>',
            '<Channel ID="Channel:0:0" SamplesPerPixel="1"/>',
            f'<TiffData IFD="0" PlaneCount="{frames}"/>',
            *_planes(frames, exposure_s, times_s),
            "</Pixels></Image></OME>",
        ]
    )
    # A description in a TIFF file is ASCII, names of files are not.
    return text.encode("ascii", "xmlcharrefreplace").decode("ascii")


def _planes(
    frames: int, exposure_s: float | None, times_s: NDArray[np.float64] | None
) -> list[str]:
    if exposure_s is None and times_s is None:
        return []
    exposure = {} if exposure_s is None else {"ExposureTime": exposure_s}
    times = [{}] * frames if times_s is None else [{"DeltaT": time} for time in times_s.tolist()]
    return [
        f"<Plane {_attributes({'TheC': 0, 'TheZ': 0, 'TheT': frame, **time, **exposure})}/>"
        for frame, time in enumerate(times)
    ]


def _attributes(values: dict[str, object]) -> str:
    return " ".join(f'{key}="{value}"' for key, value in values.items())
