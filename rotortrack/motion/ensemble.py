"""Diffusion, mean-square displacement and common flow of many particles, with honest errors.

Errors come from leaving out one particle at a time, so that they hold also where particles differ
and steps of one are not independent.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.motion.covariance import StepProducts, covariance_estimate, step_products
from rotortrack.motion.msd import msd
from rotortrack.motion.readings import Timing
from rotortrack.motion.tables import PARTICLE_MSD
from rotortrack.tables import conform

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_LAGS = 80
_SLOPE_LAGS = 10
_NONE = StepProducts(0, 0, 0.0, 0.0)


@dataclass(frozen=True)
class Track:
    """Positions of one particle.

    Attributes
    ----------
    frame
        Ascending without repeats, shape (n,).
    place_nm
        x and y, shape (n, 2).
    sd_nm
        Their standard deviations by the fit, None where unknown.
    """

    frame: Integers
    place_nm: Floats
    sd_nm: Floats | None

    @property
    def noise_nm2(self) -> Floats:
        """Variances of localisation but for a factor; the steps' size where none is known."""
        if self.sd_nm is not None:
            return self.sd_nm**2
        return np.full(self.place_nm.shape, float(np.mean(np.diff(self.place_nm, axis=0) ** 2)))

    @property
    def moves(self) -> bool:
        """Whether any position differs from another."""
        return bool(np.ptp(self.place_nm, axis=0).any())


@dataclass(frozen=True)
class Ensemble:
    """All particles together.

    Attributes
    ----------
    n_particles
        How many.
    diffusion_nm2_s, diffusion_sd_nm2_s
        Mean D, weighted by the number of steps, by the covariance estimator.
    localisation_sd_nm
        Error per axis by the same estimator.
    flow_nm_s, flow_sd_nm_s
        Common velocity along x and y, which is taken off before, and the sd of each.
    alpha, alpha_sd
        Exponent of the mean-square displacement less localisation noise and flow, over the first
        ten lags: 1 for free diffusion, below for confined particles.
    msd
        Table `PARTICLE_MSD`.
    """

    n_particles: int
    diffusion_nm2_s: float
    diffusion_sd_nm2_s: float
    localisation_sd_nm: float
    flow_nm_s: tuple[float, float]
    flow_sd_nm_s: tuple[float, float]
    alpha: float
    alpha_sd: float
    msd: pd.DataFrame


def ensemble(tracks: Sequence[Track], timing: Timing) -> Ensemble:
    """Measure all particles together.

    Parameters
    ----------
    tracks
        Particles; there may be none.
    timing
        Frame interval and exposure.
    """
    dt = timing.frame_interval_s
    duration = np.array([t.frame[-1] - t.frame[0] for t in tracks], np.float64) * dt
    net = np.array([t.place_nm[-1] - t.place_nm[0] for t in tracks]).reshape(-1, 2)
    total = float(duration.sum())
    flow = net.sum(axis=0) / total if total else np.full(2, math.nan)
    per_frame = (float(flow[0]) * dt, float(flow[1]) * dt)
    products = [
        step_products(t.frame, t.place_nm[:, 0], t.place_nm[:, 1], per_frame) for t in tracks
    ]
    whole = functools.reduce(operator.add, products, _NONE)
    mean = covariance_estimate(whole, timing)
    without = np.array(
        [covariance_estimate(whole - one, timing).diffusion_nm2_s for one in products]
    )
    lags, squares, pairs = _displacements(tracks)
    near = lags <= _SLOPE_LAGS
    # What the common flow adds is no property of the particles.
    own = squares[:, near] - pairs[:, near] * lags[near] ** 2 * float(np.square(per_frame).sum())
    sums, counts = own.sum(axis=0), pairs[:, near].sum(axis=0)
    alpha = _alpha(lags[near], sums, counts, mean.diffusion_nm2_s * dt)
    alphas = np.array(
        [
            _alpha(lags[near], sums - own[k], counts - pairs[k, near], without[k] * dt)
            for k in range(len(tracks))
        ]
    )
    sd = _jackknife(without)
    remaining = total - duration
    with np.errstate(divide="ignore", invalid="ignore"):
        flows = (net.sum(axis=0) - net) / remaining[:, np.newaxis]
    return Ensemble(
        n_particles=len(tracks),
        diffusion_nm2_s=mean.diffusion_nm2_s,
        diffusion_sd_nm2_s=sd if len(tracks) > 1 else mean.diffusion_sd_nm2_s,
        localisation_sd_nm=math.sqrt(max(mean.noise_nm2, 0.0)),
        flow_nm_s=(float(flow[0]), float(flow[1])),
        flow_sd_nm_s=(_jackknife(flows[:, 0]), _jackknife(flows[:, 1])),
        alpha=alpha,
        alpha_sd=_jackknife(alphas),
        msd=_msd_table(lags, squares, pairs, dt),
    )


