"""Which rotors are measured, and the one reason why each of the others is not."""

from __future__ import annotations

import math
import warnings
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import KDTree

from rotortrack.errors import DriftWarning, TableError
from rotortrack.motion.centre_motion import CentreMotion, centre_motion, common_motion
from rotortrack.motion.intensity import intensity_steps
from rotortrack.motion.screen_options import ScreenOptions
from rotortrack.motion.verdicts import Reason, replay
from rotortrack.rotors.circle import CircleEnd
from rotortrack.rotors.fragments import find_fragments
from rotortrack.rotors.per_frame import is_duplicate
from rotortrack.rotors.ring import ring_evidence
from rotortrack.rotors.two_rings import two_rings
from rotortrack.tables import DECISIONS, ROTORS, conform

MARGIN_IN_WIDTHS = 5.0
"""On films of two rotors a gap of 500 nm still moved centres by 2 nm, one of 600 nm by 0.6 nm."""

TYPICAL_WIDTH_NM = 130.0
"""Width of a spot for tables that do not tell it."""

SIGNIFICANT = 4.5
"""Standard deviations from which a common motion is not chance."""

Test = tuple[str, float, str, float, bool, str, str]
"""Feature, value, rule, threshold, passed, reason code, option that is the threshold."""


@dataclass(frozen=True)
class Screening:
    """Outcome of the screening.

    `rotors` is the given table with verdict (kept, refused) and reason (code of `Reason`, empty
    when kept). `decisions` has a row for every rotor and feature in the order of the tests: rotor,
    feature, value, rule (">=" or "<="), threshold, passed, reason, option; verdicts follow from it
    alone (`verdicts.replay`). A feature whose value is nan because the table lacks what it needs
    passes.
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

    Warns
    -----
    DriftWarning
        The centres of many circles move together.

    Notes
    -----
    About 9 ms a rotor of 3000 localisations.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> import rotortrack as rt
    >>> turn = 0.08 * np.arange(200)
    >>> noise = np.random.default_rng(1).normal(0.0, 8.0, (2, 200))
    >>> spots = pd.DataFrame(
    ...     {
    ...         "frame": np.arange(200),
    ...         "x_nm": 500.0 + 120.0 * np.cos(turn) + noise[0],
    ...         "y_nm": 500.0 - 120.0 * np.sin(turn) + noise[1],
    ...     }
    ... ).assign(uncertainty_nm=8.0, x_sd_nm=8.0, y_sd_nm=8.0, photons=500.0)
    >>> found = rt.find_rotors(spots)
    >>> judged = rt.screen(found.localisations, found.rotors, n_frames=200)
    >>> judged.rotors["verdict"].tolist()
    ['kept']
    """
    thresholds = options or ScreenOptions()
    for table, name, needed in (
        (localisations, "localisations", ("frame", "x_nm", "y_nm", "rotor")),
        (rotors, "rotors", ("rotor", "x_nm", "y_nm", "radius_nm", "n_localisations")),
    ):
        missing = [column for column in needed if column not in table]
        if missing:
            raise TableError(f"the {name} lack the column(s) {', '.join(missing)}")
    film = _Film.of(localisations, rotors, thresholds, n_frames, drift_sd_nm)
    decisions = [
        (rotor["rotor"], *test)
        for rotor in rotors.to_dict("records")
        for test in _tests(rotor, film, thresholds)
    ]
    names = ["rotor", "feature", "value", "rule", "threshold", "passed", "reason", "option"]
    table = conform(pd.DataFrame(decisions, columns=names), DECISIONS, "decisions")
    verdicts = replay(table).set_index("rotor").loc[rotors["rotor"]]
    _warn_of_drift(film.centres, rotors, thresholds)
    judged = rotors.assign(
        verdict=verdicts["verdict"].to_numpy(), reason=verdicts["reason"].to_numpy()
    )
    return Screening(rotors=conform(judged, ROTORS, "rotors"), decisions=table)


