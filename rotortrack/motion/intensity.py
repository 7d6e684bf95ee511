"""Stepwise rises and falls of a rotor's intensity: a second rotor in its pore comes or goes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

WINDOW = 8
"""Blocks on either side of a step; a median over them ignores blinks and single bright spots."""

CLOSE = 3
"""Blocks on either side within which a fall must happen."""

DYE_SHARE = 0.2
"""A fall by less than this part of the brightest level may be a few dyes that bleached at once: one
of twenty is a twentieth of it, however few are left. A rotor that leaves takes half of what there
is, and is told from them while more than a third of the dyes are left."""

_LARGEST_BLOCK, _SMALLEST_BLOCK, _BLOCKS = 40, 10, 64
_FEWEST_BLOCKS, _NEAREST = 4, 2

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class IntensitySteps:
    """The largest steps of an intensity in both directions.

    Attributes
    ----------
    rise, rise_frame
        Factor, at least 1, by which the intensity rises in a step, and the frame at which it does.
    fall, fall_frame
        The same of a fall, as a factor of at least 1, too.

    Without a step in a direction the factor is 1; nan where the intensities do not suffice. The
    frame is -1 in both cases.
    """

    rise: float
    rise_frame: int
    fall: float
    fall_frame: int


def intensity_steps(frame: NDArray[np.int64], photons: Floats) -> IntensitySteps:
    """Find the largest stepwise rise and fall of an intensity.

    Levels are medians of log intensity over blocks of 40 successive frames with a localisation (10
    where there are few). A step is the difference between the medians of the 8 blocks after and
    before, less what the slopes within both windows account for; of both differences the smaller
    counts, so that neither bleaching nor a slow wander makes a step. Photons of one frame are
    added up, so that a second rotor counts whether it is resolved or brightens the first one's
    spot. A fall counts where it takes a good part of the brightest level, too (`DYE_SHARE`).

    Parameters
    ----------
    frame, photons
        Of every localisation of one rotor, any order, shape (n,).

    Returns
    -------
    IntensitySteps
        nan for fewer than 40 frames with an intensity.

    Notes
    -----
    O(n log n). A step is found from 2 blocks on either side of it on, the more surely the more
    there are.
    """
    good = np.isfinite(photons) & (photons > 0.0)
    frames, index = np.unique(frame[good], return_inverse=True)
    size = int(np.clip(frames.size // _BLOCKS, _SMALLEST_BLOCK, _LARGEST_BLOCK))
    blocks = frames.size // size
    if blocks < _FEWEST_BLOCKS:
        return IntensitySteps(math.nan, -1, math.nan, -1)
    log_sum = np.log(np.bincount(index, photons[good]))[: blocks * size]
    level = np.median(log_sum.reshape(blocks, size), axis=1)
    after, plain, sloped = _steps(level, WINDOW)
    smaller = np.copysign(np.minimum(np.abs(plain), np.abs(sloped)), plain)
    step = np.where(plain * sloped > 0.0, smaller, 0.0)
    rise, fall = np.maximum(step, 0.0), np.maximum(-step, 0.0)
    # Dyes that bleach one by one make a slope from afar and no step at close range.
    fall = np.minimum(fall, np.maximum(-_steps(level, CLOSE)[1], 0.0))
    brightest = math.exp(level.max())
    fall[np.exp(after) * np.expm1(fall) < DYE_SHARE * brightest] = 0.0
    # The first boundary lies behind the first two blocks.
    starts = frames[(np.arange(step.size) + _NEAREST) * size]
    return IntensitySteps(*_largest(rise, starts), *_largest(fall, starts))


def _largest(step: Floats, starts: NDArray[np.int64]) -> tuple[float, int]:
    best = int(np.argmax(step))
    return math.exp(step[best]), int(starts[best]) if step[best] > 0.0 else -1


def _steps(level: Floats, window: int) -> Floats:
    """Level behind each boundary that has two blocks on either side, and `_step` there."""
    window = min(window, max(_NEAREST, level.size // 4))
    windows = sliding_window_view(level, window)
    # Towards both ends the outer window becomes shorter.
    first = [_step(level[:b], level[b : b + window]) for b in range(_NEAREST, window)]
    inner = _step(windows[:-window], windows[window:])
    last = [_step(level[-b - window : -b], level[-b:]) for b in range(window - 1, _NEAREST - 1, -1)]
    return np.column_stack([*first, inner, *last])


def _step(left: Floats, right: Floats) -> Floats:
    """Level of the window on the right, its difference from the left one, and that less slopes."""
    after = np.median(right, axis=-1)
    plain = after - np.median(left, axis=-1)
    # The way from the middle of either window to the boundary, by the window's own slope.
    return np.array([after, plain, plain - _half_way(left) - _half_way(right)])


def _half_way(window: Floats) -> Floats:
    """Change of a sloping level from the middle of a window to its end: that between its halves."""
    half = window.shape[-1] // 2
    halves: Floats = np.median(window[..., -half:], axis=-1) - np.median(
        window[..., :half], axis=-1
    )
    return halves
