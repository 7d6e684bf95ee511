"""One measured group of rotors: frames, noise and speeds of those that a comparison counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

_Z = 1.959963984540054


@dataclass(frozen=True)
class Film:
    """What a run's record tells of how it was filmed and screened.

    Attributes
    ----------
    exposure_s
        Exposure, nan where it is not known.
    min_spread
        Least spread of positions over their uncertainty at which a rotor was kept.
    mirrored
        Whether the optics flip the image; None where that is not known.
    """

    exposure_s: float
    min_spread: float
    mirrored: bool | None


@dataclass(frozen=True)
class MeasuredGroup:
    """Rotors of one run, in order of their numbers.

    Attributes
    ----------
    name
        As it is shown.
    rotor, n_frames
        Number and frames with both ends of each rotor, (rotors,).
    distance_nm, x_sd_nm, y_sd_nm
        Of all frames, those of a rotor together, (frames,).
    mean_nm
        Mean of each rotor's distances as measured.
    true_nm, true_sd_nm
        Mean of its true distance and the standard deviation of that.
    noise_ratio
        Noise as fitted over noise as the uncertainties tell it; 1 where not known.
    registration_sd_nm
        Expected error of the registration there, per axis; 0 where not known.
    speed_deg_s, speed_sd_deg_s, diffusion_rad2_s
        Signed speed, its standard deviation, rotational diffusion; nan where not known.
    localisation_sd_nm
        Uncertainty of a position of the end that was screened.
    behaviour
        Of each rotor, empty where not known.
    film
        How it was filmed.
    left_out
        How many kept rotors have too few frames.
    """

    name: str
    rotor: NDArray[np.int64]
    n_frames: NDArray[np.int64]
    distance_nm: Floats
    x_sd_nm: Floats
    y_sd_nm: Floats
    mean_nm: Floats
    true_nm: Floats
    true_sd_nm: Floats
    noise_ratio: Floats
    registration_sd_nm: Floats
    speed_deg_s: Floats
    speed_sd_deg_s: Floats
    diffusion_rad2_s: Floats
    localisation_sd_nm: Floats
    behaviour: tuple[str, ...]
    film: Film
    left_out: int

    @property
    def n(self) -> int:
        """Number of rotors."""
        return len(self.rotor)

    @property
    def first_frame(self) -> NDArray[np.int64]:
        """Where each rotor's frames begin, and the end of the last one's, (rotors + 1,)."""
        return np.append(0, np.cumsum(self.n_frames))

    def counts(self, edges: Floats) -> NDArray[np.int32]:
        """Count each rotor's frames in bins [low, high), the last one closed, (rotors, bins)."""
        return histograms(self.distance_nm, self.n_frames, edges)


def histograms(values: Floats, lengths: NDArray[np.integer], edges: Floats) -> NDArray[np.int32]:
    """Count runs of values of these lengths in bins [low, high) from 0; the last one is closed.

    Values beyond the bins count in the nearest, so that the counts of a run add up to its length.
    """
    bins = len(edges) - 1
    # Where a value lies is decided by the edges themselves, whatever a quotient is rounded to.
    at = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, bins - 1)
    owner = np.repeat(np.arange(len(lengths)), lengths)
    flat = np.bincount(owner * bins + at, minlength=bins * len(lengths))
    return flat.reshape(len(lengths), bins).astype(np.int32)


def measured_group(
    name: str,
    frames: pd.DataFrame,
    ends: pd.DataFrame,
    rotors: pd.DataFrame,
    film: Film,
    *,
    min_frames: int = 50,
) -> MeasuredGroup:
    """Gather the kept rotors of a run that have an end-to-end distance.

    Parameters
    ----------
    name
        As it is shown.
    frames, ends, rotors
        Tables of schemas `END_TO_END`, `END_TO_END_ROTORS` and `ROTORS`.
    film
        How it was filmed.
    min_frames
        Rotors with fewer frames with both ends are left out.

    Raises
    ------
    InputError
        Fewer than two rotors are left.
    """
    kept = rotors[rotors["verdict"] == "kept"] if "verdict" in rotors else rotors
    whole = ends.drop(columns=_shared_columns(ends, kept)).merge(kept, on="rotor", how="inner")
    whole = whole[np.isfinite(whole["end_to_end_nm"].to_numpy(np.float64))].sort_values("rotor")
    valid = np.isfinite(frames[["distance_nm", "x_sd_nm", "y_sd_nm"]].to_numpy(np.float64))
    own = frames[valid.all(axis=1) & frames["rotor"].isin(whole["rotor"])]
    n_frames = own.groupby("rotor").size().reindex(whole["rotor"], fill_value=0).to_numpy(np.int64)
    enough = n_frames >= min_frames
    table, n_frames = whole[enough], n_frames[enough]
    if len(table) < 2:
        raise InputError(
            f"{name} has {len(table) or 'no'} kept rotor{'' if len(table) == 1 else 's'} with an "
            f"end-to-end distance in at least {min_frames} frames, and a comparison of groups "
            "needs two: give a run with more rotors, or lower --min-frames"
        )
    own = own[own["rotor"].isin(table["rotor"])].sort_values(["rotor", "frame"])
    distance = own["distance_nm"].to_numpy(np.float64)
    first = np.append(0, np.cumsum(n_frames))[:-1]
    told = _column(table, "told_noise_nm")
    localised = _column(table, "localisation_sd_nm")
    return MeasuredGroup(
        name=name,
        rotor=table["rotor"].to_numpy(np.int64),
        n_frames=n_frames,
        distance_nm=distance,
        x_sd_nm=own["x_sd_nm"].to_numpy(np.float64),
        y_sd_nm=own["y_sd_nm"].to_numpy(np.float64),
        mean_nm=np.add.reduceat(distance, first) / n_frames,
        true_nm=_column(table, "end_to_end_nm"),
        true_sd_nm=np.nan_to_num(_column(table, "end_to_end_sd_nm")),
        noise_ratio=_or(_column(table, "noise_nm") / told, np.ones(len(table))),
        registration_sd_nm=_or(_column(table, "registration_error_nm"), np.zeros(len(table))),
        speed_deg_s=_column(table, "speed_deg_s"),
        speed_sd_deg_s=_speed_sd(table),
        diffusion_rad2_s=_column(table, "diffusion_rad2_s"),
        # Where it is not told, half of the variance of the ends' difference is one end's.
        localisation_sd_nm=_or(localised, told / np.sqrt(2.0)),
        behaviour=_texts(table, "behaviour"),
        film=film,
        left_out=int(np.count_nonzero(~enough)),
    )


def _speed_sd(table: pd.DataFrame) -> Floats:
    """Give the speeds' standard deviation: as told, else from the 95 % interval."""
    told = np.degrees(_column(table, "omega_sd_rad_s"))
    wide = _column(table, "speed_ci_high_deg_s") - _column(table, "speed_ci_low_deg_s")
    return _or(told, wide / (2.0 * _Z))


def _shared_columns(table: pd.DataFrame, other: pd.DataFrame) -> list[str]:
    return [str(name) for name in table if name in other and name != "rotor"]


def _column(table: pd.DataFrame, name: str) -> Floats:
    if name not in table:
        return np.full(len(table), np.nan)
    return table[name].to_numpy(np.float64)


def _texts(table: pd.DataFrame, name: str) -> tuple[str, ...]:
    if name not in table:
        return ("",) * len(table)
    return tuple(value if isinstance(value, str) else "" for value in table[name])


def _or(values: Floats, others: Floats) -> Floats:
    return np.where(np.isfinite(values), values, others)
