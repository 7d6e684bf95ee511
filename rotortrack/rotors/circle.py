"""The circle that a rotor's localisations trace, and whether they determine one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotortrack.rotors.algebraic import (
    Circle,
    Method,
    Values,
    algebraic_circle,
    geometric_circle,
)
from rotortrack.rotors.ellipse import axis_ratio
from rotortrack.rotors.ring_likelihood import fit_ring

RING_ARC_DEG = 270.0
"""Coverage above which centre and radius hardly depend on each other: distances tell both."""

MIN_SAGITTA_SD = 2.5
"""An arc less deep than twice its scatter s gives a radius of order s however many its points; at
2.5 s the radius is right to about 10 %."""

_ARC_BINS = 72
_EXACT = 1e-6
_LEAST_SIGNAL = 0.35
_LEAST_SIGNAL_OF_RING = 0.17
_SIGNAL_OF_POLES = 0.6
_ROUND, _LONG = 1.2, 1.4
_MIN_FOR_OUTLIERS = 10


class CircleEnd(Enum):
    """How a circle fit ended; the value is the word in the rotors table."""

    FITTED = "fitted"
    TOO_FEW_POINTS = "too_few_points"
    COLLINEAR = "collinear"
    ARC_TOO_SHORT = "arc_too_short"
    NOT_A_RING = "not_a_ring"

    @property
    def sentence(self) -> str:
        """What it means, as shown to the user, with what to try."""
        return _SENTENCES[self]


_SENTENCES = {
    CircleEnd.FITTED: "The positions determine a circle.",
    CircleEnd.TOO_FEW_POINTS: (
        "Fewer than three different positions do not determine a circle; record more frames or "
        "lower the detection threshold."
    ),
    CircleEnd.COLLINEAR: "The positions lie on a straight line, so no circle is determined.",
    CircleEnd.ARC_TOO_SHORT: (
        "The arc is less deep than 2.5 times its scatter, so its radius would be noise; more "
        "photons per spot help, more frames do not."
    ),
    CircleEnd.NOT_A_RING: (
        "The positions scatter about a point as much as about a circle, as those of a stuck spot "
        "do; its radius would be noise."
    ),
}


@dataclass(frozen=True)
class CircleFit:
    """Centre, radius and their standard deviations; lengths in nm.

    Unless `end` is FITTED the radius and all standard deviations are nan and the centre is the
    mean position. `arc_deg` is 360 minus the largest gap between occupied directions.
    `n_used` counts the positions that were neither missing nor outliers. `covariance_nm2` is that
    of centre and radius, shape (3, 3). `axis_ratio` is short over long axis, known from
    RING_ARC_DEG on.
    """

    x_nm: float
    y_nm: float
    radius_nm: float
    radius_sd_nm: float
    x_sd_nm: float
    y_sd_nm: float
    residual_sd_nm: float
    arc_deg: float
    n_used: int
    end: CircleEnd
    axis_ratio: float = math.nan
    axis_ratio_sd: float = math.nan
    covariance_nm2: Values = field(
        default_factory=lambda: np.full((3, 3), np.nan), compare=False, repr=False
    )


def fit_circle(
    x_nm: ArrayLike,
    y_nm: ArrayLike,
    method: Method | Literal["auto"] = "auto",
    *,
    outlier_sd: float = 0.0,
) -> CircleFit:
    """Fit a circle to positions and say whether they determine one.

    Centred and scaled first, so offsets of 1e11 nm or sizes of 1e-9 to 1e9 nm cost no digits beyond
    those of the input. Standard deviations are those of the linearised geometric fit.

    Parameters
    ----------
    x_nm, y_nm
        Positions, shape (n,), nm; any that is not finite is ignored; float32 is promoted.
    method
        "auto" is "hyper", refined by the likelihood of the distances (`ring_likelihood`) where the
        positions cover more than RING_ARC_DEG. On a full circle with s / R = 0.2 and 0.3 it is
        unbiased to 0.1 %, "hyper" reads 0.2 and 1.3 % too much, "geometric" 2 and 5 %, "kasa" and
        "taubin" 4 and 9 %, "pratt" 7 and 16 %.
    outlier_sd
        Leave out positions farther from the circle than this many robust standard deviations
        (median absolute deviation), repeatedly; 0 keeps all, as do fewer than ten positions.

    Notes
    -----
    0.5 ms for 2000 positions, 1.5 ms with outlier search (geometric: 1.5 and 8 ms), 5 ms with the
    likelihood. Where the moments of the distances give R / s < 1.75 (1.2 with the likelihood) the
    end is NOT_A_RING, because a plain fit of a spot gives R = 1.25 s.

    Examples
    --------
    >>> import numpy as np
    >>> import rotortrack as rt
    >>> turn = np.linspace(0.0, 6.0, 200)
    >>> fit = rt.fit_circle(500.0 + 100.0 * np.cos(turn), 300.0 + 100.0 * np.sin(turn))
    >>> round(fit.x_nm, 3), round(fit.y_nm, 3), round(fit.radius_nm, 3)
    (500.0, 300.0, 100.0)
    """
    x, y = (np.asarray(v, dtype=np.float64).ravel() for v in (x_nm, y_nm))
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if x.size == 0:
        return _failed(x, y, CircleEnd.TOO_FEW_POINTS)
    x0, y0 = float(x.mean()), float(y.mean())
    u, v = x - x0, y - y0
    # The mean of large numbers is rounded; the rest of it goes here.
    du, dv = float(u.mean()), float(v.mean())
    u, v, x0, y0 = u - du, v - dv, x0 + du, y0 + dv
    scale = math.sqrt(float(np.mean(u * u + v * v)))
    rounding = 4.0 * np.finfo(np.float64).eps * max(abs(x0), abs(y0))
    if x.size < 3 or scale <= rounding:
        return _failed(x, y, CircleEnd.TOO_FEW_POINTS)
    u, v = u / scale, v / scale
    thickness = float(np.linalg.svd(np.column_stack((u, v)), compute_uv=False)[1])
    if thickness <= math.sqrt(x.size) * max(1e-9, rounding / scale):
        return _failed(x, y, CircleEnd.COLLINEAR)
    used = np.ones(x.size, dtype=bool)
    plain: Method = "hyper" if method == "auto" else method
    circle = _fit(u, v, np.ones_like(u), plain)
    if outlier_sd > 0.0 and u.size >= _MIN_FOR_OUTLIERS:
        circle, used = _without_outliers(u, v, plain, circle, outlier_sd)
        u, v, x, y = u[used], v[used], x[used], y[used]
    return _judge(x, y, u, v, circle, (x0, y0, scale), by_distances=method == "auto")


def occupied_arc_deg(theta_rad: Values) -> float:
    """360 degrees minus the largest gap between populated directions.

    Directions are counted in bins of 5 degrees (wider for fewer than 144 positions, so that two
    are expected in each), and a bin is populated when it holds more than a tenth of the mean count
    of the populated ones: single false spots do not close a gap.

    Parameters
    ----------
    theta_rad
        Directions, shape (n,), rad.
    """
    if theta_rad.size == 0:
        return 0.0
    bins = min(_ARC_BINS, max(8, theta_rad.size // 2))
    index = ((theta_rad / (2.0 * math.pi)) % 1.0 * bins).astype(np.int64) % bins
    counts = np.bincount(index, minlength=bins)
    level = float(counts[counts > 0.1 * theta_rad.size / bins].mean())
    populated = np.flatnonzero(counts > 0.1 * level)
    gaps = np.diff(np.r_[populated, populated[0] + bins]) - 1
    return 360.0 * (1.0 - float(gaps.max()) / bins)


def _fit(u: Values, v: Values, weights: Values, method: Method) -> Circle:
    circle = algebraic_circle(u, v, weights, method)
    if method == "geometric" and math.isfinite(circle[2]):
        return geometric_circle(u, v, weights, circle)
    return circle


def _without_outliers(
    u: Values, v: Values, method: Method, circle: Circle, outlier_sd: float
) -> tuple[Circle, NDArray[np.bool_]]:
    """Refit with weights falling as 1 / residual until stable, then without the outliers."""
    for _ in range(10):
        if not math.isfinite(circle[2]):
            return circle, np.ones(u.size, dtype=bool)
        residual = np.abs(np.hypot(u - circle[0], v - circle[1]) - circle[2])
        spread = 1.4826 * float(np.median(residual))
        if spread == 0.0:
            break
        # Far spots pull an algebraic fit with the square of their distance.
        weights = 1.0 / np.maximum(1.0, residual / (1.5 * spread)) ** 3
        previous, circle = circle, _fit(u, v, weights, method)
        if max(abs(a - b) for a, b in zip(circle, previous, strict=True)) < 1e-3 * spread:
            break
    used = np.ones(u.size, dtype=bool)
    for _ in range(10):
        if not math.isfinite(circle[2]):
            break
        residual = np.abs(np.hypot(u - circle[0], v - circle[1]) - circle[2])
        # An exact circle has no spread; rounding must not make outliers.
        limit = outlier_sd * max(1.4826 * float(np.median(residual)), 1e-9)
        previous_used, used = used, residual <= limit
        circle = _fit(u[used], v[used], np.ones(np.count_nonzero(used)), method)
        if np.array_equal(used, previous_used):
            break
    return circle, used


def _judge(
    x: Values,
    y: Values,
    u: Values,
    v: Values,
    circle: Circle,
    frame: tuple[float, float, float],
    *,
    by_distances: bool,
) -> CircleFit:
    """Turn a circle in scaled coordinates into a result, or into the reason why there is none."""
    a, b, radius = circle
    if not math.isfinite(radius) or radius > 1e9:
        return _failed(x, y, CircleEnd.COLLINEAR)
    dx, dy = u - a, v - b
    distance = np.hypot(dx, dy)
    arc_deg = occupied_arc_deg(np.arctan2(-dy, dx))
    freedom = u.size - 3
    residual_sd = math.sqrt(float(np.sum((distance - radius) ** 2)) / max(1, freedom))
    sagitta = radius * (1.0 - math.cos(_noiseless_arc(arc_deg, residual_sd / radius) / 2.0))
    if sagitta < MIN_SAGITTA_SD * residual_sd:
        return _failed(x, y, CircleEnd.ARC_TOO_SHORT, arc_deg)
    ring = None
    if by_distances and arc_deg > RING_ARC_DEG and residual_sd > _EXACT * radius:
        ring = fit_ring(u, v, circle)
    if residual_sd > 0.25 * radius:
        # A short arc under much noise is an elongated spot with the moments of a weak ring; two
        # poles are elongated, too, but their distances are those of a clear one.
        elongation = _elongation(u, v)
        weak = ring is not None and elongation < _ROUND
        least = _LEAST_SIGNAL_OF_RING if weak else _LEAST_SIGNAL
        stretched = elongation > _LONG and not _is_ring(distance, _SIGNAL_OF_POLES)
        if stretched or not _is_ring(distance, least):
            return _failed(x, y, CircleEnd.NOT_A_RING, arc_deg)
    covariance = np.full((3, 3), np.nan)
    if ring is not None:
        a, b, radius, covariance = ring.x, ring.y, ring.radius, ring.covariance
    elif freedom > 0:
        safe = np.where(distance > 0.0, distance, 1.0)
        slopes = np.column_stack((dx / safe, dy / safe, np.ones_like(dx)))
        covariance = residual_sd**2 * np.linalg.pinv(slopes.T @ slopes)
    if freedom > 0:
        residuals = np.hypot(u - a, v - b) - radius
        residual_sd = math.sqrt(float(residuals @ residuals) / freedom)
    ratio, ratio_sd = math.nan, math.nan
    if arc_deg > RING_ARC_DEG:
        ratio, ratio_sd = axis_ratio(u, v, (a, b, radius))
    x0, y0, scale = frame
    sd = scale * np.sqrt(np.diag(covariance))
    return CircleFit(
        x_nm=x0 + scale * a,
        y_nm=y0 + scale * b,
        radius_nm=scale * radius,
        radius_sd_nm=float(sd[2]),
        x_sd_nm=float(sd[0]),
        y_sd_nm=float(sd[1]),
        residual_sd_nm=scale * residual_sd if freedom > 0 else math.nan,
        arc_deg=arc_deg,
        n_used=u.size,
        end=CircleEnd.FITTED,
        axis_ratio=ratio,
        axis_ratio_sd=ratio_sd,
        covariance_nm2=scale**2 * covariance,
    )


def _noiseless_arc(arc_deg: float, relative_noise: float) -> float:
    """Arc in rad without what noise (s / R) and the width of bins add to its two ends.

    The density beyond the end of an arc falls to a tenth, below which a bin is not populated, at
    1.28 standard deviations.
    """
    if arc_deg >= 360.0:
        return 2.0 * math.pi
    added = 2.0 * 1.28 * relative_noise + 2.0 * math.pi / _ARC_BINS
    return max(0.0, math.radians(arc_deg) - added)


def _elongation(u: Values, v: Values) -> float:
    minor, major = np.linalg.eigvalsh(np.cov(u, v))
    return math.sqrt(major / minor) if minor > 0.0 else math.inf


def _is_ring(distance: Values, least: float) -> bool:
    """Whether distances from the centre are those of a ring rather than of a Gaussian spot.

    For a ring of radius R with noise s per axis, 2 <r^2>^2 - <r^4> = R^4; for a spot it is 0, for
    an elongated spot negative. Demanded are a `least` part of <r^2>^2 (0.35 is R / s = 1.75, 0.17
    is 1.2) and, in small samples, more than a spot reaches by chance.
    """
    square = distance * distance
    signal = 2.0 - float(np.mean(square * square)) / float(np.mean(square)) ** 2
    return signal > max(least, 4.0 / math.sqrt(distance.size))


def _failed(x: Values, y: Values, end: CircleEnd, arc_deg: float = math.nan) -> CircleFit:
    nan = math.nan
    x_mean, y_mean = (float(np.mean(v)) if v.size else nan for v in (x, y))
    return CircleFit(x_mean, y_mean, nan, nan, nan, nan, nan, arc_deg, x.size, end)
