"""Both colours on one sensor."""

from __future__ import annotations

from typing import Literal

from rotortrack.errors import ConfigurationError

Region = tuple[int, int, int, int]


def split_regions(
    shape: tuple[int, int], split: Literal["left-right", "top-bottom"], *, swapped: bool = False
) -> tuple[Region, Region]:
    """Give the halves of a sensor that show the first and the second colour.

    Parameters
    ----------
    shape
        Rows and columns.
    split
        How the sensor is divided; the first colour is left or above.
    swapped
        Whether it is right or below instead.

    Returns
    -------
    Two regions x0, y0, width, height in pixels.

    Raises
    ------
    ConfigurationError
        The halves would differ in size.
    """
    height, width = shape
    size = width if split == "left-right" else height
    if size % 2:
        what = "columns" if split == "left-right" else "rows"
        raise ConfigurationError(
            f"channels.split: {size} {what} have no two equal halves: give channels.first_region "
            "and channels.second_region"
        )
    half = size // 2
    if split == "left-right":
        regions: tuple[Region, Region] = ((0, 0, half, height), (half, 0, half, height))
    else:
        regions = ((0, 0, width, half), (0, half, width, half))
    return regions[::-1] if swapped else regions