@dataclass(frozen=True)
class _Film:
    """What the tests of one rotor need of all the film.

    Attributes
    ----------
    spots
        Localisations of every rotor, by its number.
    gaps_nm, margin_nm
        Gap to the nearest neighbour, by number, and the one below which its light disturbs.
    fragments
        Part of a rotor's localisations that lies in other clusters, by number.
    centres
        How the centre moves, of those with a circle.
    """

    spots: Mapping[int, pd.DataFrame]
    gaps_nm: Mapping[int, float]
    margin_nm: float
    fragments: Mapping[int, float]
    centres: Mapping[int, CentreMotion]
    n_frames: int
    drift_sd_nm: float

    @classmethod
    def of(
        cls,
        localisations: pd.DataFrame,
        rotors: pd.DataFrame,
        limits: ScreenOptions,
        n_frames: int,
        drift_sd_nm: float,
    ) -> _Film:
        single = localisations[~is_duplicate(localisations)]
        noise = math.nan
        if "uncertainty_nm" in single:
            noise = math.hypot(float(single["uncertainty_nm"].median()), drift_sd_nm)
        whole = find_fragments(single, noise)
        numbers = rotors["rotor"].to_numpy(dtype=np.int64)
        rotor_of = np.array([whole.get(number, number) for number in numbers], dtype=np.int64)
        size = rotors["n_localisations"].to_numpy(dtype=np.float64)
        joined = pd.Series(size).groupby(rotor_of).transform("sum").to_numpy()
        margin = _neighbour_margin_nm(localisations, limits)
        gaps = _gaps_to_neighbours(rotors, margin, limits.neighbour_share, rotor_of)
        shares = 1.0 - size / np.maximum(joined, 1.0)
        frame = localisations["frame"]
        first = int(frame.min()) if len(frame) else 0
        extent = (first, max(int(frame.max()) + 1 if len(frame) else 0, first + n_frames))
        members = _rows_of(single)
        return cls(
            spots={
                number: localisations.iloc[rows] for number, rows in _rows_of(localisations).items()
            },
            gaps_nm=dict(zip(numbers, gaps, strict=True)),
            margin_nm=margin,
            fragments=dict(zip(numbers, shares, strict=True)),
            centres={
                row["rotor"]: _centre_of(single.iloc[members[row["rotor"]]], row, extent)
                for row in rotors.to_dict("records")
                if row["radius_nm"] > 0.0 and row["rotor"] in members
            },
            n_frames=n_frames,
            drift_sd_nm=drift_sd_nm,
        )


def _rows_of(localisations: pd.DataFrame) -> dict[Any, NDArray[np.int64]]:
    """Rows of every rotor, by its number."""
    groups = localisations.groupby("rotor").indices
    return {number: np.asarray(rows, dtype=np.int64) for number, rows in groups.items()}


