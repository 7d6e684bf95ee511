"""Verdicts replayed from decisions alone, and people who overrule them."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError, TableError, UsageError
from rotortrack.motion.screen import screen
from rotortrack.motion.screen_options import ScreenOptions
from rotortrack.motion.verdicts import HUMAN, overrule, replay
from rotortrack.rotors.curation import HumanVerdict
from rotortrack.rotors.find import find_rotors

FRAMES = 1500
COLUMNS = ["rotor", "verdict", "reason"]


@functools.cache
def found():
    """Twelve rotors, good and bad, in a row."""
    rng = np.random.default_rng(1)
    tables = []
    for number in range(12):
        kind = ("driven", "stuck", "arc", "step", "rare", "sliding")[number % 6]
        noise, radius = rng.uniform(8.0, 25.0), rng.uniform(60.0, 180.0)
        theta = np.cumsum(rng.normal(0.02, 0.3, FRAMES))
        theta = {"arc": np.abs(theta % 2.0 - 1.0)}.get(kind, theta)
        reach = 0.0 if kind == "stuck" else radius
        slide = 25.0 * np.sin(np.arange(FRAMES) / 150.0) * (kind == "sliding")
        frame = np.flatnonzero(rng.random(FRAMES) < (0.05 if kind == "rare" else 0.8))
        photons = 1000.0 * np.exp(0.15 * rng.normal(size=FRAMES))
        photons[700:] *= 2.0 if kind == "step" else 1.0
        x = 900.0 * number + reach * np.cos(theta) + slide + noise * rng.normal(size=FRAMES)
        y = reach * np.sin(theta) + noise * rng.normal(size=FRAMES)
        part = {"frame": frame, "x_nm": x[frame], "y_nm": y[frame], "photons": photons[frame]}
        tables.append(pd.DataFrame({**part, "uncertainty_nm": noise}))
    return find_rotors(pd.concat(tables, ignore_index=True))


def screened(options=None):
    return screen(found().localisations, found().rotors, options, n_frames=FRAMES)


@functools.cache
def default():
    return screened()


THRESHOLDS = {
    "min_frames": st.integers(1, FRAMES),
    "min_detection": st.floats(0.0, 1.0),
    "max_gap": st.floats(1e-3, 1.0),
    "max_fragment": st.floats(0.0, 1.0),
    "max_duplicates": st.floats(0.0, 1.0),
    "max_intensity_step": st.floats(1.001, 3.0),
    "max_intensity_fall": st.floats(1.001, 3.0),
    "min_spread": st.floats(0.0, 20.0),
    "min_ring_evidence": st.floats(0.0, 2000.0),
    "min_arc_deg": st.floats(0.0, 360.0),
    "max_residual": st.floats(0.5, 5.0),
    "max_two_rings": st.floats(0.0, 100.0),
    "max_radius_error": st.floats(1e-4, 1.0),
    "max_centre_motion": st.floats(1e-3, 1.0),
    "neighbour_margin_nm": st.none() | st.floats(0.0, 900.0),
}


def test_the_stored_decisions_give_the_verdicts_of_the_run():
    outcome = default()
    assert set(outcome.rotors["verdict"]) == {"kept", "refused"}
    assert outcome.rotors["reason"].nunique() >= 5
    pd.testing.assert_frame_equal(replay(outcome.decisions), outcome.rotors[COLUMNS])


def test_every_threshold_can_be_replayed():
    known = set(default().decisions["option"])
    assert known == set(THRESHOLDS)
    fields = {field.name for field in dataclasses.fields(ScreenOptions)}
    assert fields - known == {"arc_elongation", "neighbour_share", "max_common_motion_nm"}


@settings(max_examples=25, deadline=None)
@given(changed=st.fixed_dictionaries({}, optional=THRESHOLDS))
def test_a_replay_with_other_thresholds_is_a_new_screening(changed):
    options = ScreenOptions(**changed)
    again = screened(options).rotors[COLUMNS]
    pd.testing.assert_frame_equal(replay(default().decisions, options), again)
    given_ones = {name: value for name, value in changed.items() if value is not None}
    pd.testing.assert_frame_equal(replay(default().decisions, given_ones), again)


def test_what_is_no_threshold_cannot_be_replayed():
    with pytest.raises(UsageError, match=r"neighbour_share is no threshold .* min_frames"):
        replay(default().decisions, {"neighbour_share": 0.5})
    with pytest.raises(TableError, match="screen the rotors again"):
        replay(default().decisions.drop(columns="option"), {"min_frames": 5})
    assert len(replay(default().decisions.iloc[:0])) == 0


def said(number, verdict, **more):
    return HumanVerdict(rotor=number, x_nm=0.0, y_nm=0.0, verdict=verdict, **more)


def test_a_person_overrules_and_leaves_a_trail():
    outcome = default()
    step = int(outcome.rotors.loc[outcome.rotors["reason"] == "several_rotors", "rotor"].iloc[0])
    kept = int(outcome.rotors.loc[outcome.rotors["verdict"] == "kept", "rotor"].iloc[0])
    verdicts = {
        step: said(step, "kept", reason="a lamp flickered", by="Ada", at="2026-11-23"),
        kept: said(kept, "refused"),
    }
    rotors, decisions = overrule(outcome.rotors, outcome.decisions, verdicts)
    told = rotors.set_index("rotor")
    assert (told.loc[step, "verdict"], told.loc[step, "reason"]) == ("kept", "")
    assert (told.loc[kept, "verdict"], told.loc[kept, "reason"]) == ("refused", "by_hand")
    others = ~rotors["rotor"].isin([step, kept])
    pd.testing.assert_frame_equal(rotors[others], outcome.rotors[others])
    rows = decisions[decisions["feature"] == HUMAN].set_index("rotor")
    assert rows.loc[step, "verdict_before"] == "refused: several_rotors"
    assert rows.loc[step, "verdict_after"] == "kept"
    assert rows.loc[step, "remark"] == "a lamp flickered (Ada, 2026-11-23)"
    assert rows.loc[kept, "verdict_before"] == "kept"
    automatic = decisions.loc[decisions["feature"] != HUMAN, list(outcome.decisions)]
    pd.testing.assert_frame_equal(automatic, outcome.decisions)
    pd.testing.assert_frame_equal(replay(decisions), rotors[COLUMNS])
    strict = replay(decisions, {"min_frames": 10 * FRAMES}).set_index("rotor")
    assert strict["verdict"].value_counts().to_dict() == {"refused": 11, "kept": 1}
    assert strict.loc[step, "verdict"] == "kept"


def test_what_is_no_longer_said_is_undone():
    outcome = default()
    measured = outcome.rotors.loc[outcome.rotors["radius_nm"].notna(), "rotor"]
    verdicts = {n: said(n, "refused" if n % 2 else "kept") for n in measured}
    once = overrule(outcome.rotors, outcome.decisions, verdicts)
    pd.testing.assert_frame_equal(overrule(*once, verdicts)[0], once[0])
    pd.testing.assert_frame_equal(overrule(*once, verdicts)[1], once[1])
    pd.testing.assert_frame_equal(overrule(*once, {})[0], outcome.rotors)


def test_what_has_no_circle_cannot_be_kept():
    outcome = default()
    bare = int(outcome.rotors.loc[outcome.rotors["radius_nm"].isna(), "rotor"].iloc[0])
    with pytest.raises(ConfigurationError, match=f"rotor {bare} has no circle"):
        overrule(outcome.rotors, outcome.decisions, {bare: said(bare, "kept")})
