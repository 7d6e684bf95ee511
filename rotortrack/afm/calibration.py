"""The scale of an image, by rods whose contour length is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_WITHIN = (0.6, 1.6)
_LEAST_FOR_MODE = 5
_FAR_SD = 4.0


@dataclass(frozen=True)
class Scale:
    """By what measured lengths are multiplied.

    Attributes
    ----------
    factor, sd
        The factor and its standard error; nan for the latter where one rod tells it.
    rods
        Number of rods behind it.
    """

    factor: float
    sd: float
    rods: int

    @property
    def differs(self) -> bool:
        """Whether it is not 1 by more than three errors and one per cent."""
        off = abs(self.factor - 1.0)
        return off > 0.01 and not off <= 3.0 * self.sd


def commonest_length(lengths: Floats, known: float) -> float:
    """Find the length that most rods have, broken ones and pairs apart.

    Of lengths within 0.6 and 1.6 of the known one, the half-sample mode: the densest half is
    halved again until two or three are left.
    """
    near = np.sort(lengths[(lengths > _WITHIN[0] * known) & (lengths < _WITHIN[1] * known)])
    if len(near) < _LEAST_FOR_MODE:
        return float(np.median(near)) if len(near) else known
    while len(near) > 3:
        half = (len(near) + 1) // 2
        first = int((near[half - 1 :] - near[: len(near) - half + 1]).argmin())
        near = near[first : first + half]
    return float(np.median(near))


def scale_of(lengths: Floats, known: float) -> Scale:
    """Compare the mean of measured lengths, without far ones, with the known one."""
    off = np.abs(lengths - np.median(lengths))
    spread = 1.4826 * float(np.median(off))
    # Dirt at an end of one rod must not move the scale of all.
    lengths = lengths[off <= max(_FAR_SD * spread, 1e-3 * known)]
    count = len(lengths)
    mean = float(lengths.mean())
    sd = float(lengths.std(ddof=1)) / math.sqrt(count) if count > 1 else math.nan
    return Scale(known / mean, known / mean * sd / mean, count)
