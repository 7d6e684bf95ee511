"""Centre lines of rods to a small part of a pixel, and their ends.

Across a rod, the height is A exp(-t^2 / (2 s^2)) + b; a straight-line fit in A, b and the
displacement of the centre is repeated until the line lies on the crest. The measured centres are
smoothed with the penalty of a bent rod, transfer function 1 / (1 + (k l)^4), from anew in each
round, so that smoothing does not add up. Beyond the end of its spine a rod's height falls as it
does beside it, since the tip is as wide in all directions: fitting that fall gives the end without
the half width by which a threshold, or a skeleton, errs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.linalg import solveh_banded

Floats = NDArray[np.float64]

FWHM_PER_SIGMA = 2.3548200450309493

_ROUNDS = 6
_REACH = 2.5
"""Half length of a cross section in widths s: far enough for b, near enough to miss neighbours."""

_INSIDE, _BEYOND = 5.0, 3.0
"""Part of a rod, and of the ground beyond it, in which an end is fitted, in widths s."""


@dataclass(frozen=True)
class CentreLine:
    """The spine of a rod, from end to end.

    Attributes
    ----------
    path_px
        (n, 2), x and y in pixels, about a pixel apart, evenly spaced.
    height
        Height above the ground beside it at each point.
    sigma_px
        Standard deviation of its mean cross section.
    """

    path_px: Floats
    height: Floats
    sigma_px: float


class Sampler:
    """Reads heights between pixels by cubic splines; x and y in pixels, middles at one half."""

    def __init__(self, height: Floats) -> None:
        self._spline = ndimage.spline_filter(height, order=3, mode="mirror")

    def __call__(self, points: Floats) -> Floats:
        """Give the heights at points (..., 2)."""
        places = np.moveaxis(points, -1, 0)[::-1] - 0.5
        read = ndimage.map_coordinates(
            self._spline, places, order=3, mode="mirror", prefilter=False
        )
        return np.asarray(read, np.float64)


def smooth(path: Floats, length: float) -> Floats:
    """Smooth an evenly spaced path (n, m): least squares with the penalty l^4 times bending.

    Parameters
    ----------
    path
        Points; straight ends are free of force.
    length
        l, in units of the spacing.
    """
    n = len(path)
    if n < 3 or length <= 0.0:
        return path
    bands = np.zeros((3, n))
    ones = np.ones(n - 2)
    for shift, factor in ((0, 1.0), (1, -2.0), (2, 1.0)):
        bands[2, shift : shift + n - 2] += factor**2 * ones
    bands[1, 1 : n - 1] += -2.0
    bands[1, 2:n] += -2.0
    bands[0, 2:n] += 1.0
    bands *= length**4
    bands[2] += 1.0
    return np.asarray(solveh_banded(bands, path))


def resample(path: Floats, spacing: float, start: float = 0.0, stop: float | None = None) -> Floats:
    """Space a path evenly; `start` and `stop` along it may lie beyond its ends, in a straight."""
    at = along(path)
    stop = float(at[-1]) if stop is None else stop
    n = max(round((stop - start) / spacing), 2)
    wanted = np.linspace(start, stop, n + 1)
    inside = np.clip(wanted, 0.0, at[-1])
    points = np.stack([np.interp(inside, at, path[:, k]) for k in range(2)], axis=1)
    before, behind = end_directions(path, 3.0 * spacing)
    over = wanted - inside
    points += np.minimum(over, 0.0)[:, None] * -before + np.maximum(over, 0.0)[:, None] * behind
    return points


def along(path: Floats) -> Floats:
    """Give the arc length at each point, from 0."""
    return np.concatenate([[0.0], np.hypot(*np.diff(path, axis=0).T).cumsum()])


def end_directions(path: Floats, over: float) -> tuple[Floats, Floats]:
    """Give the unit vectors out of the first and the last end, over some length."""
    at = along(path)
    steps = min(max(int(np.searchsorted(at, over)), 1), len(path) - 1)
    first, last = path[0] - path[steps], path[-1] - path[-1 - steps]
    return first / max(np.hypot(*first), 1e-12), last / max(np.hypot(*last), 1e-12)


def follow(
    sampler: Sampler, start_px: Floats, sigma_px: float, smooth_px: float
) -> CentreLine | None:
    """Find the centre line of a rod.

    Parameters
    ----------
    sampler
        Levelled heights.
    start_px
        A line near it, such as a skeleton's (n, 2), n >= 2.
    sigma_px
        Width of its cross section, nearly.
    smooth_px
        Length l of the smoothing.

    Returns
    -------
    CentreLine or None
        None where there is nothing to follow: the line is shorter than a rod is wide.
    """
    path = smooth(resample(start_px, 1.0), 3.0)
    width = sigma_px
    height = np.ones(len(path))
    for turn in range(_ROUNDS):
        path = resample(path, 1.0)
        moved, height = _centres(sampler, path, width)
        path = smooth(moved, smooth_px)
        if turn == 1:
            width = _measured_width(sampler, path, sigma_px)
        starts, stops = (_end(sampler, path, width, last=last) for last in (False, True))
        length = float(along(path)[-1])
        if length + starts + stops < width:
            return None
        path = resample(path, 1.0, -starts, length + stops)
    _, height = _centres(sampler, path, width)
    return CentreLine(path, height, _measured_width(sampler, path, width))


def _across(path: Floats, reach: float) -> tuple[Floats, Floats, Floats]:
    """Give positions across the path, the points there (n, m, 2), and the normals."""
    tangent = np.gradient(path, axis=0)
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-12)[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    count = int(np.ceil(2.0 * reach))
    t = np.arange(-count, count + 1) / 2.0
    return t, path[:, None, :] + t[:, None] * normal[:, None, :], normal


def _heights(profile: Floats, shape: Floats) -> Floats:
    """Fit A (last axis: across) of A g + b."""
    centred = shape - shape.mean()
    return np.asarray(profile @ centred / (centred @ centred))


def _centres(sampler: Sampler, path: Floats, sigma: float) -> tuple[Floats, Floats]:
    """Move each point onto the crest; give the points and the heights."""
    t, points, normal = _across(path, _REACH * sigma)
    profile = sampler(points)
    shape = np.exp(-((t / sigma) ** 2) / 2.0)
    slope = t / sigma**2 * shape
    height = _heights(profile, shape)
    # A gap in a rod must not throw its centre away.
    firm = np.maximum(height, 0.5 * max(float(np.median(height)), 1e-12))
    shift = np.clip(profile @ slope / (slope @ slope) / firm, -sigma, sigma)
    return path + shift[:, None] * normal, height


def _measured_width(sampler: Sampler, path: Floats, sigma: float) -> float:
    """Fit the width of the mean cross section, ends apart."""
    t, points, _ = _across(path, 3.0 * sigma)
    inner = slice(round(2 * sigma), -round(2 * sigma)) if len(path) > 6 * sigma else slice(None)
    profile = sampler(points[inner]).mean(axis=0)
    tried = sigma * np.geomspace(0.4, 2.2, 120)
    shapes = np.exp(-((t / tried[:, None]) ** 2) / 2.0)
    shapes -= shapes.mean(axis=1, keepdims=True)
    explained = (shapes @ profile) ** 2 / (shapes**2).sum(axis=1)
    return float(_peak(tried, explained))


def _peak(at: Floats, values: Floats) -> float:
    """Place of the greatest value, by a parabola through its neighbours."""
    k = int(np.clip(values.argmax(), 1, len(at) - 2))
    left, middle, right = values[k - 1 : k + 2]
    bend = left - 2.0 * middle + right
    part = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return float(at[k] + np.clip(part, -1, 1) * (at[k + 1] - at[k - 1]) / 2.0)


def _end(sampler: Sampler, path: Floats, sigma: float, *, last: bool) -> float:
    """How far the spine goes on beyond an end of the path, negative where it stops before."""
    if not last:
        path = path[::-1]
    at = along(path)
    _, direction = end_directions(path, 2.0 * sigma)
    inside = min(_INSIDE * sigma, float(at[-1]))
    s = np.arange(-inside, _BEYOND * sigma + 0.25, 0.5)
    behind = np.minimum(s, 0.0) + at[-1]
    line = np.stack([np.interp(behind, at, path[:, k]) for k in range(2)], axis=1)
    line += np.maximum(s, 0.0)[:, None] * direction
    t, points, _ = _across(line, _REACH * sigma)
    height = _heights(sampler(points), np.exp(-((t / sigma) ** 2) / 2.0))
    tried = np.arange(-inside + sigma, _BEYOND * sigma - 0.5 * sigma, 0.2)
    if len(tried) < 3:
        return 0.0
    fall = np.exp(-((np.maximum(s - tried[:, None], 0.0) / sigma) ** 2) / 2.0)
    explained = (fall @ height) ** 2 / (fall**2).sum(axis=1)
    return _peak(tried, explained)
