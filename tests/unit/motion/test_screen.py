"""Verdicts against planted truth, one reason a rotor, and a decision table that replays."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from rotortrack.errors import DriftWarning, TableError
from rotortrack.motion.screen import position_spread_nm, screen
from rotortrack.motion.screen_options import ScreenOptions
from rotortrack.motion.verdicts import Reason
from rotortrack.rotors.find import find_rotors
from rotortrack.rotors.options import ClusterOptions

FRAMES = 3000
TRUTH = {
    "driven": "",
    "brownian": "",
    "toggling": "",
    "bleaching": "",
    "stuck": "immobile",
    "arc": "partial_arc",
    "step": "several_rotors",
    "rare": "too_few_frames",
}


def rotor(rng, kind, *, n=FRAMES, radius=None, noise=None):
    """Localisations of one rotor about the origin, 2 ms a frame."""
    noise = noise or rng.uniform(8.0, 12.0 if kind == "arc" else 25.0)
    radius = radius or rng.uniform(
        110.0 if kind == "arc" else 60.0, 120.0 if kind == "toggling" else 180.0
    )
    diffusion = rng.uniform(5.0, 60.0)
    drive = rng.choice([-1, 1]) * rng.uniform(3.0, 30.0) if kind in ("driven", "step") else 0.0
    walk = np.cumsum(rng.normal(drive * 0.002, np.sqrt(2 * diffusion * 0.002), n))
    theta = rng.uniform(0.0, 6.3) + {
        "arc": np.abs(walk % 1.8 - 0.9),
        "toggling": np.pi * (np.cumsum(rng.random(n) < 0.01) % 2) + rng.normal(0.0, 0.15, n),
    }.get(kind, walk)
    reach = 0.0 if kind == "stuck" else radius
    photons = 1000.0 * np.exp(0.15 * rng.normal(size=n))
    if kind == "bleaching":
        photons *= np.maximum(0.2, 1.0 - (np.arange(n) * 16 // n) / 20.0)
    if kind == "step":
        photons[int(n * rng.uniform(0.2, 0.8)) :] *= 1.9
    if kind == "loss":
        photons[: int(n * rng.uniform(0.2, 0.8))] *= 1.9
    seen = np.flatnonzero(rng.random(n) < (0.02 if kind == "rare" else rng.uniform(0.5, 0.95)))
    return pd.DataFrame(
        {
            "frame": seen,
            "x_nm": (reach * np.cos(theta) + noise * rng.normal(size=n))[seen],
            "y_nm": (reach * np.sin(theta) + noise * rng.normal(size=n))[seen],
            "photons": photons[seen],
            "uncertainty_nm": noise * np.exp(0.1 * rng.normal(size=seen.size)),
        }
    )


def at(table, x, y):
    return table.assign(x_nm=table["x_nm"] + x, y_nm=table["y_nm"] + y)


def screened(tables, options=None, n_frames=FRAMES, distance_nm=None, **columns):
    table = pd.concat(tables, ignore_index=True).assign(**columns)
    found = find_rotors(table, ClusterOptions(distance_nm=distance_nm))
    return screen(found.localisations, found.rotors, options, n_frames=n_frames)


def reasons(rng, kinds, background=0, drop=()):
    """Reason codes found at every site of a field of 1.2-um pitch."""
    sites = [(1200.0 * (i % 8), 1200.0 * (i // 8)) for i in range(len(kinds))]
    tables = [at(rotor(rng, kind), *site) for kind, site in zip(kinds, sites, strict=True)]
    spots = rng.uniform(-600.0, 9000.0, (background, 2))
    tables.append(
        pd.DataFrame(
            {
                "frame": rng.integers(0, FRAMES, background),
                "x_nm": spots[:, 0],
                "y_nm": spots[:, 1],
                "photons": 300.0,
                "uncertainty_nm": 25.0,
            }
        )
    )
    rotors = screened([table.drop(columns=list(drop)) for table in tables]).rotors
    found = []
    for x, y in sites:
        near = np.hypot(rotors["x_nm"] - x, rotors["y_nm"] - y) < 400.0
        found.append(";".join(rotors.loc[near, "reason"]) if near.any() else "not found")
    return found


@pytest.mark.parametrize(("background", "drop"), [(0, ()), (300, ()), (100, ("uncertainty_nm",))])
def test_verdicts_agree_with_the_planted_truth(background, drop):
    rng = np.random.default_rng(1)
    kinds = [
        *["driven"] * 16,
        *["brownian"] * 10,
        *["toggling"] * 4,
        *["bleaching"] * 6,
        *["stuck"] * 14,
        *["arc"] * 6,
        *["step"] * 6,
        *["rare"] * 2,
    ]
    kinds = list(rng.permutation(kinds))
    found = reasons(rng, kinds, background, drop)
    wrong = [(kind, code) for kind, code in zip(kinds, found, strict=True) if code != TRUTH[kind]]
    assert len(wrong) <= 0.03 * len(kinds), wrong


def test_a_stuck_spot_noisier_than_its_uncertainty_is_still_immobile():
    rng = np.random.default_rng(2)
    outcome = screened([rotor(rng, "stuck", noise=15.0)], uncertainty_nm=9.0)
    assert list(outcome.rotors["reason"]) == ["immobile"]
    spread = outcome.decisions.set_index("feature")
    assert spread.loc["spread", "passed"]
    assert not spread.loc["ring_evidence", "passed"]


def test_two_spots_in_many_frames_are_several_rotors():
    rng = np.random.default_rng(3)
    tables = [rotor(rng, "driven", radius=120.0), rotor(rng, "stuck")]
    outcome = screened(tables, photons=500.0)
    assert list(outcome.rotors["reason"]) == ["several_rotors"]


@pytest.mark.parametrize(("gap", "reason"), [(600.0, "neighbours_too_close"), (700.0, "")])
def test_neighbours_are_too_close_by_the_gap_between_their_circles(gap, reason):
    rng = np.random.default_rng(4)
    tables = [rotor(rng, "driven", radius=100.0, noise=10.0) for _ in range(2)]
    outcome = screened([tables[0], at(tables[1], 200.0 + gap, 0.0)])
    assert list(outcome.rotors["reason"]) == [reason, reason]


def test_a_speck_of_background_nearby_does_not_count_as_a_neighbour():
    rng = np.random.default_rng(5)
    speck = at(rotor(rng, "stuck", n=60), 350.0, 0.0)
    outcome = screened([rotor(rng, "driven", radius=80.0, noise=10.0), speck])
    assert sorted(outcome.rotors["reason"]) == ["", "too_few_frames"]


def test_scatter_far_above_the_noise_is_no_circle():
    rng = np.random.default_rng(6)
    outcome = screened([rotor(rng, "driven", radius=150.0, noise=25.0)], uncertainty_nm=5.0)
    assert list(outcome.rotors["reason"]) == ["no_circle"]


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"min_frames": 2999}, "too_few_frames"),
        ({"min_detection": 0.99}, "too_few_frames"),
        ({"max_intensity_step": 1.0001}, "several_rotors"),
        ({"max_gap": 1e-4}, "too_few_frames"),
        ({"min_spread": 50.0}, "immobile"),
        ({"min_ring_evidence": 1e6}, "immobile"),
        ({"max_residual": 0.5}, "no_circle"),
        ({"max_radius_error": 1e-6}, "no_circle"),
    ],
)
def test_every_threshold_is_an_option(changed, reason):
    table = rotor(np.random.default_rng(7), "driven", radius=100.0, noise=12.0)
    assert list(screened([table]).rotors["verdict"]) == ["kept"]
    outcome = screened([table], ScreenOptions(**changed)).rotors
    assert list(outcome["verdict"]) == ["refused"]
    assert list(outcome["reason"]) == [reason]


def test_a_second_rotor_that_leaves_is_told():
    rng = np.random.default_rng(18)
    found = [screened([rotor(rng, "loss")]).rotors["reason"].iloc[0] for _ in range(20)]
    assert found.count("several_rotors") == 20


def broken(rng, width=0.7):
    """A rotor that is dark in two opposite arcs, of this half width in rad."""
    table = rotor(rng, "brownian", radius=170.0, noise=10.0)
    angle = np.arctan2(table["y_nm"], table["x_nm"])
    return table[np.abs(angle % np.pi - np.pi / 2) > width]


def test_the_pieces_of_a_rotor_are_named_and_not_measured_twice():
    outcome = screened([broken(np.random.default_rng(12))], distance_nm=60.0)
    assert list(outcome.rotors["reason"]) == ["fragment", "fragment"]
    share = outcome.decisions.set_index("feature").loc["fragment", "value"]
    assert share.sum() == pytest.approx(1.0)


def test_a_rotor_that_lost_but_a_small_piece_is_measured_without_it():
    rng = np.random.default_rng(13)
    table = rotor(rng, "driven", radius=170.0, noise=10.0)
    angle = np.arctan2(table["y_nm"], table["x_nm"])
    # Two dark arcs leave 20 of 360 degrees between them.
    outcome = screened(
        [table[(np.abs(angle) < 0.17) | (np.abs(angle) > 0.6)]], distance_nm=60.0
    ).rotors
    reasons = outcome.sort_values("n_localisations")["reason"]
    assert list(reasons) == ["fragment", ""]


def test_two_rings_about_one_centre_are_not_measured_twice():
    rng = np.random.default_rng(14)
    tables = [rotor(rng, "driven", radius=r, noise=8.0) for r in (60.0, 180.0)]
    outcome = screened(tables, ScreenOptions(neighbour_margin_nm=0.0), distance_nm=40.0)
    large = outcome.rotors[outcome.rotors["n_localisations"] > 500]
    assert list(large["verdict"]) == ["refused", "refused"]


def test_a_rotor_that_was_away_for_most_of_the_movie_is_refused():
    rng = np.random.default_rng(15)
    table = rotor(rng, "driven", radius=100.0, noise=10.0)
    table = table[(table["frame"] < 600) | (table["frame"] > 2400)]
    outcome = screened([table])
    assert list(outcome.rotors["reason"]) == ["too_few_frames"]
    gap = outcome.decisions.set_index("feature").loc["longest_gap"]
    assert gap["value"] == pytest.approx(1800 / FRAMES, rel=0.02)
    late = table[table["frame"] > 2400]
    assert list(screened([late]).rotors["verdict"]) == ["kept"]


def sliding(table, rms_nm):
    wave = np.sqrt(2.0) * rms_nm * np.sin(2.0 * np.pi * table["frame"] / FRAMES)
    return table.assign(x_nm=table["x_nm"] + wave, y_nm=table["y_nm"] + wave)


def test_a_rotor_that_slides_is_refused_and_one_at_rest_is_not():
    rng = np.random.default_rng(16)
    table = rotor(rng, "brownian", radius=100.0, noise=10.0)
    assert list(screened([table]).rotors["reason"]) == [""]
    assert list(screened([sliding(table, 25.0)]).rotors["reason"]) == ["centre_moves"]


def test_a_drift_that_was_left_is_the_films_and_no_rotors_fault():
    rng = np.random.default_rng(17)
    tables = [
        at(sliding(rotor(rng, "driven", radius=150.0, noise=10.0), 15.0), 1500.0 * i, 0.0)
        for i in range(10)
    ]
    with pytest.warns(DriftWarning, match=r"10 circles move together by 1[0-9] nm"):
        outcome = screened(tables)
    assert set(outcome.rotors["verdict"]) == {"kept"}


def test_decisions_replay_every_verdict():
    rng = np.random.default_rng(8)
    kinds = ["driven", "stuck", "arc", "step", "rare", "toggling"]
    outcome = screened([at(rotor(rng, k), 1500.0 * i, 0.0) for i, k in enumerate(kinds)])
    table = outcome.decisions
    low = table["value"] < table["threshold"]
    high = table["value"] > table["threshold"]
    failed = np.where(table["rule"] == ">=", low, high)
    assert np.array_equal(table["passed"], ~failed)
    for row in outcome.rotors.itertuples():
        own = table[(table["rotor"] == row.rotor) & ~table["passed"]]
        assert row.reason == (own["reason"].iloc[0] if len(own) else "")
        assert row.verdict == ("refused" if len(own) else "kept")
    assert not table.duplicated(["rotor", "feature"]).any()
    assert set(table["reason"]) <= {reason.value for reason in Reason}


def test_order_of_localisations_does_not_matter():
    rng = np.random.default_rng(9)
    found = find_rotors(at(rotor(rng, "driven"), 0.0, 0.0))
    shuffled = found.localisations.sample(frac=1.0, random_state=1)
    plain = screen(found.localisations, found.rotors, n_frames=FRAMES)
    again = screen(shuffled, found.rotors, n_frames=FRAMES)
    pd.testing.assert_frame_equal(again.decisions, plain.decisions, rtol=1e-9)


def test_tables_without_rotors_and_missing_columns():
    found = find_rotors(rotor(np.random.default_rng(10), "stuck").iloc[:0])
    outcome = screen(found.localisations, found.rotors, n_frames=0)
    assert len(outcome.rotors) == len(outcome.decisions) == 0
    assert {"verdict", "reason"} <= set(outcome.rotors)
    with pytest.raises(TableError, match=r"localisations lack the column.* rotor"):
        screen(found.localisations.drop(columns="rotor"), found.rotors, n_frames=1)


def test_spread_is_that_of_the_spot_whatever_lies_far_away():
    rng = np.random.default_rng(11)
    x, y = rng.normal(0.0, 15.0, (2, 20_000))
    x[:200] += 250.0
    spread, elongation = position_spread_nm(x, y)
    assert spread == pytest.approx(15.0, rel=0.03)
    assert elongation == pytest.approx(1.0, abs=0.03)
    assert position_spread_nm(3.0 * x[200:], y[200:])[1] == pytest.approx(3.0, rel=0.1)
    assert math.isnan(position_spread_nm(x[:2], y[:2])[0])


def test_every_reason_has_a_sentence():
    assert all(reason.sentence.endswith(".") for reason in Reason)
