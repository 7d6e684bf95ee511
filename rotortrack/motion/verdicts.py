"""Verdicts from tables of decisions, and what people decided instead."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from enum import Enum

import numpy as np
import pandas as pd

from rotortrack.errors import ConfigurationError, TableError, UsageError
from rotortrack.motion.screen_options import ScreenOptions
from rotortrack.rotors.curation import HumanVerdict
from rotortrack.tables import DECISIONS, ROTORS, conform

KEPT, REFUSED = "kept", "refused"

HUMAN = "human_verdict"
"""Feature of the row that a human verdict has among the decisions; it alone counts then."""


class Reason(Enum):
    """Why a rotor is refused; the value is the code in the rotors table.

    A rotor that fails several tests gets the first reason in this order.
    """

    BY_HAND = "by_hand"
    TOO_FEW_FRAMES = "too_few_frames"
    FRAGMENT = "fragment"
    SEVERAL_ROTORS = "several_rotors"
    IMMOBILE = "immobile"
    PARTIAL_ARC = "partial_arc"
    NO_CIRCLE = "no_circle"
    CENTRE_MOVES = "centre_moves"
    NEIGHBOURS_TOO_CLOSE = "neighbours_too_close"

    @property
    def sentence(self) -> str:
        """The meaning of the code, as shown to the user."""
        return _SENTENCES[self]


_SENTENCES = {
    Reason.BY_HAND: "A person refused it.",
    Reason.TOO_FEW_FRAMES: (
        "It was localised in too few frames to be tracked, or not at all for too long."
    ),
    Reason.FRAGMENT: (
        "It is a piece of a rotor whose other pieces are clusters of their own: raise distance_nm."
    ),
    Reason.SEVERAL_ROTORS: (
        "Its intensity rises or falls in a step, it is often seen twice in a frame, or it traces "
        "two rings: more than one rotor is in the pore."
    ),
    Reason.IMMOBILE: "Its positions scatter about a point, not about a ring: it does not move.",
    Reason.PARTIAL_ARC: "It visits too short an arc to determine its circle.",
    Reason.NO_CIRCLE: "Its positions do not follow a circle well enough to measure angles.",
    Reason.CENTRE_MOVES: (
        "The centre of its circle moves in the course of the movie: it is not held in one place, "
        "or drift was left."
    ),
    Reason.NEIGHBOURS_TOO_CLOSE: (
        "Another rotor is so close that their images, and so their positions, disturb each other."
    ),
}


def replay(
    decisions: pd.DataFrame, thresholds: ScreenOptions | Mapping[str, float] | None = None
) -> pd.DataFrame:
    """Judge rotors again from their stored features, without localisations.

    Parameters
    ----------
    decisions
        Table of `screen.Screening` or of a run folder.
    thresholds
        Others than the stored ones, by the name of their option, or all of them. The margin to
        neighbours stays as stored where the options leave it to the width of the spots. Options
        that shape a feature (arc_elongation, neighbour_share) are no thresholds and stay, too.

    Returns
    -------
    DataFrame
        rotor, verdict, reason; in the order of the decisions. A human verdict stands, whatever the
        thresholds.

    Raises
    ------
    UsageError
        A name is that of no stored threshold.
    TableError
        The decisions do not tell which options their thresholds are.
    """
    limit = decisions["threshold"].to_numpy(dtype=np.float64)
    if thresholds is not None:
        limit = _other_thresholds(decisions, limit, thresholds)
    value = decisions["value"].to_numpy(dtype=np.float64)
    # What is not known (nan) is no reason to refuse.
    failed = np.where(decisions["rule"] == ">=", value < limit, value > limit)
    human = decisions["feature"] == HUMAN
    by_hand = decisions["rotor"].isin(decisions.loc[human, "rotor"])
    failures = decisions.loc[failed & (human | ~by_hand)].drop_duplicates("rotor")
    first = dict(zip(failures["rotor"], failures["reason"], strict=True))
    rotors = decisions["rotor"].unique()
    reason = [first.get(number, "") for number in rotors]
    verdict = [REFUSED if code else KEPT for code in reason]
    told = {"rotor": rotors, "verdict": verdict, "reason": reason}
    return pd.DataFrame(told).astype({"rotor": "int64", "verdict": "str", "reason": "str"})


def overrule(
    rotors: pd.DataFrame, decisions: pd.DataFrame, verdicts: Mapping[int, HumanVerdict]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Put human verdicts in the place of automatic ones, and say so among the decisions.

    Human verdicts that the tables hold from before give way: what is no longer said is undone.

    Parameters
    ----------
    rotors, decisions
        As screened, or as an earlier call left them.
    verdicts
        By the number of their rotor in these tables.

    Returns
    -------
    Both tables. Each human verdict has a row with the feature `human_verdict`: value 1 (kept) or 0
    (refused), verdict_before, verdict_after and remark.

    Raises
    ------
    ConfigurationError
        A rotor without a circle is to be kept: there is nothing to measure angles about.
    """
    human = decisions["feature"] == HUMAN
    undone = decisions.loc[human, "rotor"]
    decisions = decisions[~human]
    automatic = replay(decisions[decisions["rotor"].isin(undone)]).set_index("rotor")
    told = rotors.set_index("rotor")[["verdict", "reason"]].copy()
    told.update(automatic)
    mistakes, rows = [], []
    for number, said in verdicts.items():
        circle = rotors.loc[rotors["rotor"] == number, "radius_nm"]
        if said.verdict == KEPT and circle.isna().any():
            mistakes.append(
                f"rotor {number} has no circle, so that nothing can be measured and it cannot be "
                "kept: remove its [[rotor]] from curation.toml"
            )
        before, why = told.loc[number, ["verdict", "reason"]]
        told.loc[number] = (said.verdict, "" if said.verdict == KEPT else Reason.BY_HAND.value)
        rows.append(
            {
                "rotor": number,
                "feature": HUMAN,
                "value": float(said.verdict == KEPT),
                "rule": ">=",
                "threshold": 1.0,
                "passed": said.verdict == KEPT,
                "reason": Reason.BY_HAND.value,
                "option": "",
                "verdict_before": f"{before}: {why}" if why else before,
                "verdict_after": said.verdict,
                "remark": said.remark,
            }
        )
    if mistakes:
        raise ConfigurationError(*mistakes)
    if rows:
        decisions = pd.concat([decisions, pd.DataFrame(rows)], ignore_index=True)
        texts = ["option", "verdict_before", "verdict_after", "remark"]
        decisions[texts] = decisions[texts].fillna("")
    told = told.loc[rotors["rotor"]]
    rotors = rotors.assign(verdict=told["verdict"].to_numpy(), reason=told["reason"].to_numpy())
    return conform(rotors, ROTORS, "rotors"), conform(
        decisions.reset_index(drop=True), DECISIONS, "decisions"
    )


def _other_thresholds(
    decisions: pd.DataFrame,
    stored: np.ndarray[tuple[int], np.dtype[np.float64]],
    thresholds: ScreenOptions | Mapping[str, float],
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Exchange the stored thresholds of those options that are given."""
    if "option" not in decisions:
        raise TableError(
            "the decisions are of an earlier version and do not tell the options behind their "
            "thresholds: screen the rotors again"
        )
    names = set(decisions["option"]) - {""}
    if isinstance(thresholds, ScreenOptions):
        given = dataclasses.asdict(thresholds)
        chosen = {name: given[name] for name in names if given.get(name) is not None}
    else:
        chosen = dict(thresholds)
        unknown = sorted(chosen.keys() - names) if len(decisions) else []
        if unknown:
            raise UsageError(
                f"{unknown[0]} is no threshold of these decisions: known are "
                f"{', '.join(sorted(names))}"
            )
    other = decisions["option"].map(chosen).to_numpy(dtype=np.float64)
    return np.where(np.isnan(other), stored, other)
