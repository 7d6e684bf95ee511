"""How a rotor turns from frame to frame, told by its ends alone.

For what an exposure blurs and a rolling shutter turns it need not be known well, but it must be
known of every rotor: of those too whose motion is none that the rotor's own table gives a speed to.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_FEWEST = 30
_SIGNIFICANT_SD = 2.0
_LEAST_CONCENTRATION_SD = 5.0


def turning(
    first_nm: Floats,
    second_nm: Floats,
    frame: Integers,
    *,
    pivot_nm: Floats,
    frame_interval_s: float,
) -> tuple[float, float]:
    """Estimate a rotor's speed and diffusion by the steps of whichever direction is less noisy.

    Parameters
    ----------
    first_nm, second_nm, frame
        Both ends, (n, 2), and their frames, ascending.
    pivot_nm
        What they turn about, (2,).
    frame_interval_s
        Time from frame to frame.

    Returns
    -------
    omega_rad_s, diffusion_rad2_s
        Counter-clockwise on the displayed image, on which y points down; each 0 where it is less
        than twice its error, both nan where steps are too few, or too wide to be told from none.

    Notes
    -----
    Mean turns by one frame and by two decay with ``exp(-D t)``; noise shortens both alike. Taken
    are the direction from one end to the other, which breathing does not turn, and that of the
    first end from the pivot.
    """
    one, two = max(
        (_turns(ends, frame) for ends in (second_nm - first_nm, first_nm - pivot_nm)),
        key=lambda found: found[0].length,
    )
    if two.n < _FEWEST or two.length < _LEAST_CONCENTRATION_SD / math.sqrt(two.n):
        return math.nan, math.nan
    omega = one.angle / frame_interval_s
    diffusion = math.log(one.length / two.length) / frame_interval_s
    turns = abs(one.angle) > _SIGNIFICANT_SD * one.angle_sd
    errors = math.hypot(one.length_sd / one.length, two.length_sd / two.length)
    spreads = diffusion * frame_interval_s > _SIGNIFICANT_SD * errors
    return (omega if turns else 0.0), (diffusion if spreads else 0.0)


@dataclass(frozen=True)
class _Mean:
    """The mean of unit vectors, with errors as if they were independent."""

    n: int
    length: float = 0.0
    angle: float = 0.0
    length_sd: float = math.inf
    angle_sd: float = math.inf


def _turns(vectors: Floats, frame: Integers) -> list[_Mean]:
    """Average the turns between frames that adjoin, and between those that are two apart."""
    direction = vectors[:, 0] - 1j * vectors[:, 1]
    length = np.abs(direction)
    there = length > 0.0
    unit = (direction[there] / length[there]).astype(np.complex128)
    frame = frame[there]
    means = []
    for apart in (1, 2):
        # The later frame of a pair is found by its number, as frames may be missing.
        later = np.searchsorted(frame, frame + apart)
        paired = later < frame.size
        paired[paired] = frame[later[paired]] == frame[paired] + apart
        turns = unit[later[paired]] * unit[paired].conj()
        means.append(_mean(turns) if turns.size else _Mean(0))
    return means


def _mean(turns: NDArray[np.complex128]) -> _Mean:
    mean = complex(turns.mean())
    along = turns * np.exp(-1j * cmath.phase(mean))
    root = math.sqrt(turns.size)
    return _Mean(
        n=turns.size,
        length=abs(mean),
        angle=cmath.phase(mean),
        length_sd=float(along.real.std()) / root,
        angle_sd=float(along.imag.std()) / root,
    )
