"""One rod, followed and measured in pixels of its image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.afm.centre_line import (
    FWHM_PER_SIGMA,
    CentreLine,
    Sampler,
    along,
    end_directions,
    follow,
    resample,
)
from rotortrack.afm.skeleton import Piece
from rotortrack.afm.verdicts import Reason

Floats = NDArray[np.float64]

NOISE_LENGTH = 1.0 / 6.0
"""A line smoothed over l, whose points err by sd, is longer by sd^2 / (6 l^2)."""

LOST_LENGTH = 0.2210
"""And a chain of persistence length P by 0.2210 l / P shorter: the bends that smoothing removes."""

_LEAST_POINTS = 4


@dataclass
class Rod:
    """One piece of the skeleton and what became of it.

    Attributes
    ----------
    piece
        The piece.
    line
        Its centre line, None where it is no single line, not whole, or too short.
    noise_px
        Standard deviation of the centre line across it (pixels).
    reason
        Why it is refused, None while it is not.
    """

    piece: Piece
    line: CentreLine | None
    noise_px: float = 0.0
    reason: Reason | None = None

    @property
    def spine_px(self) -> float:
        """Length of the centre line, nan without one."""
        return float(along(self.line.path_px)[-1]) if self.line else float("nan")

    @property
    def height(self) -> float:
        """Median height above the ground beside it, nan without a centre line."""
        return float(np.median(self.line.height)) if self.line else float("nan")

    @property
    def width_px(self) -> float:
        """Width at half height, nan without a centre line."""
        return FWHM_PER_SIGMA * self.line.sigma_px if self.line else float("nan")

    @property
    def middle_px(self) -> Floats:
        """Middle of the rod along it, or of its skeleton's pixels."""
        if self.line:
            half = self.spine_px / 2.0
            return np.asarray(resample(self.line.path_px, half, 0.0, 2.0 * half)[1])
        return np.asarray(np.concatenate(self.piece.lines).mean(axis=0))

    def whole_px(self, cap_px: float) -> Floats:
        """Give the centre line with a straight cap at both ends."""
        assert self.line is not None
        path = self.line.path_px
        before, behind = end_directions(path, 2.0 * self.line.sigma_px)
        capped = np.concatenate([[path[0] + cap_px * before], path, [path[-1] + cap_px * behind]])
        return np.asarray(capped)


def measure(
    piece: Piece, sampler: Sampler, sigma_px: float, smooth_px: float, shape: tuple[int, int]
) -> Rod:
    """Follow a piece that is a single line, and refuse what is not one or not whole."""
    single = piece.junctions == 0 and not piece.closed and len(piece.lines) == 1
    line = None
    if single and len(piece.lines[0]) >= _LEAST_POINTS:
        line = follow(sampler, piece.lines[0], sigma_px, smooth_px)
    if piece.at_border or (line and _reaches_border(line, shape)):
        # What a fit finds at a border is the border's doing.
        return Rod(piece, None, reason=Reason.BORDER)
    rod = Rod(piece, line)
    if piece.closed:
        rod.reason = Reason.RING
    elif not single:
        rod.reason = Reason.CROSSING
    elif line is None:
        rod.reason = Reason.TOO_SHORT
    return rod


def _reaches_border(line: CentreLine, shape: tuple[int, int]) -> bool:
    """Whether the line, or the foot of its ends, comes to the border."""
    margin = 0.5 * FWHM_PER_SIGMA * line.sigma_px
    far = np.array(shape[::-1]) - margin
    return bool((line.path_px < margin).any() or (line.path_px > far).any())


def judge(
    rods: list[Rod], *, min_length_px: float, max_height_ratio: float, max_width_ratio: float
) -> None:
    """Refuse what is too short, or unlike most others in width or height."""
    for rod in rods:
        if rod.reason is None and rod.spine_px < min_length_px:
            rod.reason = Reason.TOO_SHORT
    left = [rod for rod in rods if rod.reason is None]
    if not left:
        return
    width = float(np.median([rod.width_px for rod in left]))
    height = float(np.median([rod.height for rod in left]))
    for rod in left:
        if rod.width_px > max_width_ratio * width:
            rod.reason = Reason.TOO_WIDE
        elif not 1.0 / max_height_ratio <= rod.height / height <= max_height_ratio:
            rod.reason = Reason.OTHER_HEIGHT
        elif _highest_part(rod) > max_height_ratio * rod.height:
            rod.reason = Reason.UNEVEN


def _highest_part(rod: Rod) -> float:
    """Greatest mean height over one width of the rod."""
    assert rod.line is not None
    count = min(max(round(rod.width_px), 1), len(rod.line.height))
    return float(np.convolve(rod.line.height, np.ones(count) / count, mode="valid").max())


def kinked(rods: list[Rod], turns: list[Floats], max_sd: float) -> None:
    """Refuse rods with a turn that the bending of all rods does not explain."""
    everything = np.concatenate([*turns, np.zeros(0)])
    if not everything.size:
        return
    # The median of squares is not moved by a few kinks.
    limit = max_sd * float(np.sqrt(np.median(everything**2) / 0.4549))
    for rod, own in zip(rods, turns, strict=True):
        if own.size and float(np.abs(own).max()) > limit:
            rod.reason = Reason.KINK


def spaced_nm(rod: Rod, pixel_size_nm: float) -> Floats:
    """Give the centre line in nm, evenly spaced."""
    assert rod.line is not None
    return pixel_size_nm * resample(rod.line.path_px, 1.0)
