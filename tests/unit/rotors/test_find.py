"""From localisations to rotors."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from rotortrack.errors import PercolationWarning, TableError
from rotortrack.rotors.find import find_rotors
from rotortrack.rotors.options import CircleOptions, ClusterOptions
from rotortrack.rotors.per_frame import is_duplicate

CENTRES = [(1500.0 * i, 1500.0 * j) for j in range(3) for i in range(3)]


def test_every_ring_becomes_a_rotor_with_its_circle(field):
    found = find_rotors(field(np.random.default_rng(1), CENTRES, n=800))
    rotors = found.rotors
    assert len(rotors) == 9
    order = [np.hypot(*(rotors[["x_nm", "y_nm"]].to_numpy() - c).T).argmin() for c in CENTRES]
    assert sorted(order) == list(range(9))
    assert np.abs(rotors["radius_nm"] - 100.0).max() < 4.0 * rotors["radius_sd_nm"].max() < 5.0
    assert np.all(rotors["n_localisations"] == 800)
    assert rotors["residual_sd_nm"].to_numpy() == pytest.approx(15.0, rel=0.15)
    assert np.all(rotors["localisation_sd_nm"] == 15.0)
    assert set(rotors["circle"]) == {"fitted"}
    assert (found.duplicates, found.small_clusters) == (0, 0)


def test_rows_and_their_order_are_kept_and_rotors_do_not_depend_on_it(field):
    rng = np.random.default_rng(2)
    table = field(rng, CENTRES[:4], background=60)
    table.index = pd.Index(rng.permutation(len(table)))
    shuffled = table.iloc[rng.permutation(len(table))]
    found, again = find_rotors(table), find_rotors(shuffled)
    assert found.localisations.index.equals(table.index)
    assert found.localisations["x_nm"].equals(table["x_nm"])
    pd.testing.assert_frame_equal(again.rotors, found.rotors)
    for column in ("rotor", "fit_flags"):
        assert again.localisations[column].loc[table.index].equals(found.localisations[column])
    assert "rotor" not in table


def test_a_second_spot_in_a_frame_is_flagged_and_the_better_one_kept(field):
    rng = np.random.default_rng(3)
    table = field(rng, [(0.0, 0.0)], n=900)
    false_spots = table.iloc[:60].assign(x_nm=rng.normal(0, 10, 60), y_nm=rng.normal(0, 10, 60))
    found = find_rotors(pd.concat([table, false_spots], ignore_index=True))
    flagged = is_duplicate(found.localisations)
    assert found.duplicates == flagged.sum() == 60
    assert flagged[len(table) :].all()
    assert found.rotors["n_localisations"].item() == 900
    used = found.localisations[~flagged]
    assert not used.duplicated(["rotor", "frame"]).any()


def test_small_clusters_are_dropped_and_counted(field):
    rng = np.random.default_rng(4)
    table = pd.concat(
        [field(rng, [(0.0, 0.0)], n=300), field(rng, [(2000.0, 0.0)], n=20)], ignore_index=True
    )
    found = find_rotors(table)
    assert (found.small_clusters, found.small_cluster_localisations) == (1, 20)
    assert list(found.localisations["rotor"].value_counts().sort_index()) == [20, 300]
    assert len(find_rotors(table, ClusterOptions(min_localisations=20)).rotors) == 2


def test_background_spots_that_hang_on_do_not_move_a_short_arc(ring):
    rng = np.random.default_rng(5)
    radii = []
    for _ in range(20):
        x, y = ring(rng, 200, 100.0, 12.0, 150.0)
        away, to = 300.0 * np.sqrt(rng.random(8)), rng.uniform(0.0, 6.3, 8)
        x, y = np.append(x, away * np.cos(to)), np.append(y, away * np.sin(to))
        table = pd.DataFrame({"frame": np.arange(208), "x_nm": x, "y_nm": y})
        radii.append(
            find_rotors(table, ClusterOptions(distance_nm=250.0)).rotors["radius_nm"].iloc[0]
        )
    assert np.median(radii) == pytest.approx(100.0, rel=0.03)
    assert np.max(np.abs(radii)) < 130.0


def test_a_toggling_rotor_is_one_rotor_about_the_middle_of_its_poles():
    rng = np.random.default_rng(6)
    n = 2000
    theta = np.pi * (np.cumsum(rng.random(n) < 0.01) % 2) + rng.normal(0.0, 0.15, n)
    x, y = (
        120.0 * np.cos(theta) + rng.normal(0, 10, n),
        120.0 * np.sin(theta) + rng.normal(0, 10, n),
    )
    rotor = find_rotors(pd.DataFrame({"frame": np.arange(n), "x_nm": x, "y_nm": y})).rotors
    assert len(rotor) == 1
    assert rotor["radius_nm"].item() == pytest.approx(120.0, rel=0.05)
    assert abs(rotor["x_nm"].item()) < 5.0


def test_a_stuck_spot_has_a_centre_but_no_radius():
    rng = np.random.default_rng(7)
    x, y = rng.normal(500.0, 15.0, (2, 1000))
    rotor = find_rotors(pd.DataFrame({"frame": np.arange(1000), "x_nm": x, "y_nm": y})).rotors
    assert rotor["circle"].item() == "not_a_ring"
    assert np.isnan(rotor["radius_nm"].item())
    assert rotor["x_nm"].item() == pytest.approx(500.0, abs=2.0)
    assert np.isnan(rotor["localisation_sd_nm"].item())


def test_the_chosen_circle_method_is_used(field):
    table = field(np.random.default_rng(8), [(0.0, 0.0)], n=1000, noise=20.0)
    plain = find_rotors(table).rotors["radius_nm"].item()
    pratt = find_rotors(table, None, CircleOptions(method="pratt")).rotors["radius_nm"].item()
    assert pratt / plain == pytest.approx(1.07, abs=0.02)


def test_dense_background_is_warned_about(field):
    table = field(np.random.default_rng(9), CENTRES, background=2000)
    with pytest.warns(PercolationWarning, match=r"lower distance_nm"):
        found = find_rotors(table, ClusterOptions(distance_nm=120.0))
    assert found.percolation_margin < 2.0
    assert find_rotors(table, ClusterOptions(distance_nm=60.0)).percolation_margin > 2.0


@pytest.mark.parametrize("rows", [0, 1])
def test_tables_without_rotors_give_an_empty_rotor_table(field, rows):
    table = field(np.random.default_rng(10), [(0.0, 0.0)], n=1).iloc[:rows]
    found = find_rotors(table)
    assert len(found.rotors) == 0
    assert "radius_nm" in found.rotors
    assert len(found.localisations) == rows
    assert np.all(found.localisations["rotor"] == -1)


def test_rows_without_a_position_belong_to_no_rotor(field):
    table = field(np.random.default_rng(11), [(0.0, 0.0)], n=300)
    table.loc[:9, "x_nm"] = np.nan
    found = find_rotors(table)
    assert list(found.localisations["rotor"].iloc[:10]) == [-1] * 10
    assert found.rotors["n_localisations"].item() == 290


def test_missing_columns_are_named():
    with pytest.raises(TableError, match="frame, y_nm"):
        find_rotors(pd.DataFrame({"x_nm": [1.0]}))


def test_a_rotor_of_nothing_but_scattered_spots_keeps_its_number(field):
    rings = field(np.random.default_rng(12), [(0.0, 0.0), (3000.0, 0.0)], n=300)
    chain = pd.DataFrame({"frame": np.arange(40), "x_nm": np.arange(40) * 150.0, "y_nm": 3000.0})
    found = find_rotors(pd.concat([rings, chain], ignore_index=True))
    assert found.rotors["n_localisations"].tolist() == [300, 300, 40]
    assert found.localisations["rotor"].max() == 2


def test_single_spots_can_be_rotors():
    table = pd.DataFrame({"frame": [0, 1], "x_nm": [0.0, 5000.0], "y_nm": [0.0, 0.0]})
    found = find_rotors(table, ClusterOptions(min_localisations=1))
    assert found.rotors["n_localisations"].tolist() == [1, 1]
    assert found.rotors["radius_nm"].isna().all()
