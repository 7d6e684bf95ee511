"""Mean-square displacements of all rotors at common lags, each with its standard deviation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.motion.ensemble import msd_lags
from rotortrack.motion.estimate import MotionEstimate
from rotortrack.motion.msd import MSD, msd
from rotortrack.motion.msd_covariance import Mover, Overlaps, angle_sd, circle_sd
from rotortrack.motion.tables import MSDS
from rotortrack.motion.tracks import Track
from rotortrack.tables import conform

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

ALL_ROTORS = -1
_LAGS = 100
_COLUMNS = (
    *("lag", "angle_msd_rad2", "angle_msd_sd_rad2", "xy_msd_nm2", "xy_msd_sd_nm2"),
    *("n_pairs", "n_independent"),
)


@dataclass(frozen=True)
class RotorMSD:
    """Mean-square displacement of one rotor; arrays of shape (n_lags,).

    Attributes
    ----------
    lag
        Lags that it has pairs of frames at, frames.
    angle_msd_rad2, angle_msd_sd_rad2
        Of the cumulative angle, and the standard deviation that speed, diffusion and noise of the
        rotor make it have; nan where these are not known.
    xy_msd_nm2, xy_msd_sd_nm2
        The same of the position, along both axes together.
    n_pairs
        Pairs of frames, which overlap.
    n_independent
        Independent displacements that would tell the angle's as well.
    """

    lag: Integers
    angle_msd_rad2: Floats
    angle_msd_sd_rad2: Floats
    xy_msd_nm2: Floats
    xy_msd_sd_nm2: Floats
    n_pairs: Integers
    n_independent: Floats


def common_lags(tracks: Iterable[Track]) -> Integers:
    """Lags up to half the longest track, evenly spaced on a log axis, at most 100."""
    spans = [int(track.frame[-1] - track.frame[0]) for track in tracks if track.frame.size]
    return msd_lags(max(spans, default=1), _LAGS)


def rotor_msd(
    track: Track,
    curve: MSD,
    estimate: MotionEstimate,
    lags: Integers,
    *,
    frame_interval_s: float,
    exposure_s: float,
) -> RotorMSD:
    """Take one rotor's mean-square displacement at some lags.

    Parameters
    ----------
    track
        Its positions; lags over half its length are left out, as their few pairs say nothing.
    curve
        Of its cumulative angle, at lags 1, 2, ... up to half the track at least.
    estimate
        Its speed, D and noise, by which the displacements scatter.
    lags
        In frames, ascending.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.
    """
    offset = track.frame - track.frame[0]
    lags = lags[lags <= max(int(offset[-1]) // 2, 1)]
    lags = lags[curve.pairs[lags - 1] > 0]
    place = np.full((2, int(offset[-1]) + 1), np.nan)
    place[:, offset] = track.x_nm, track.y_nm
    last = int(lags.max(initial=1))
    xy = msd(place[0], last).values + msd(place[1], last).values
    sd = np.full((3, lags.size), np.nan)
    mover = Mover(
        drift=estimate.fit.omega_rad_s,
        diffusion=estimate.fit.diffusion_rad2_s,
        noise_variance=estimate.noise_sd_rad**2,
        frame_interval_s=frame_interval_s,
        exposure_s=exposure_s,
    )
    if np.isfinite([mover.drift, mover.diffusion, mover.noise_variance]).all():
        seen = np.zeros(place.shape[1], np.bool_)
        seen[offset] = True
        overlaps = Overlaps(seen)
        sd[0], sd[1] = angle_sd(mover, lags, overlaps)
        sd[2] = circle_sd(mover, track.circle.radius_nm, lags, overlaps)
    return RotorMSD(
        lag=lags,
        angle_msd_rad2=curve.values[lags - 1],
        angle_msd_sd_rad2=sd[0],
        xy_msd_nm2=xy[lags - 1],
        xy_msd_sd_nm2=sd[2],
        n_pairs=curve.pairs[lags - 1],
        n_independent=sd[1],
    )


def msd_table(found: Mapping[int, RotorMSD], *, frame_interval_s: float) -> pd.DataFrame:
    """Make one row a rotor and lag, and one of all rotors a lag.

    Parameters
    ----------
    found
        By rotor number, all with lags of one grid.
    frame_interval_s
        Time between frame starts, s.

    Returns
    -------
    DataFrame
        Columns of `tables.MSDS`. Rotor -1 is the mean over rotors, each of one weight; its
        standard deviations come from how rotors differ (nan at lags that one rotor alone has), and
        `n_independent` counts rotors.
    """
    parts = [
        pd.DataFrame({name: vars(one)[name] for name in _COLUMNS}).assign(rotor=number)
        for number, one in found.items()
    ]
    rotors = pd.concat(parts) if parts else pd.DataFrame(columns=("rotor", *_COLUMNS), dtype=float)
    lags = rotors.groupby("lag")
    whole = pd.DataFrame({"rotor": ALL_ROTORS, "n_pairs": lags["n_pairs"].sum()})
    whole["n_independent"] = lags.size()
    for name, sd in (("angle_msd_rad2", "angle_msd_sd_rad2"), ("xy_msd_nm2", "xy_msd_sd_nm2")):
        whole[name] = lags[name].mean()
        whole[sd] = lags[name].sem()
    rows = pd.concat([whole.reset_index(), rotors], ignore_index=True)
    rows["lag_s"] = rows["lag"].astype(np.float64) * frame_interval_s
    return conform(rows.drop(columns="lag"), MSDS, "msd")
