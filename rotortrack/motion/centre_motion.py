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
    O(n log n). A part whose positions all lie in one direction tells the shift in that one alone
    and is left out: across it, the information must be a tenth of that along it. A rod that
    breathes is off its circle in the same way for many frames, which shifts parts by more than as
    many independent positions would: standard deviations hold the covariance of the scatter in
    time, as those of Newey and West (Econometrica 55, 703, 1987) do.
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
    variance = noise2 * np.column_stack((vv, uu)) / det[:, np.newaxis]
    moved = _neighbours(np.where(told[:, np.newaxis], shift, np.nan))[part]
    residual = out - moved[:, 0] * u - moved[:, 1] * v
    wide = _correlated(frame, part, residual, u, v)
    if wide is not None:
        # (uu, uv, vv) of the sums, brought to that of the shifts by the inverse on both sides.
        suu, suv, svv = wide
        x = (vv**2 * suu - 2.0 * vv * uv * suv + uv**2 * svv) / det**2
        y = (uu**2 * svv - 2.0 * uu * uv * suv + uv**2 * suu) / det**2
        variance = np.maximum(variance, np.column_stack((x, y)))
    sd = np.sqrt(variance)
    if told.any():
        shift = shift - np.average(shift[told], axis=0, weights=count[told])
    return CentreMotion(shift, sd)


def _neighbours(shift: Floats) -> Floats:
    """Average the shifts of the parts before and after each; 0 where neither is known.

    That follows a centre that slides, and takes nothing of a part's own scatter away.
    """
    none = np.full((1, 2), np.nan)
    beside = np.stack((np.vstack((none, shift[:-1])), np.vstack((shift[1:], none))))
    known = np.isfinite(beside)
    mean: Floats = np.where(known, beside, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return mean


def _correlated(
    frame: NDArray[np.int64], part: NDArray[np.int64], residual: Floats, u: Floats, v: Floats
) -> tuple[Floats, Floats, Floats] | None:
    """Give the (co)variances of each part's sums of residuals times direction.

    The covariance of residuals at each lag is that of all parts together, up to the first lag where
    it is less than twice its error; None where that is the very first. Lags count positions, of
    which there are few even where frames are beyond number.
    """
    count = np.bincount(part, minlength=PARTS)
    order = np.argsort(frame, kind="stable")
    place = np.empty_like(part)
    place[order] = np.arange(part.size) - (np.cumsum(count) - count)[part[order]]
    rows = np.zeros((4, PARTS, int(count.max(initial=1))))
    for row, values in zip(rows, (residual, np.ones_like(residual), u, v), strict=True):
        row[part, place] = values
    length = rows.shape[2]
    padded = 1 << (2 * length - 1).bit_length()
    spectra = np.fft.rfft(rows, padded)
    e, there = np.fft.irfft((np.abs(spectra[:2]) ** 2).sum(axis=1), padded)[:, :length]
    pairs = np.maximum(np.round(there), 1.0)
    covariance = e / pairs
    weak = np.flatnonzero(covariance[1:] < 2.0 * covariance[0] / np.sqrt(pairs[1:]))
    lags = 1 + (int(weak[0]) if weak.size else length - 1)
    if lags == 1:
        return None
    kernel = np.zeros(padded)
    kernel[:lags] = covariance[:lags]
    kernel[padded - lags + 1 :] = covariance[1:lags][::-1]
    smooth = np.fft.irfft(spectra[2:] * np.fft.rfft(kernel), padded)[..., :length]
    suu, suv, svv = (np.sum(rows[2 + i] * smooth[j], axis=1) for i, j in ((0, 0), (0, 1), (1, 1)))
    return suu, suv, svv


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
