"""Both ends of every rotor, frame by frame.

An end-to-end vector belongs to one frame: frames that show one colour alone are left out, and never
paired with another frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import KDTree

from rotortrack.flags import FIT_FAILED
from rotortrack.rotors.per_frame import duplicates, is_duplicate
from rotortrack.twocolour.registration import Registration

Floats = NDArray[np.float64]

_OF_SECOND = ["rotor", "frame", "x_nm", "y_nm", "x_sd_nm", "y_sd_nm", "seen_y_nm"]


@dataclass(frozen=True)
class Timing:
    """When the rows of a frame are exposed.

    Attributes
    ----------
    frame_interval_s
        Time from frame to frame.
    line_time_s
        Time from one row's exposure to that of the row below, 0 where all are exposed together;
        nan when unknown.
    pixel_size_nm
        Of the camera.
    """

    frame_interval_s: float
    line_time_s: float
    pixel_size_nm: float


def map_second(second: pd.DataFrame, registration: Registration, drift: pd.DataFrame) -> Floats:
    """Give the places of the second colour's spots on the first colour, without drift.

    Parameters
    ----------
    second
        Localisations of the second colour as they were seen: frame, x_nm, y_nm.
    registration
        The map onto the first colour.
    drift
        Table of schema DRIFT, to be subtracted; may be empty.

    Returns
    -------
    Shape (rows, 2), nm.
    """
    places = registration.to_first(second[["x_nm", "y_nm"]].to_numpy(np.float64))
    if drift.empty or second.empty:
        return places
    first = int(drift["frame"].iloc[0])
    row = np.clip(second["frame"].to_numpy(np.int64) - first, 0, len(drift) - 1)
    corrected: Floats = places - drift[["dx_nm", "dy_nm"]].to_numpy(np.float64)[row]
    return corrected


def pair_ends(
    first: pd.DataFrame,
    second: pd.DataFrame,
    places_nm: Floats,
    rotors: pd.DataFrame,
    *,
    reach_nm: float,
    timing: Timing,
) -> pd.DataFrame:
    """Join the spots of both ends of every rotor and frame.

    A spot of the second colour belongs to the rotor whose centre is nearest, if that is within
    reach; of several in one frame the one nearest to the ring of the others counts.

    Parameters
    ----------
    first
        Localisations of the first colour with their rotor, drift subtracted.
    second, places_nm
        Trusted localisations of the second colour as they were seen, and their places on the first
        colour, (rows, 2), nm.
    rotors
        Table of schema ROTORS.
    reach_nm
        Farthest distance of a second end from its rotor's centre.
    timing
        When rows are exposed.

    Returns
    -------
    DataFrame
        rotor, frame, x1_nm, y1_nm, x2_nm, y2_nm, their standard deviations x1_sd_nm and so on, and
        late_s, by how much the second end was exposed later (nan when unknown); sorted by rotor
        and frame.
    """
    ends = _of_rotors(second, places_nm, rotors, reach_nm)
    mine = first[(first["rotor"] >= 0) & ~is_duplicate(first) & _fitted(first)]
    columns = ["rotor", "frame", "x_nm", "y_nm", "x_sd_nm", "y_sd_nm"]
    both = (
        mine[columns]
        .merge(ends, on=["rotor", "frame"], suffixes=("_first", "_second"), validate="one_to_one")
        .sort_values(["rotor", "frame"], kind="stable", ignore_index=True)
    )
    rows = (both["seen_y_nm"] - both["y_nm_first"]) / timing.pixel_size_nm
    paired = {
        "rotor": both["rotor"],
        "frame": both["frame"],
        **{
            f"{axis}{number}{kind}_nm": both[f"{axis}{kind}_nm_{name}"].astype("float64")
            for number, name in ((1, "first"), (2, "second"))
            for axis in ("x", "y")
            for kind in ("", "_sd")
        },
        "late_s": rows * timing.line_time_s,
    }
    return pd.DataFrame(paired)


def undo_lag(
    x_nm: Floats,
    y_nm: Floats,
    late_s: Floats,
    *,
    pivot_nm: tuple[float, float],
    omega_rad_s: float,
    diffusion_rad2_s: float,
) -> tuple[Floats, Floats, Floats]:
    """Turn an end back to when the other one was exposed.

    Parameters
    ----------
    x_nm, y_nm, late_s
        Places, (n,), and by how much later they were exposed; nan counts as 0.
    pivot_nm, omega_rad_s, diffusion_rad2_s
        What it turns about, and how fast, counter-clockwise on the displayed image; values that
        are not finite count as 0.

    Returns
    -------
    x_nm, y_nm, extra_variance_nm2
        The places, and the variance per axis that diffusion between both exposures adds.
    """
    late = np.nan_to_num(late_s)
    turned = -late * (omega_rad_s if math.isfinite(omega_rad_s) else 0.0)
    dx, dy = x_nm - pivot_nm[0], y_nm - pivot_nm[1]
    cosine, sine = np.cos(turned), np.sin(turned)
    diffusion = diffusion_rad2_s if math.isfinite(diffusion_rad2_s) else 0.0
    # On the displayed image y points down, so that this turns counter-clockwise.
    return (
        pivot_nm[0] + cosine * dx + sine * dy,
        pivot_nm[1] - sine * dx + cosine * dy,
        (dx**2 + dy**2) * np.abs(late) * max(diffusion, 0.0),
    )


def _of_rotors(
    second: pd.DataFrame, places_nm: Floats, rotors: pd.DataFrame, reach_nm: float
) -> pd.DataFrame:
    """Give the second end of every rotor and frame: one row each."""
    chosen = second[["frame", "x_sd_nm", "y_sd_nm"]].assign(
        rotor=np.int64(-1),
        x_nm=places_nm[:, 0],
        y_nm=places_nm[:, 1],
        seen_y_nm=second["y_nm"].to_numpy(),
    )
    for column in ("photons", "fit_flags"):
        if column in second:
            chosen[column] = second[column]
    placed = rotors[np.isfinite(rotors[["x_nm", "y_nm"]]).all(axis=1)]
    usable = _fitted(second) & np.isfinite(places_nm).all(axis=1)
    if len(placed) and usable.any():
        tree = KDTree(placed[["x_nm", "y_nm"]].to_numpy(np.float64))
        away, nearest = tree.query(places_nm[usable], distance_upper_bound=reach_nm)
        numbers = np.append(placed["rotor"].to_numpy(np.int64), -1)
        chosen.loc[usable, "rotor"] = numbers[np.where(np.isfinite(away), nearest, -1)]
    chosen = chosen[chosen["rotor"] >= 0].reset_index(drop=True)
    marked = duplicates(chosen, _off_ring(chosen))
    return chosen.loc[
        ~marked, ["rotor", "frame", "x_nm", "y_nm", "x_sd_nm", "y_sd_nm", "seen_y_nm"]
    ]


def _off_ring(spots: pd.DataFrame) -> Floats:
    """Give each spot's distance from the ring that its rotor's spots lie on, by their medians."""
    by_rotor = spots.groupby("rotor")
    dx = spots["x_nm"] - by_rotor["x_nm"].transform("median")
    dy = spots["y_nm"] - by_rotor["y_nm"].transform("median")
    radius = pd.Series(np.hypot(dx, dy), index=spots.index)
    usual = radius.groupby(spots["rotor"]).transform("median")
    away: Floats = (radius - usual).abs().to_numpy(np.float64)
    return away


def _fitted(spots: pd.DataFrame) -> NDArray[np.bool_]:
    if "fit_flags" not in spots:
        return np.ones(len(spots), bool)
    fitted: NDArray[np.bool_] = (spots["fit_flags"].to_numpy() & int(FIT_FAILED)) == 0
    return fitted
