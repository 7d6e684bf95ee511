"""Options of tracing rods in an image of an atomic force microscope."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class ContourOptions(Options):
    """How rods are found, followed, judged and calibrated."""

    contour_length_nm: float | None = option(
        None, "known contour length of the rods, such as 450, nm, which calibrates the image", gt=0
    )
    rod_diameter_nm: float = option(
        6.0, "true diameter of a rod, nm, which its rounded ends add to its length", ge=0
    )
    width_nm: float | None = option(
        None, "width of a rod in the image at half height, nm (absent: measured)", gt=0
    )
    nm_per_unit: float | None = option(
        None, "height of one unit of the data, nm (absent: by the file, else 1)", gt=0
    )
    scan_axis: Literal["x", "y"] = option("x", "direction of the fast scan lines")
    line_order: int = option(1, "order of the polynomial taken off each scan line", ge=0, le=3)
    threshold: float = option(
        6.0, "ridges must exceed the noise of the ridge filter by this factor", gt=0
    )
    max_branch_nm: float = option(
        70.0, "side branches up to this length, such as a leash, are left out, nm", ge=0
    )
    min_length_nm: float | None = option(
        None, "shortest rod, nm (absent: half the contour length, or five widths)", gt=0
    )
    max_length_error: float = option(
        0.15, "lengths may differ from the commonest by this part, if one is known", gt=0, le=0.5
    )
    max_height_ratio: float = option(
        1.6, "a rod, or a part of it, may be higher than others by this factor", gt=1
    )
    max_width_ratio: float = option(1.5, "a rod may be wider than others by this factor", gt=1)
    max_kink_sd: float = option(
        6.0, "standard deviations that a turn between two segments may have", gt=0
    )
    smooth_nm: float | None = option(
        None, "length over which a centre line is smoothed, nm (absent: by width and noise)", gt=0
    )
    segment_nm: float | None = option(
        None, "length of the segments whose turns tell the stiffness, nm (absent: two widths)", gt=0
    )
    resamples: int = option(2000, "resamples of the rods for intervals", ge=100, le=100_000)
    seed: int = option(0, "seed of these resamples", ge=0)
