"""Which rotors are measured, and the one reason why each of the others is not."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import KDTree

from rotortrack.errors import TableError
from rotortrack.motion.intensity import intensity_step
from rotortrack.motion.screen_options import ScreenOptions
from rotortrack.rotors.circle import CircleEnd
from rotortrack.rotors.per_frame import is_duplicate
from rotortrack.rotors.ring import ring_evidence
from rotortrack.tables import ROTORS, conform

KEPT, REFUSED = "kept", "refused"


class Reason(Enum):
    """Why a rotor is refused; the value is the code in the rotors table.

    A rotor that fails several tests gets the first reason in this order.
    """

    TOO_FEW_FRAMES = "too_few_frames"
    SEVERAL_ROTORS = "several_rotors"
    IMMOBILE = "immobile"
    PARTIAL_ARC = "partial_arc"
    NO_CIRCLE = "no_circle"
    NEIGHBOURS_TOO_CLOSE = "neighbours_too_close"

    @property
    def sentence(self) -> str:
        """The meaning of the code, as shown to the user."""
        return _SENTENCES[self]


_SENTENCES = {
    Reason.TOO_FEW_FRAMES: "It was localised in too few frames to be tracked.",
    Reason.SEVERAL_ROTORS: (
        "Its intensity rises in a step, or it is often seen twice in a frame: more than one rotor "
        "is in the pore."
    ),
    Reason.IMMOBILE: "Its positions scatter about a point, not about a ring: it does not move.",
    Reason.PARTIAL_ARC: "It visits too short an arc to determine its circle.",
    Reason.NO_CIRCLE: "Its positions do not follow a circle well enough to measure angles.",
    Reason.NEIGHBOURS_TOO_CLOSE: (
        "Another rotor is so close that their images, and so their positions, disturb each other."
    ),
}


MARGIN_IN_WIDTHS = 5.0
"""On films of two rotors a gap of 500 nm still moved centres by 2 nm, one of 600 nm by 0.6 nm."""

TYPICAL_WIDTH_NM = 130.0
"""Width of a spot for tables that do not tell it."""


@dataclass(frozen=True)
class Screening:
    """Outcome of the screening.

    `rotors` is the given table with verdict (kept, refused) and reason (code of `Reason`, empty
    when kept). `decisions` has a row for every rotor and feature in the order of the tests: rotor,
    feature, value, rule (">=" or "<="), threshold, passed, reason; a verdict follows from it alone.
    A feature whose value is nan because the table lacks what it needs passes.
    """

    rotors: pd.DataFrame
    decisions: pd.DataFrame


def screen(
    localisations: pd.DataFrame,
    rotors: pd.DataFrame,
    options: ScreenOptions | None = None,
    *,
    n_frames: int,
    drift_sd_nm: float = 0.0,
) -> Screening:
    """Keep the rotors that visit enough of one circle, alone, in enough frames.

    Parameters
    ----------
    localisations
        Table with frame, x_nm, y_nm and rotor; photons, uncertainty_nm and fit_flags where known.
    rotors
        Table of `rotortrack.rotors.find.find_rotors`.
    options
        Thresholds; default: ScreenOptions().
    n_frames
        Frames of the movie.
    drift_sd_nm
        Error of the drift correction per axis, nm; it widens what noise alone explains.

    Raises
    ------
    TableError
        A needed column is missing.

    Notes
    -----
    About 4 ms a rotor of 3000 localisations.
    """
    thresholds = options or ScreenOptions()
    for table, name, needed in (
        (localisations, "localisations", ("frame", "x_nm", "y_nm", "rotor")),
        (rotors, "rotors", ("rotor", "x_nm", "y_nm", "radius_nm", "n_localisations")),
    ):
        missing = [column for column in needed if column not in table]
        if missing:
            raise TableError(f"the {name} lack the column(s) {', '.join(missing)}")
    members = localisations.groupby("rotor").indices
    none = np.empty(0, dtype=np.int64)
    margin = _neighbour_margin_nm(localisations, thresholds)
    gaps = _gaps_to_neighbours(rotors, margin, thresholds.neighbour_share)
    decisions = [
        (rotor["rotor"], *test)
        for rotor, gap in zip(rotors.to_dict("records"), gaps, strict=True)
        for test in _tests(
            localisations.iloc[members.get(rotor["rotor"], none)],
            rotor,
            (gap, margin),
            thresholds,
            n_frames,
            drift_sd_nm,
        )
    ]
    table = pd.DataFrame(
        decisions,
        columns=["rotor", "feature", "value", "rule", "threshold", "passed", "reason"],
    ).astype({"rotor": "int64", "value": "float64", "threshold": "float64", "passed": "bool"})
    failed = table[~table["passed"]].drop_duplicates("rotor").set_index("rotor")["reason"].to_dict()
    reason = [failed.get(number, "") for number in rotors["rotor"]]
    verdict = [REFUSED if code else KEPT for code in reason]
    return Screening(
        rotors=conform(rotors.assign(verdict=verdict, reason=reason), ROTORS, "rotors"),
        decisions=table,
    )


def position_spread_nm(x_nm: NDArray[np.float64], y_nm: NDArray[np.float64]) -> tuple[float, float]:
    """Measure the standard deviation of positions per axis, and their elongation.

    The outermost 2.5 % are left out and the spread corrected for that: a few background spots
    250 nm away would make a stuck spot look mobile. The correction is that of a Gaussian spot (the
    squared distance is exponential) and makes a ring's spread 4 % too large.

    Parameters
    ----------
    x_nm, y_nm
        Positions, shape (n,), nm.

    Returns
    -------
    Spread, nm, and elongation, >= 1; nan for fewer than three positions.
    """
    if x_nm.size < 3:
        return math.nan, math.nan
    square = (x_nm - np.median(x_nm)) ** 2 + (y_nm - np.median(y_nm)) ** 2
    inner = np.argsort(square, kind="stable")[: max(3, math.ceil(0.975 * square.size))]
    left_out = 1.0 - inner.size / square.size
    factor = 1.0 + left_out * math.log(left_out) / (1.0 - left_out) if left_out > 0.0 else 1.0
    minor, major = np.linalg.eigvalsh(np.cov(x_nm[inner], y_nm[inner]))
    elongation = math.sqrt(major / minor) if minor > 0.0 else math.inf
    return math.sqrt(0.5 * float(major + minor) / factor), elongation


def _tests(
    spots: pd.DataFrame,
    rotor: dict[Hashable, Any],
    gap_and_margin_nm: tuple[float, float],
    limits: ScreenOptions,
    n_frames: int,
    drift_sd_nm: float,
) -> Iterator[tuple[str, float, str, float, bool, str]]:
    """Feature, value, rule, threshold, passed and reason code of every test of one rotor."""
    repeated = is_duplicate(spots)
    frame = spots["frame"].to_numpy(dtype=np.int64)
    x = spots["x_nm"].to_numpy(dtype=np.float64)[~repeated]
    y = spots["y_nm"].to_numpy(dtype=np.float64)[~repeated]
    frames = x.size
    yield _at_least("frames", frames, limits.min_frames, Reason.TOO_FEW_FRAMES)
    detection = frames / max(1, n_frames)
    yield _at_least("detection", detection, limits.min_detection, Reason.TOO_FEW_FRAMES)
    twice = np.unique(frame[repeated]).size / max(1, frames)
    yield _at_most("duplicates", twice, limits.max_duplicates, Reason.SEVERAL_ROTORS)
    step = math.nan
    if "photons" in spots:
        step, _ = intensity_step(frame, spots["photons"].to_numpy(dtype=np.float64))
    yield _at_most("intensity_step", step, limits.max_intensity_step, Reason.SEVERAL_ROTORS)
    residual = rotor.get("residual_sd_nm", math.nan)
    noise = rotor.get("localisation_sd_nm", math.nan)
    # The residual knows of the drift's error already.
    noise = residual if math.isnan(noise) else math.hypot(noise, drift_sd_nm)
    spread, elongation = position_spread_nm(x, y)
    yield _at_least("spread", spread / noise, limits.min_spread, Reason.IMMOBILE)
    too_short = rotor.get("circle") == CircleEnd.ARC_TOO_SHORT.value
    # About a short arc's mean position there is no ring, yet it moves.
    stretched = too_short or elongation >= limits.arc_elongation
    blob = Reason.PARTIAL_ARC if stretched else Reason.IMMOBILE
    told = math.hypot(rotor.get("localisation_sd_nm", math.nan), drift_sd_nm)
    evidence = ring_evidence(x, y, rotor["x_nm"], rotor["y_nm"], told)
    yield _at_least("ring_evidence", evidence, limits.min_ring_evidence, blob)
    arc = 0.0 if too_short else rotor.get("arc_deg", math.nan)
    yield _at_least("arc_deg", arc, limits.min_arc_deg, Reason.PARTIAL_ARC)
    # No circle: an infinite error fails where nan, "not known", would pass.
    radius = rotor["radius_nm"]
    no_circle = math.isnan(radius)
    error = math.inf if no_circle else rotor.get("radius_sd_nm", math.nan) / radius
    yield _at_most("radius_error", error, limits.max_radius_error, Reason.NO_CIRCLE)
    yield _at_most("residual", residual / noise, limits.max_residual, Reason.NO_CIRCLE)
    yield _at_least("neighbour_gap_nm", *gap_and_margin_nm, Reason.NEIGHBOURS_TOO_CLOSE)


def _at_least(
    feature: str, value: float, threshold: float, reason: Reason
) -> tuple[str, float, str, float, bool, str]:
    return feature, value, ">=", threshold, not value < threshold, reason.value


def _at_most(
    feature: str, value: float, threshold: float, reason: Reason
) -> tuple[str, float, str, float, bool, str]:
    return feature, value, "<=", threshold, not value > threshold, reason.value


def _neighbour_margin_nm(localisations: pd.DataFrame, limits: ScreenOptions) -> float:
    """Gap below which the light of a neighbour shifts a fit."""
    if limits.neighbour_margin_nm is not None:
        return limits.neighbour_margin_nm
    width = math.nan
    if "sigma_nm" in localisations:
        width = float(localisations["sigma_nm"].median())
    return MARGIN_IN_WIDTHS * (TYPICAL_WIDTH_NM if math.isnan(width) else width)


def _gaps_to_neighbours(
    rotors: pd.DataFrame, margin_nm: float, share: float
) -> NDArray[np.float64]:
    """Gap between each rotor's circle and the nearest other one, nm; inf when none is near.

    Neighbours without a circle are points; those with few localisations are specks of background.
    """
    gaps = np.full(len(rotors), np.inf)
    if len(rotors) < 2:
        return gaps
    centres = rotors[["x_nm", "y_nm"]].to_numpy(dtype=np.float64)
    radius = rotors["radius_nm"].fillna(0.0).to_numpy(dtype=np.float64)
    size = rotors["n_localisations"].to_numpy(dtype=np.float64)
    reach = 2.0 * float(radius.max()) + margin_nm
    for a, others in enumerate(KDTree(centres).query_ball_point(centres, reach)):
        near = np.array(others)
        near = near[(near != a) & (size[near] >= share * size[a])]
        if near.size:
            away = np.hypot(*(centres[near] - centres[a]).T) - radius[near] - radius[a]
            gaps[a] = away.min()
    return gaps
