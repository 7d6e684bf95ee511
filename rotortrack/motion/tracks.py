"""What was seen of each rotor, taken from the tables."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.motion.angles import fitted_radius
from rotortrack.motion.readings import Circle

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_READ = ("theta_rad", "x_nm", "y_nm", "x_sd_nm", "y_sd_nm")


@dataclass(frozen=True)
class Track:
    """What was seen of one rotor; arrays of shape (n,), frames ascending without repeats.

    Attributes
    ----------
    frame
        Frames with a localisation.
    theta_rad
        Angles about the circle's centre.
    x_nm, y_nm, x_sd_nm, y_sd_nm
        Positions and their standard deviations, nan where these are not known.
    circle
        Centre and radius as fitted.
    """

    frame: Integers
    theta_rad: Floats
    x_nm: Floats
    y_nm: Floats
    x_sd_nm: Floats
    y_sd_nm: Floats
    circle: Circle


def used_tracks(tracks: pd.DataFrame, rotors: pd.DataFrame) -> dict[int, Track]:
    """List the tracks of the kept rotors that have any, by number.

    Parameters
    ----------
    tracks
        Table of `angles.build_tracks`; rows with `used` false or without an angle are left out.
    rotors
        Rotors table; where it has a verdict, only kept rotors count.

    Returns
    -------
    dict
        Numbers ascending. Columns that a table lacks are nan.
    """
    kept = rotors["verdict"] == "kept" if "verdict" in rotors.columns else rotors["rotor"] >= 0
    measurable = tracks["rotor"].isin(set(rotors.loc[kept, "rotor"])) & tracks["theta_rad"].notna()
    if "used" in tracks.columns:
        measurable &= tracks["used"]
    rows = tracks.loc[measurable].sort_values(["rotor", "frame"], kind="stable")
    circles = dict(zip(rotors["rotor"].tolist(), _circles(rotors), strict=True))
    columns = {
        name: rows[name].to_numpy("float64") if name in rows else np.full(len(rows), math.nan)
        for name in _READ
    }
    frame = rows["frame"].to_numpy("int64")
    numbers, starts = np.unique(rows["rotor"].to_numpy("int64"), return_index=True)
    bounds = np.append(starts, len(rows))
    return {
        number: Track(
            frame[start:stop],
            **{name: column[start:stop] for name, column in columns.items()},
            circle=circles[number],
        )
        for number, start, stop in zip(
            numbers.tolist(), bounds[:-1].tolist(), bounds[1:].tolist(), strict=True
        )
    }


def _circles(rotors: pd.DataFrame) -> list[Circle]:
    if not {"x_nm", "y_nm", "radius_nm"} <= set(rotors):
        return [Circle(math.nan, math.nan, math.nan)] * len(rotors)
    columns = rotors["x_nm"], rotors["y_nm"], fitted_radius(rotors)
    return [Circle(*values) for values in zip(*columns, strict=True)]