def track_msd(track: Track, lags: Integers) -> tuple[Floats, Integers]:
    """Mean-square displacement in the plane (nm^2) at these lags, and the pairs of frames."""
    values, pairs = np.zeros(lags.size), np.zeros(lags.size, np.int64)
    if not track.frame.size:
        return np.full(lags.size, np.nan), pairs
    offset = track.frame - track.frame[0]
    inside = lags <= offset[-1]
    for place in track.place_nm.T:
        trace = np.full(int(offset[-1]) + 1, np.nan)
        trace[offset] = place
        found = msd(trace, int(lags[-1]))
        values[inside] += found.values[lags[inside] - 1]
        pairs[inside] = found.pairs[lags[inside] - 1]
    return np.where(pairs > 0, values, np.nan), pairs


def msd_lags(longest: int, most: int = _LAGS) -> Integers:
    """Lags up to half a record of this many frames, evenly spaced on a log axis."""
    last = max(longest // 2, 1)
    return np.unique(np.geomspace(1, last, most).round().astype(np.int64))


def _displacements(tracks: Sequence[Track]) -> tuple[Integers, Floats, Integers]:
    """Sum squared displacements and count pairs, a row a particle, at common lags."""
    lags = msd_lags(max((int(t.frame[-1] - t.frame[0]) for t in tracks), default=1))
    squares = np.zeros((len(tracks), lags.size))
    pairs = np.zeros((len(tracks), lags.size), np.int64)
    for k, track in enumerate(tracks):
        values, pairs[k] = track_msd(track, lags)
        squares[k] = np.nan_to_num(values) * pairs[k]
    return lags, squares, pairs


def _msd_table(lags: Integers, squares: Floats, pairs: Integers, dt: float) -> pd.DataFrame:
    total = pairs.sum(axis=0)
    known = total > 0
    squares, pairs, total = squares[:, known], pairs[:, known], total[known]
    mean = squares.sum(axis=0) / total
    of = np.count_nonzero(pairs, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = np.sqrt(((squares - mean * pairs) ** 2).sum(axis=0) * of / (of - 1.0)) / total
    table = {
        "lag_s": lags[known] * dt,
        "xy_msd_nm2": mean,
        "xy_msd_sd_nm2": np.where(of > 1, spread, np.nan),
        "n_pairs": total,
        "n_particles": of,
    }
    return conform(pd.DataFrame(table), PARTICLE_MSD, "particle_msd")


def _alpha(lags: Integers, squares: Floats, pairs: Integers, diffusion: float) -> float:
    """Slope of log MSD against log lag, less the noise that the covariance estimator finds.

    `diffusion` is D times the frame interval.
    """
    if lags.size < 3 or not pairs.all() or not diffusion > 0.0:
        return math.nan
    values = squares / pairs
    own = values - values[0] + 4.0 * diffusion
    if not (own > 0.0).all():
        return math.nan
    slope = np.polyfit(np.log(lags), np.log(own), 1, w=1.0 / np.sqrt(lags))[0]
    return float(slope)


def _jackknife(without: Floats) -> float:
    """Give the standard deviation by the estimates that each leave one particle out."""
    n = without.size
    if n < 2:
        return math.nan
    return float(math.sqrt((n - 1) / n * float(((without - without.mean()) ** 2).sum())))
