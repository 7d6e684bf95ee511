"""Options that describe the movie."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


def _ordered(frames: tuple[int, int]) -> str | None:
    start, stop = frames
    return None if start < stop else f"must be a start below its stop, not {start}, {stop}"


def _has_area(region: tuple[int, int, int, int]) -> str | None:
    return None if min(region[2:]) > 0 else "must have a width and a height of at least 1 pixel"


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
        None, "frames to use: first, and one past the last", ge=0, check=_ordered
    )
