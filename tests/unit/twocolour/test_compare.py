"""A comparison has a row for each pair, quantity and weight, and says why a p is missing."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest

from rotortrack.errors import ConfigurationError, InputError
from rotortrack.settings import Layer, resolve
from rotortrack.twocolour.compare import LARGEST_NM, compare_groups
from rotortrack.twocolour.compare_facts import comparison_histograms, facts
from rotortrack.twocolour.compare_options import CompareOptions
from rotortrack.twocolour.compare_tables import COMPARISON
from rotortrack.twocolour.forward import RIGID_NOTE
from rotortrack.twocolour.measured import measured_group
from rotortrack.twocolour.population import rod_population
from rotortrack.twocolour.resampling import GRID_REFUSED

from .planted_groups import FILM, GRID, LENGTH_NM, group, group_tables, scan_tables

FAST = CompareOptions(resamples=200, permutations=199, twins=4)


@pytest.fixture(scope="module")
def rods():
    return rod_population(*scan_tables(GRID), length_nm=LENGTH_NM)


@pytest.fixture(scope="module")
def compared(rods):
    groups = [group(1, "one"), group(2, "other", mean_nm=260.0)]
    return compare_groups(groups, {"grid": rods}, FAST)


def row_of(compared, first, second, quantity, weight):
    rows = compared.rows
    chosen = rows[
        (rows["first"] == first)
        & (rows["second"] == second)
        & (rows["quantity"] == quantity)
        & (rows["weight"] == weight)
    ]
    assert len(chosen) == 1
    return chosen.iloc[0]


def test_every_pair_has_a_row_for_each_quantity_and_weight(compared):
    keys = set(compared.rows[["first", "second", "quantity", "weight"]].itertuples(index=False))
    distances = [("distance", "frames"), ("distance", "rotors")]
    distances += [("mean_distance", "rotors"), ("true_distance", "rotors"), ("ccw_share", "rotors")]
    expected = {("one", "other", "speed", "rotors")}
    for pair in (("one", "other"), ("one", "grid"), ("other", "grid")):
        expected |= {(*pair, *of) for of in distances}
    assert {tuple(key) for key in keys} == expected
    assert list(compared.rows) == COMPARISON.names


def test_frames_and_rotors_have_the_means_that_their_weights_say(compared):
    one = compared.groups[0]
    by_frames = row_of(compared, "one", "other", "distance", "frames")
    by_rotors = row_of(compared, "one", "other", "distance", "rotors")
    assert by_frames["first_mean"] == pytest.approx(one.distance_nm.mean())
    assert by_rotors["first_mean"] == pytest.approx(one.mean_nm.mean())
    assert by_frames["first_frames"] == one.n_frames.sum() == len(one.distance_nm)
    gap = by_frames["first_mean"] - by_frames["second_mean"]
    assert by_frames["difference"] == pytest.approx(gap, abs=0.1)


def test_measured_groups_get_a_p_and_a_grid_none(compared):
    between = compared.rows[compared.rows["second"] == "other"]
    assert between["p"].between(0.0, 1.0).all()
    assert row_of(compared, "one", "other", "mean_distance", "rotors")["p"] < 0.05
    against = compared.rows[compared.rows["second"] == "grid"]
    assert against["p"].isna().all()
    assert set(against["p_reason"]) == {GRID_REFUSED}


def test_a_declared_prior_gives_a_p(rods):
    declared = dataclasses.replace(rods, declared=True)
    compared = compare_groups([group(1, "one", mean_nm=90.0)], {"grid": declared}, FAST)
    assert (compared.rows.query("quantity != 'ccw_share'")["p"] <= 0.05).all()


def test_simulated_distances_have_the_noise_of_the_group(rods):
    noisy = group(1, "noisy", noise_nm=60.0)
    compared = compare_groups([noisy], {"grid": rods}, FAST)
    as_measured = row_of(compared, "noisy", "grid", "mean_distance", "rotors")["second_mean"]
    without = row_of(compared, "noisy", "grid", "true_distance", "rotors")["second_mean"]
    # A Rician mean is longer by about s^2 / 2 d.
    assert as_measured - without == pytest.approx(60.0**2 / (2.0 * without), rel=0.35)


def test_counts_of_histograms_add_up_to_n(compared):
    found = comparison_histograms(compared)
    assert [one.kind for one in found] == ["measured"] * 2 + ["twins"] * 2 + ["rods"]
    for one in found:
        assert one.frames.sum() == pytest.approx(one.n_frames)
        assert one.rotors.sum() == pytest.approx(one.n_rotors)
    assert [one.n_frames for one in found[:2]] == [g.n_frames.sum() for g in compared.groups]
    assert np.diff(compared.edges_nm) == pytest.approx(25.0)


def test_bins_hold_their_lower_edge_and_the_last_one_both():
    frames, ends, rotors = group_tables(1, n=2)
    frames = pd.DataFrame(
        {
            **{"rotor": np.repeat([0, 1], 60), "frame": np.tile(np.arange(60), 2)},
            **{"x_sd_nm": 1.0, "y_sd_nm": 1.0},
            "distance_nm": np.repeat([24.999, 25.0, 50.0, 100.0], 30),
        }
    )
    two = measured_group("two", frames, ends, rotors, FILM)
    counts = comparison_histograms(compare_groups([two], {}, FAST))[0].frames
    assert counts.tolist() == [30.0, 30.0, 30.0, 30.0]


def test_distances_beyond_all_rods_count_in_the_last_bin_and_are_told():
    frames, ends, rotors = group_tables(1, n=3)
    frames.loc[5, "distance_nm"] = 40_000.0
    compared = compare_groups([measured_group("far", frames, ends, rotors, FILM)], {}, FAST)
    assert compared.edges_nm[-1] == LARGEST_NM
    one = comparison_histograms(compared)[0]
    assert one.frames[-1] == 1
    assert one.frames.sum() == one.n_frames == len(frames)
    assert "1 frames of far have distances above 2000 nm" in " ".join(compared.notes)


def test_a_reader_is_told_what_limits_the_comparison(compared):
    notes = " ".join(compared.notes)
    assert RIGID_NOTE in notes
    assert "not corrected for each other" in notes
    few = compare_groups([group(1, "few", n=3)], {}, FAST)
    assert "few has 3 rotors" in few.notes[0]


def test_one_group_alone_has_its_correlation_and_no_rows():
    compared = compare_groups([group(1, "one", n=40)], {}, FAST)
    assert compared.rows.empty
    found = compared.correlations["one"]
    assert found.slope.low < 1.5 < found.slope.high
    assert found.p < 0.01


def test_facts_are_plain_values_that_json_knows(compared):
    told = json.loads(json.dumps(facts(compared), allow_nan=False))
    assert len(told["comparisons"]) == len(compared.rows)
    assert told["histograms"]["closed"] == "[low, high), the last bin closed"
    scan = told["scans"][0]
    assert sum(scan["weights"]) == pytest.approx(1.0)
    assert (scan["cells"], scan["shapes"], scan["rods"]) == (6, 6, 12)


def test_the_same_seed_gives_the_same_rows(compared, rods):
    groups = [group(1, "one"), group(2, "other", mean_nm=260.0)]
    again = compare_groups(groups, {"grid": rods}, FAST)
    pd.testing.assert_frame_equal(compared.rows, again.rows)


def test_refused_rotors_and_those_with_few_frames_are_left_out():
    frames, ends, rotors = group_tables(1, n=5)
    rotors.loc[0, "verdict"] = "refused"
    frames = frames[(frames["rotor"] != 1) | (frames["frame"] < 20)]
    made = measured_group("run", frames, ends, rotors, FILM)
    assert made.rotor.tolist() == [2, 3, 4]
    assert made.left_out == 1
    parts = np.split(made.distance_nm, made.first_frame[1:-1])
    assert [part.mean() for part in parts] == pytest.approx(made.mean_nm)


def test_one_rotor_is_no_group():
    frames, ends, rotors = group_tables(1, n=3)
    rotors.loc[1:, "verdict"] = "refused"
    with pytest.raises(InputError, match="run has 1 kept rotor with an end-to-end distance"):
        measured_group("run", frames, ends, rotors, FILM)


def test_a_test_on_frames_is_refused_with_the_reason():
    layers = [Layer("test", {"compare": {"test_frames": True}})]
    with pytest.raises(ConfigurationError, match="frames of one rotor are not independent"):
        resolve({"compare": CompareOptions}, layers)