def _centre_of(
    spots: pd.DataFrame, rotor: dict[Hashable, Any], extent: tuple[int, int]
) -> CentreMotion:
    return centre_motion(
        spots["frame"].to_numpy(dtype=np.int64),
        spots["x_nm"].to_numpy(dtype=np.float64),
        spots["y_nm"].to_numpy(dtype=np.float64),
        (rotor["x_nm"], rotor["y_nm"], rotor["radius_nm"]),
        extent,
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


def _tests(rotor: dict[Hashable, Any], film: _Film, limits: ScreenOptions) -> Iterator[Test]:
    """All tests of one rotor, in the order in which they count."""
    number = rotor["rotor"]
    spots = film.spots.get(number, pd.DataFrame(columns=["frame", "x_nm", "y_nm"]))
    repeated = is_duplicate(spots)
    once = spots[~repeated].sort_values("frame")
    yield from _presence_tests(once, film.n_frames, limits)
    yield _at_most("fragment", film.fragments[number], limits, "max_fragment", Reason.FRAGMENT)
    yield from _company_tests(spots, repeated, limits)
    yield from _circle_tests(once, rotor, film.drift_sd_nm, limits)
    centre = film.centres.get(number)
    motion = math.nan if centre is None else centre.wander_nm / rotor["radius_nm"]
    yield _at_most("centre_motion", motion, limits, "max_centre_motion", Reason.CENTRE_MOVES)
    # A centre that slides draws several rings, so it is asked first.
    circle = (rotor["x_nm"], rotor["y_nm"], rotor["radius_nm"])
    second = math.nan
    if not math.isnan(circle[2]):
        x, y = (once[name].to_numpy(dtype=np.float64) for name in ("x_nm", "y_nm"))
        second = two_rings(x, y, circle)
    yield _at_most("two_rings", second, limits, "max_two_rings", Reason.SEVERAL_ROTORS)
    gap, margin = film.gaps_nm[number], film.margin_nm
    close = Reason.NEIGHBOURS_TOO_CLOSE.value
    name = "neighbour_margin_nm"
    yield "neighbour_gap_nm", gap, ">=", margin, not gap < margin, close, name


def _presence_tests(once: pd.DataFrame, n_frames: int, limits: ScreenOptions) -> Iterator[Test]:
    """Whether it was seen often enough; `once` has a row a frame, in their order."""
    few = Reason.TOO_FEW_FRAMES
    yield _at_least("frames", len(once), limits, "min_frames", few)
    yield _at_least("detection", len(once) / max(1, n_frames), limits, "min_detection", few)
    missing = int((np.diff(once["frame"].to_numpy(dtype=np.int64)) - 1).max(initial=0))
    yield _at_most("longest_gap", missing / max(1, n_frames), limits, "max_gap", few)


def _company_tests(
    spots: pd.DataFrame, repeated: NDArray[np.bool_], limits: ScreenOptions
) -> Iterator[Test]:
    """Whether it is alone in its pore."""
    several = Reason.SEVERAL_ROTORS
    frame = spots["frame"].to_numpy(dtype=np.int64)
    twice = np.unique(frame[repeated]).size / max(1, int((~repeated).sum()))
    yield _at_most("duplicates", twice, limits, "max_duplicates", several)
    rise = fall = math.nan
    if "photons" in spots:
        steps = intensity_steps(frame, spots["photons"].to_numpy(dtype=np.float64))
        rise, fall = steps.rise, steps.fall
    yield _at_most("intensity_step", rise, limits, "max_intensity_step", several)
    yield _at_most("intensity_fall", fall, limits, "max_intensity_fall", several)


def _circle_tests(
    once: pd.DataFrame, rotor: dict[Hashable, Any], drift_sd_nm: float, limits: ScreenOptions
) -> Iterator[Test]:
    """Whether it traces enough of one circle."""
    x, y = (once[name].to_numpy(dtype=np.float64) for name in ("x_nm", "y_nm"))
    residual = rotor.get("residual_sd_nm", math.nan)
    noise = rotor.get("localisation_sd_nm", math.nan)
    # The residual knows of the drift's error already.
    noise = residual if math.isnan(noise) else math.hypot(noise, drift_sd_nm)
    spread, elongation = position_spread_nm(x, y)
    yield _at_least("spread", spread / noise, limits, "min_spread", Reason.IMMOBILE)
    too_short = rotor.get("circle") == CircleEnd.ARC_TOO_SHORT.value
    # About a short arc's mean position there is no ring, yet it moves.
    stretched = too_short or elongation >= limits.arc_elongation
    blob = Reason.PARTIAL_ARC if stretched else Reason.IMMOBILE
    told = math.hypot(rotor.get("localisation_sd_nm", math.nan), drift_sd_nm)
    evidence = ring_evidence(x, y, rotor["x_nm"], rotor["y_nm"], told)
    yield _at_least("ring_evidence", evidence, limits, "min_ring_evidence", blob)
    arc = 0.0 if too_short else rotor.get("arc_deg", math.nan)
    yield _at_least("arc_deg", arc, limits, "min_arc_deg", Reason.PARTIAL_ARC)
    radius = rotor["radius_nm"]
    no_circle = math.isnan(radius)
    # No circle: an infinite error fails where nan, "not known", would pass.
    error = math.inf if no_circle else rotor.get("radius_sd_nm", math.nan) / radius
    yield _at_most("radius_error", error, limits, "max_radius_error", Reason.NO_CIRCLE)
    yield _at_most("residual", residual / noise, limits, "max_residual", Reason.NO_CIRCLE)


def _at_least(
    feature: str, value: float, limits: ScreenOptions, option: str, reason: Reason
) -> Test:
    threshold = float(getattr(limits, option))
    return feature, value, ">=", threshold, not value < threshold, reason.value, option


def _at_most(
    feature: str, value: float, limits: ScreenOptions, option: str, reason: Reason
) -> Test:
    threshold = float(getattr(limits, option))
    return feature, value, "<=", threshold, not value > threshold, reason.value, option


def _warn_of_drift(
    centres: Mapping[int, CentreMotion], rotors: pd.DataFrame, limits: ScreenOptions
) -> None:
    """Tell of a motion that many rotors share; it is the film's, so that none is refused for it."""
    enough = rotors.loc[rotors["n_localisations"] >= limits.min_frames, "rotor"]
    told = [centres[number] for number in enough if number in centres]
    common_nm, significance = common_motion(told)
    if common_nm > limits.max_common_motion_nm and significance > SIGNIFICANT:
        warnings.warn(
            f"the centres of {len(told)} circles move together by {common_nm:.0f} nm rms per axis "
            "in the course of the movie, so drift was left: subtract it with `rotortrack drift`, "
            "or with another drift.method",
            DriftWarning,
            stacklevel=3,
        )


def _neighbour_margin_nm(localisations: pd.DataFrame, limits: ScreenOptions) -> float:
    """Gap below which the light of a neighbour shifts a fit."""
    if limits.neighbour_margin_nm is not None:
        return limits.neighbour_margin_nm
    width = math.nan
    if "sigma_nm" in localisations:
        width = float(localisations["sigma_nm"].median())
    return MARGIN_IN_WIDTHS * (TYPICAL_WIDTH_NM if math.isnan(width) else width)


def _gaps_to_neighbours(
    rotors: pd.DataFrame, margin_nm: float, share: float, rotor_of: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Gap between each rotor's circle and the nearest other one, nm; inf when none is near.

    Neighbours without a circle are points; those with few localisations are specks of background.
    Pieces of one rotor (`rotor_of`) are no neighbours.
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
        near = near[(rotor_of[near] != rotor_of[a]) & (size[near] >= share * size[a])]
        if near.size:
            away = np.hypot(*(centres[near] - centres[a]).T) - radius[near] - radius[a]
            gaps[a] = away.min()
    return gaps
