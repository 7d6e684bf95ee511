"""From paired ends to end-to-end distances of frames and rotors."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack import parallel
from rotortrack.tables import empty
from rotortrack.twocolour.distance import Distance, true_distance
from rotortrack.twocolour.end_pairs import Pair, pairs_of
from rotortrack.twocolour.ends import Timing, pair_ends
from rotortrack.twocolour.ends_options import EndsOptions
from rotortrack.twocolour.moving_median import moving_median
from rotortrack.twocolour.orientation import alignment, preferred_axis
from rotortrack.twocolour.registration import Registration
from rotortrack.twocolour.rings import both_rings
from rotortrack.twocolour.self_calibration import (
    LocalShift,
    SmoothShift,
    local_shift,
    smooth_shift,
)
from rotortrack.twocolour.tables import END_TO_END, END_TO_END_ROTORS

Floats = NDArray[np.float64]

_INTERVAL = 1.96


@dataclass(frozen=True)
class Field:
    """What all rotors together tell of the registration and of elongated pores.

    Attributes
    ----------
    correction
        What was subtracted from the registration, or why nothing was.
    rigid_rotors
        Rotors that tell its error.
    correction_rms_nm, between_nm
        Size of the correction per axis, and what single rotors show beside it.
    alignment, alignment_p, aligned_rotors
        As of `orientation.alignment`, where the pores' axis is given.
    """

    correction: str
    rigid_rotors: int
    correction_rms_nm: float
    between_nm: float
    alignment: float
    alignment_p: float
    aligned_rotors: int


@dataclass(frozen=True)
class Measured:
    """Tables of schemas END_TO_END and END_TO_END_ROTORS, and what they say together."""

    frames: pd.DataFrame
    rotors: pd.DataFrame
    field: Field
    notes: tuple[str, ...]


def measure_ends(
    first: pd.DataFrame,
    second: pd.DataFrame,
    places_nm: Floats,
    rotors: pd.DataFrame,
    registration: Registration,
    options: EndsOptions,
    *,
    timing: Timing,
    workers: int | None = None,
) -> Measured:
    """Measure the end-to-end distances of rotors.

    Parameters
    ----------
    first
        Localisations of the first colour with their rotor, drift subtracted.
    second, places_nm
        Trusted localisations of the second colour as they were seen, and their places on the first
        colour, (rows, 2), nm.
    rotors
        Table of schema ROTORS; motion blur and a rolling shutter's lag are allowed for by its
        speeds and diffusion, or by what both ends tell where it has none.
    registration, options, timing
        How the second colour lies on the first, how distances are measured, when rows are exposed.
    workers
        Threads; as many as there are processors when not given.

    Returns
    -------
    Measured
        Of rotors that show both ends in `options.min_frames` frames, refused ones too.

    Notes
    -----
    Each end is taken at the mean of its exposure, which brings turning ends nearer to each other:
    distances are stretched by what the first end's radius lost. The error of the registration adds
    to the noise of a rotor that turns, and shifts the distance of one that does not.
    """
    paired = pair_ends(first, second, places_nm, rotors, reach_nm=options.reach_nm, timing=timing)
    pairs = list(pairs_of(paired, rotors, registration, options.min_frames, timing))
    with ThreadPoolExecutor(workers or parallel.default_workers()) as pool:
        shifts = list(pool.map(_shift_of, pairs))
        field, pairs = _calibrated(pairs, shifts, options)
        distances = list(pool.map(partial(_distance_of, options=options), pairs))
    if not pairs:
        return Measured(empty(END_TO_END), empty(END_TO_END_ROTORS), field, ())
    frames = pd.concat([_frame_rows(pair, options, timing) for pair in pairs], ignore_index=True)
    rows = [
        _rotor_row(pair, shift, distance, registration)
        for pair, shift, distance in zip(pairs, shifts, distances, strict=True)
    ]
    table = pd.DataFrame(rows)[END_TO_END_ROTORS.names]
    if options.pore_axis_deg is not None:
        found = alignment(
            table["axis_deg"].to_numpy(), table["order"].to_numpy(), options.pore_axis_deg
        )
        field = dataclasses.replace(
            field,
            alignment=found.alignment,
            alignment_p=found.alignment_p,
            aligned_rotors=found.n_rotors,
        )
    return Measured(frames, table, field, tuple(_notes(table, pairs)))


def _shift_of(pair: Pair) -> LocalShift:
    return local_shift(pair.vector[:, 0], pair.vector[:, 1], pair.noise_nm)


def _calibrated(
    pairs: list[Pair], shifts: list[LocalShift], options: EndsOptions
) -> tuple[Field, list[Pair]]:
    """Correct the registration by what rigid rotors share, and each by itself where asked to."""
    rigid = [i for i, shift in enumerate(shifts) if shift.rigid]
    found: SmoothShift | str = "not asked for"
    if options.self_calibrate:
        found = smooth_shift(
            np.array([pairs[i].place for i in rigid]).reshape(-1, 2),
            np.array([(shifts[i].x_nm, shifts[i].y_nm) for i in rigid]).reshape(-1, 2),
            np.array([shifts[i].sd_nm for i in rigid]),
        )
    unknown = math.nan
    if isinstance(found, str):
        field = Field(f"none: {found}", len(rigid), 0.0, unknown, unknown, unknown, 0)
    else:
        field = Field(
            f"{found.name} of {found.rms_nm:.1f} nm, by {found.n_rotors} rigid rotors",
            *(len(rigid), found.rms_nm, found.between_nm),
            *(unknown, unknown, 0),
        )
        pairs = [
            pair.moved(found.at(pair.place)[0], float(found.sd_nm(pair.place)[0])) for pair in pairs
        ]
    if options.correct_registration:
        pairs = [
            pair.moved(_remaining(pair, shift, found), shift.sd_nm) if shift.rigid else pair
            for pair, shift in zip(pairs, shifts, strict=True)
        ]
    return field, pairs


def _remaining(pair: Pair, shift: LocalShift, found: SmoothShift | str) -> Floats:
    """Give what a rotor shows beside what was subtracted for all."""
    own = np.array([shift.x_nm, shift.y_nm])
    return own if isinstance(found, str) else own - found.at(pair.place)[0]


def _distance_of(pair: Pair, options: EndsOptions) -> Distance:
    # A fixed error of the registration is noise to a vector that turns, but not to one that stays.
    turning = 1.0 - pair.constancy**2
    noise = np.sqrt(pair.noise_nm**2 + turning * pair.map_sd_nm**2)
    return true_distance(pair.even_length, noise, noise_prior=options.noise_prior)


def _frame_rows(pair: Pair, options: EndsOptions, timing: Timing) -> pd.DataFrame:
    vector, length = pair.vector, pair.length
    along = np.sqrt(np.sum(pair.unit**2 * pair.variance, axis=1) + pair.strayed[0])
    sd = np.sqrt(pair.variance + pair.stray**2)
    values = {
        "rotor": np.full(len(length), pair.rotor),
        "frame": pair.frame,
        "time_s": pair.frame * timing.frame_interval_s,
        "dx_nm": vector[:, 0],
        "dy_nm": vector[:, 1],
        "x_sd_nm": sd[:, 0],
        "y_sd_nm": sd[:, 1],
        "distance_nm": length,
        "distance_sd_nm": along,
        "moving_median_nm": moving_median(length, options.median_frames),
        "angle_rad": np.arctan2(-vector[:, 1], vector[:, 0]),
        "late_s": pair.late_s,
    }
    return pd.DataFrame(values)[END_TO_END.names]


def _rotor_row(
    pair: Pair, shift: LocalShift, distance: Distance, registration: Registration
) -> dict[str, object]:
    """Give a rotor's row of END_TO_END_ROTORS."""
    rings = both_rings(
        pair.first, pair.second, registration_sd_nm=pair.map_sd_nm, stretch=pair.stretch
    )
    vector, length = pair.vector, pair.length
    axis = preferred_axis(np.arctan2(-vector[:, 1], vector[:, 0]))
    stretch, best, told = pair.stretch, distance.default, distance.told_noise_nm
    # Of a vector that stays, the registration's error goes straight into its length.
    fixed = pair.constancy * pair.map_sd_nm

    def with_map(sd: float) -> float:
        return stretch * math.hypot(sd, fixed)

    beyond = _INTERVAL * fixed
    return {
        "rotor": pair.rotor,
        "n_frames": len(length),
        "end_to_end_nm": stretch * best.mean_nm,
        "end_to_end_sd_nm": with_map(best.mean_sd_nm),
        "lasting_sd_nm": with_map(distance.lasting_sd_nm),
        "end_to_end_ci_low_nm": stretch
        * max(best.mean_nm - math.hypot(best.mean_nm - best.low_nm, beyond), 0.0),
        "end_to_end_ci_high_nm": stretch
        * (best.mean_nm + math.hypot(best.high_nm - best.mean_nm, beyond)),
        "breathing_nm": stretch * best.breathing_nm,
        "breathing_sd_nm": stretch * best.breathing_sd_nm,
        "noise_nm": best.scale * told,
        "noise_sd_nm": best.scale_sd * told,
        "told_noise_nm": told,
        "known_nm": stretch * distance.known.mean_nm,
        "known_sd_nm": with_map(distance.known.mean_sd_nm),
        "free_nm": stretch * distance.free.mean_nm,
        "free_sd_nm": with_map(distance.free.mean_sd_nm),
        "free_ci_low_nm": stretch * distance.free.low_nm,
        "free_ci_high_nm": stretch * distance.free.high_nm,
        "plain_mean_nm": distance.plain_mean_nm,
        "moment_nm": distance.moment_nm,
        "moving_median_nm": float(np.median(moving_median(length))),
        "registration_error_nm": pair.map_sd_nm,
        "extrapolated": not bool(registration.inside(pair.place[np.newaxis])[0]),
        **{name: value for name, value in vars(rings).items() if name in END_TO_END_ROTORS.dtypes},
        "turns": shift.turns,
        "shift_x_nm": shift.x_nm,
        "shift_y_nm": shift.y_nm,
        "shift_sd_nm": shift.sd_nm,
        "corrected_nm": stretch * shift.radius_nm if shift.rigid else math.nan,
        "corrected_sd_nm": stretch * shift.radius_sd_nm if shift.rigid else math.nan,
        "rigid": shift.rigid,
        "rigid_reason": shift.reason,
        "axis_deg": axis.axis_deg,
        "order": axis.order,
        "order_p": axis.order_p,
    }


def _notes(rotors: pd.DataFrame, pairs: list[Pair]) -> Iterator[str]:
    outside = int(rotors["extrapolated"].sum())
    if outside:
        yield (
            f"{outside} rotors with both ends lie outside the registration's beads, where its "
            "error is not known (extrapolated): film beads there"
        )
    lagging = [
        str(pair.rotor)
        for pair in pairs
        if not pair.turning_known and np.nanmax(np.abs(pair.late_s), initial=0.0) > 0.0
    ]
    if lagging:
        yield (
            f"how far rotors {', '.join(lagging)} turn in a frame could not be told, so that what "
            "a rolling shutter adds to their distances is not taken off"
        )
