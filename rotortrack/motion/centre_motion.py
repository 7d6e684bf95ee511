"""Slow motion of a circle's centre: of one rotor on its pore, or of all by a drift that was left.

Within each part of the movie the distances r from the centre tell its shift d, from
r - R = d . u with the direction u of each position. What a rotor's own centre does is its own
fault; what those of many do together is the film's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PARTS = 20
"""Parts of the movie whose centres are compared; drift within one goes unseen."""

MIN_ROTORS = 8
"""Fewer rotors may agree by chance: the significance of n equal ones is sqrt(n (n - 1) / 2)."""

_FEWEST = 10
_LEAST_ACROSS = 0.1
_TRUSTED = 3.0

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CentreMotion:
    """Shifts of one rotor's centre.

    Attributes
    ----------
    shift_nm
        In x and y for every part of the movie, shape (PARTS, 2); nan where a part does not tell it
        in both directions. Their mean is 0.
    sd_nm
        Standard deviations, same shape, by the scatter about the circle.
    """

    shift_nm: Floats
    sd_nm: Floats

    @property
    def wander_nm(self) -> float:
        """Rms shift per axis beyond what noise makes, at least; nan for fewer than three parts.

        Noise counts three standard deviations above its mean, so that it alone gives 0.
        """
        known = np.isfinite(self.shift_nm[:, 0])
        if np.count_nonzero(known) < 3:
            return math.nan
        square, noise = self.shift_nm[known] ** 2, self.sd_nm[known] ** 2
        margin = _TRUSTED * math.sqrt(2.0 * float((noise**2).sum())) / noise.size
        return math.sqrt(max(0.0, float(square.mean() - noise.mean()) - margin))


def centre_motion(
    frame: NDArray[np.int64],
    x_nm: Floats,
    y_nm: Floats,
    circle: tuple[float, float, float],
    n_frames: tuple[int, int],
) -> CentreMotion:
    """Measure how the centre of a circle moves in the course of a movie.

    Parameters
    ----------
    frame, x_nm, y_nm
        Positions of one rotor, shape (n,).
    circle
        Centre and radius as fitted, nm.
    n_frames
        First frame and the one behind the last of the movie, whose twentieths are the parts.

    Notes
    -----
    O(n). A part whose positions all lie in one direction tells the shift in that one alone and is
    left out: across it, the information must be a tenth of that along it.
    """
    dx, dy = x_nm - circle[0], y_nm - circle[1]
    distance = np.hypot(dx, dy)
    safe = np.where(distance > 0.0, distance, 1.0)
    out = distance - circle[2]
    # Far spots are background, and would count by the square of their distance.
    limit = 4.0 * 1.4826 * float(np.median(np.abs(out - np.median(out)))) if out.size else 0.0
    out = np.clip(out, -limit, limit)
    first, stop = n_frames
    part = np.clip((frame - first) * PARTS // max(1, stop - first), 0, PARTS - 1)
    u, v = dx / safe, dy / safe
    count, uu, uv, vv, ur, vr, rr = (
        np.bincount(part, values, PARTS)
        for values in (np.ones_like(u), u * u, u * v, v * v, u * out, v * out, out * out)
    )
    middle, half = 0.5 * (uu + vv), np.hypot(0.5 * (uu - vv), uv)
    told = (count >= _FEWEST) & (middle - half >= _LEAST_ACROSS * (middle + half))
    det = np.where(told, uu * vv - uv * uv, np.nan)
    shift = np.column_stack((vv * ur - uv * vr, uu * vr - uv * ur)) / det[:, np.newaxis]
    used = np.maximum(count - 2.0, 1.0)
    left = np.maximum(rr - shift[:, 0] * ur - shift[:, 1] * vr, 0.0)
    freedom = used[told].sum()
    noise2 = float(left[told].sum() / freedom) if freedom else math.nan
    sd = np.sqrt(noise2 * np.column_stack((vv, uu)) / det[:, np.newaxis])
    if told.any():
        shift = shift - np.average(shift[told], axis=0, weights=count[told])
    return CentreMotion(shift, sd)


def common_motion(motions: Sequence[CentreMotion]) -> tuple[float, float]:
    """Tell how far centres move together.

    The products of the shifts of different rotors in the same part, weighted by their precision,
    average to the square of what is common whatever each does for itself. Its spread is that of the
    same rotors with random signs.

    Parameters
    ----------
    motions
        Of the rotors of one film.

    Returns
    -------
    Rms of the common shift per axis, nm, and its significance in standard deviations (0 for fewer
    than eight rotors).
    """
    told = [m for m in motions if np.count_nonzero(np.isfinite(m.shift_nm[:, 0])) >= PARTS // 2]
    if len(told) < MIN_ROTORS:
        return 0.0, 0.0
    shift = np.nan_to_num(np.array([m.shift_nm.ravel() for m in told]))
    seen = np.isfinite([m.shift_nm.ravel() for m in told])
    # A rotor that moves far by itself tells little of the others.
    weight = seen * (seen.sum(axis=1) / (shift**2).sum(axis=1))[:, np.newaxis]
    products, weights = (weight * shift) @ (weight * shift).T, weight @ weight.T
    off = ~np.eye(len(told), dtype=bool)
    common2 = products[off].sum() / weights[off].sum()
    significance = products[off].sum() / math.sqrt(2.0 * float((products[off] ** 2).sum()))
    return math.sqrt(max(0.0, float(common2))), float(significance)
