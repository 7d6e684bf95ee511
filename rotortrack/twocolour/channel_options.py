"""Options that say where the second colour is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


def _has_area(region: tuple[int, int, int, int]) -> str | None:
    return None if min(region[2:]) > 0 else "must have a width and a height of at least 1 pixel"


@dataclass(frozen=True, kw_only=True)
class ChannelsOptions(Options):
    """Where the second colour is: beside the first on one sensor, or in a movie of its own."""

    split: Literal["left-right", "top-bottom"] | None = option(
        None, "halves of the sensor that show the two colours, the first one left or above"
    )
    swapped: bool = option(False, "whether the first colour is right or below")
    first_region: tuple[int, int, int, int] | None = option(
        None,
        "the first colour's part of the sensor: x0, y0, width, height in pixels",
        ge=0,
        check=_has_area,
    )
    second_region: tuple[int, int, int, int] | None = option(
        None, "the second colour's part of the sensor, of the same size", ge=0, check=_has_area
    )
    second_movie: str | None = option(None, "the second colour's own file")
    second_channel: int | None = option(
        None, "the second colour's channel in the file, from 0; movie.channel is the first's", ge=0
    )
    second_sigma_px: float | None = option(
        None,
        "width at which fits of the second colour start, pixels (absent: as those of the first)",
        gt=0.2,
        le=10,
    )
    registration: str | None = option(
        None, "file of `rotortrack register` that maps the second colour onto the first"
    )
    line_time_s: float | None = option(
        None, "time from one row's exposure to that of the row below, s (rolling shutter)", ge=0
    )

    @property
    def named(self) -> bool:
        """Whether there is a second colour."""
        return any((self.split, self.second_region, self.second_movie, self.registration)) or (
            self.second_channel is not None
        )
