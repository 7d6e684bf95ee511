"""Both ends of each rotor at one time: a rolling shutter's lag and blur allowed for."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.motion.blur import radius_factor
from rotortrack.twocolour.ends import Timing, undo_lag
from rotortrack.twocolour.registration import Registration
from rotortrack.twocolour.turning import turning

Floats = NDArray[np.float64]

_LEAST_FACTOR = 2.0 / 3.0


@dataclass(frozen=True)
class Pair:
    """Both ends of one rotor; arrays of shape (frames,).

    `turning_known` tells whether lag and blur could be allowed for.
    """

    rotor: int
    frame: NDArray[np.int64]
    first: Floats
    second: Floats
    variance: Floats
    stray: Floats
    late_s: Floats
    place: Floats
    stretch: float
    map_sd_nm: float
    turning_known: bool

    @property
    def vector(self) -> Floats:
        """Second end less first, (frames, 2)."""
        return self.second - self.first

    @property
    def noise_nm(self) -> Floats:
        """Noise of the vector along itself, that of the registration left out.

        That of localisation is taken as the same along and across.
        """
        noise: Floats = np.sqrt(0.5 * self.variance.sum(axis=1) + self.strayed[0])
        return noise

    @property
    def strayed(self) -> tuple[float, float]:
        """Mean variance along the vector and across it that diffusion between exposures adds.

        That of single frames grows with the vector: of a rod that breathes, long ones would count
        less.
        """
        along = np.sum(self.unit * self.stray, axis=1) ** 2
        across = np.sum(self.stray**2, axis=1) - along
        return float(along.mean()), float(across.mean())

    @property
    def even_length(self) -> Floats:
        """Length that the vector had if its noise across were that along, (frames,).

        Noise across lengthens a vector, noise along does not: where the two differ, the square of
        the length is longer by their difference than the law of even noise expects.
        """
        along, across = self.strayed
        even: Floats = np.sqrt(np.maximum(self.length**2 + along - across, 0.0))
        return even

    @property
    def unit(self) -> Floats:
        """Direction of the vector, (frames, 2); none where its ends meet."""
        least = np.finfo(np.float64).tiny
        unit: Floats = self.vector / np.maximum(self.length, least)[:, np.newaxis]
        return unit

    @property
    def length(self) -> Floats:
        """Length of the vector, (frames,)."""
        length: Floats = np.hypot(*self.vector.T)
        return length

    def moved(self, shift: Floats, map_sd_nm: float) -> Pair:
        """Give the same with the second end shifted."""
        return dataclasses.replace(self, second=self.second - shift, map_sd_nm=map_sd_nm)

    @property
    def constancy(self) -> float:
        """Length of the mean direction: 1 for a vector that stays, 0 for one that turns."""
        return float(np.hypot(*self.unit.mean(axis=0)))


def pairs_of(
    paired: pd.DataFrame,
    rotors: pd.DataFrame,
    registration: Registration,
    min_frames: int,
    timing: Timing,
) -> Iterator[Pair]:
    """Give each rotor's ends, the second one turned back to when the first was exposed.

    Parameters
    ----------
    paired
        As of `ends.pair_ends`.
    rotors
        Table of schema ROTORS; what it does not tell of a rotor's turning, its ends do.
    registration, timing
        How the second colour lies on the first, when rows are exposed.
    min_frames
        Rotors with fewer frames that show both ends are left out.
    """
    known = rotors.set_index("rotor")
    for number, rows in paired.groupby("rotor"):
        if len(rows) < min_frames:
            continue
        rotor = known.loc[number].to_dict()
        place = np.array([rotor["x_nm"], rotor["y_nm"]], np.float64)
        ends = rows[["x1_nm", "y1_nm", "x2_nm", "y2_nm"]].to_numpy(np.float64)
        sd = rows[["x1_sd_nm", "y1_sd_nm", "x2_sd_nm", "y2_sd_nm"]].to_numpy(np.float64)
        finite = np.isfinite(ends).all(axis=1) & (np.isfinite(sd) & (sd > 0)).all(axis=1)
        if finite.sum() < min_frames:
            continue
        ends, sd = ends[finite], sd[finite]
        late_s = rows["late_s"].to_numpy(np.float64)[finite]
        frame = rows["frame"].to_numpy(np.int64)[finite]
        omega, diffusion = (_number(rotor.get(n)) for n in ("omega_rad_s", "diffusion_rad2_s"))
        if not (math.isfinite(omega) and math.isfinite(diffusion)):
            omega, diffusion = turning(
                ends[:, :2],
                ends[:, 2:],
                frame,
                pivot_nm=place,
                frame_interval_s=timing.frame_interval_s,
            )
        factor = radius_factor(omega, diffusion, timing.exposure_s)
        second, stray = undo_lag(
            ends[:, 2],
            ends[:, 3],
            late_s,
            pivot_nm=(float(place[0]), float(place[1])),
            omega_rad_s=omega,
            diffusion_rad2_s=diffusion,
            exposure_s=timing.exposure_s,
        )
        yield Pair(
            rotor=int(rows["rotor"].iloc[0]),
            frame=frame,
            first=ends[:, :2],
            second=second,
            variance=sd[:, :2] ** 2 + sd[:, 2:] ** 2,
            stray=stray,
            late_s=late_s,
            place=place,
            stretch=1.0 / max(factor, _LEAST_FACTOR),
            map_sd_nm=float(registration.error_nm(place[np.newaxis])[0]),
            turning_known=math.isfinite(omega),
        )


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else math.nan
