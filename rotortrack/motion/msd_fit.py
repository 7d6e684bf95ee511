"""Fit of the mean-square displacement that knows how its lags vary together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

from rotortrack.motion.msd import MSD
from rotortrack.motion.msd_covariance import Mover, covariance
from rotortrack.units import DEGREES_PER_RADIAN

Floats = NDArray[np.float64]

_LAGS = 20
_ROUNDS = 4
_Z95 = 1.959964
_RIDGE = 1e-10
_LEAST_PART = 1e-6


@dataclass(frozen=True)
class WeightedFit:
    """Fit of ``v^2 tau^2 + 2 n D (tau - t_e / 3)`` (``+ 2 n sigma^2``) in n coordinates.

    Attributes
    ----------
    speed, speed_sd, speed_interval
        Speed v without sign, its standard deviation and 95 % interval, rad/s (or nm/s). The
        interval starts at 0 where the curve could be that of pure diffusion.
    diffusion, diffusion_sd, diffusion_interval
        D, rad^2/s (or nm^2/s).
    noise_sd
        sigma of one coordinate, rad (or nm); 0 when it was not fitted.
    lag_min_s, lag_max_s
        First and last lag of the fit, s.
    n_lags
        Number of lags, evenly spaced on a log axis, that entered.
    """

    speed: float
    speed_sd: float
    speed_interval: tuple[float, float]
    diffusion: float
    diffusion_sd: float
    diffusion_interval: tuple[float, float]
    noise_sd: float
    lag_min_s: float
    lag_max_s: float
    n_lags: int

    def row(self) -> dict[str, float]:
        """Columns of `tables.ROTORS`, of a fit to an angle."""
        low, high = self.speed_interval
        return {
            "msd_gls_speed_deg_s": self.speed * DEGREES_PER_RADIAN,
            "msd_gls_speed_ci_low_deg_s": low * DEGREES_PER_RADIAN,
            "msd_gls_speed_ci_high_deg_s": high * DEGREES_PER_RADIAN,
            "msd_gls_diffusion_rad2_s": self.diffusion,
            "msd_gls_diffusion_ci_low_rad2_s": self.diffusion_interval[0],
            "msd_gls_diffusion_ci_high_rad2_s": self.diffusion_interval[1],
        }


NOT_FITTED = WeightedFit(
    *(np.nan,) * 2, (np.nan,) * 2, *(np.nan,) * 2, (np.nan,) * 2, *(np.nan,) * 3, 0
)


def fit_msd_weighted(
    curve: MSD,
    seen: NDArray[np.bool_],
    *,
    frame_interval_s: float,
    exposure_s: float,
    lags: int,
    noise: bool = True,
    coordinates: int = 1,
) -> WeightedFit:
    """Fit speed, D and noise by generalised least squares with the covariance of that very model.

    Starting from an unweighted fit, parameters and covariance are found in turns. The interval of
    v^2 holds the values u that are no further from the estimate than its standard deviation were
    v^2 = u: the more a rotor turns, the more its square scatters. That of D is symmetric in log D.

    Parameters
    ----------
    curve
        Mean-square displacement; for two coordinates the sum of theirs.
    seen
        Frames that were seen, shape (n_frames,), as in the curve.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.
    lags
        Last lag of the fit, frames.
    noise
        Whether localisation noise is fitted; without it any noise passes for diffusion.
    coordinates
        1 for an angle, 2 for positions.

    Returns
    -------
    WeightedFit
        `NOT_FITTED` when fewer lags than terms have pairs or nothing moves.

    Notes
    -----
    The speed of `estimate` is better where D is small, and has a sign: the MSD is for checking it.
    """
    known = np.flatnonzero((curve.lags <= lags) & (curve.pairs > 0))
    terms = 3 if noise else 2
    if known.size < terms or not curve.values[known].any():
        return NOT_FITTED
    spaced = np.geomspace(1, known.size, min(_LAGS, known.size)).round().astype(np.int64) - 1
    picked = known[np.unique(spaced)]
    values, frames = curve.values[picked], curve.lags[picked]
    if picked.size < terms:
        return NOT_FITTED
    tau = frames * frame_interval_s
    design = np.stack(
        [
            tau**2,
            2.0 * coordinates * (tau - exposure_s / 3.0),
            np.full(tau.size, 2.0 * coordinates),
        ][:terms],
        axis=1,
    )
    found = _bounded(design / values[:, np.newaxis], np.ones(tau.size))
    least = _LEAST_PART * values[0] / (2.0 * coordinates)
    for _ in range(_ROUNDS):
        noise_variance = found[2] if noise else 0.0
        mover = Mover(
            drift=float(np.sqrt(max(found[0], 0.0))),
            diffusion=float(max(found[1], least / tau[0])),
            noise_variance=float(max(noise_variance, least)),
            frame_interval_s=frame_interval_s,
            exposure_s=exposure_s,
        )
        still, drifting = covariance(mover, frames, seen)
        still *= coordinates
        total = still + max(found[0], 0.0) * drifting
        size = np.sqrt(np.diag(total))
        total = total / np.outer(size, size) + _RIDGE * np.eye(tau.size)
        root = linalg.cholesky(total, lower=True)
        white = linalg.solve_triangular(
            root, np.column_stack([design, values]) / size[:, np.newaxis], lower=True
        )
        found = _bounded(white[:, :-1], white[:, -1])
    scale = np.linalg.norm(white[:, :-1], axis=0)
    weights = np.linalg.pinv(white[:, :-1] / scale) / scale[:, np.newaxis]
    spread = weights @ weights.T
    row = linalg.solve_triangular(root, weights[0], lower=True, trans="T") / size
    low, high = _score_interval(
        float(found[0]), float(row @ still @ row), float(row @ drifting @ row)
    )
    speed = float(np.sqrt(max(found[0], 0.0)))
    speed_sd = float(np.sqrt(spread[0, 0])) / (2.0 * speed) if speed > 0 else high / _Z95
    diffusion, diffusion_sd = float(found[1]), float(np.sqrt(spread[1, 1]))
    times = np.exp(_Z95 * diffusion_sd / diffusion) if diffusion > _Z95 * diffusion_sd else np.inf
    interval = (
        (diffusion / times, diffusion * times)
        if np.isfinite(times)
        else (0.0, diffusion + _Z95 * diffusion_sd)
    )
    return WeightedFit(
        speed=speed,
        speed_sd=min(speed_sd, high),
        speed_interval=(low, high),
        diffusion=diffusion,
        diffusion_sd=diffusion_sd,
        diffusion_interval=(float(interval[0]), float(interval[1])),
        noise_sd=float(np.sqrt(found[2])) if noise else 0.0,
        lag_min_s=float(tau[0]),
        lag_max_s=float(tau[-1]),
        n_lags=int(tau.size),
    )


def _bounded(design: Floats, values: Floats) -> Floats:
    """Least squares with every term but the first at least zero."""
    scale = np.linalg.norm(design, axis=0)
    signed = np.column_stack([-design[:, 0] / scale[0], design / scale])
    size = float(np.linalg.norm(values))
    found = optimize.nnls(signed, values / size)[0] * size
    return np.asarray(np.append(found[1] - found[0], found[2:]) / scale, np.float64)


def _score_interval(square: float, still: float, drifting: float) -> tuple[float, float]:
    """Speeds whose square u obeys ``(square - u)^2 <= z^2 (still + drifting u)``."""
    middle = square + 0.5 * _Z95**2 * drifting
    reach = np.sqrt(max(middle**2 - square**2 + _Z95**2 * still, 0.0))
    return float(np.sqrt(max(middle - reach, 0.0))), float(np.sqrt(max(middle + reach, 0.0)))
