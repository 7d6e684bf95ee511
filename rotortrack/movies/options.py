"""Options that describe the movie."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


def _ordered(frames: tuple[int, int]) -> str | None:
    start, stop = frames
    return None if start < stop else f"must be a start below its stop, not {start}, {stop}"


def _has_area(region: tuple[int, int, int, int]) -> str | None:
    return None if min(region[2:]) > 0 else "must have a width and a height of at least 1 pixel"


def parse_axes(text: str) -> dict[str, int | None]:
    """Read axes such as ``TC2YX`` from the slowest to the fastest; None where no length is given.

    Raises
    ------
    ValueError
        The text is no sequence of letters, each given once and perhaps followed by its length.
    """
    found = re.findall(r"([A-Z])(\d*)", text.upper())
    axes = {letter: int(digits) if digits else None for letter, digits in found}
    read = "".join(letter + digits for letter, digits in found)
    if not found or len(axes) < len(found) or read != text.upper() or 0 in axes.values():
        raise ValueError(text)
    return axes


def _axes(text: str) -> str | None:
    try:
        axes = parse_axes(text)
    except ValueError:
        return f"must name each axis by one letter, such as TCYX or TC2YX, not {text!r}"
    return (
        None if {"Y", "X"} <= {*axes} else f"must name the axes Y and X, such as TCYX, not {text!r}"
    )


@dataclass(frozen=True, kw_only=True)
class MovieOptions(Options):
    """What is known of the movie; file metadata fills what is not given."""

    pixel_size_nm: float | None = option(None, "size of a pixel in the specimen, nm", gt=0)
    frame_interval_s: float | None = option(None, "time from frame to frame, s", gt=0)
    exposure_s: float | None = option(
        None, "exposure time, s (absent: the frame interval, with a warning)", gt=0
    )
    mirrored: Literal["true", "false", "unknown"] = option(
        "unknown", "whether the optics flip the image"
    )
    region: tuple[int, int, int, int] | None = option(
        None, "part of the sensor to use: x0, y0, width, height in pixels", ge=0, check=_has_area
    )
    frames: tuple[int, int] | None = option(
        None, "stored frames to use: first, and one past the last", ge=0, check=_ordered
    )
    axes: str | None = option(
        None,
        "order of the stored axes, such as TCYX or TC2YX (length behind a letter)",
        check=_axes,
    )
    channel: int | None = option(None, "channel to use, from 0, where there are several", ge=0)
    z_slice: int | None = option(None, "z slice to use, from 0, where there are several", ge=0)
    salvage: bool = option(False, "read the whole frames of a file that is cut short")
    max_frame_megapixels: float = option(
        64.0, "largest frame that is accepted, a guard against damaged or hostile files", gt=0
    )
