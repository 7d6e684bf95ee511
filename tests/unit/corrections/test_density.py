import time

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.corrections.density import dense_enough, neighbour_counts
from rotortrack.corrections.options import DensityOptions
from rotortrack.errors import ConfigurationError, TableError


def plain_counts(x, y, radius):
    """All pairs of distinct positions, one after the other."""
    distinct = set(zip(x.tolist(), y.tolist(), strict=True))
    return np.array(
        [
            sum((u - a) ** 2 + (v - b) ** 2 < radius**2 for u, v in distinct) - 1
            for a, b in zip(x.tolist(), y.tolist(), strict=True)
        ]
    )


def ring_and_background(rng, n):
    angle = rng.uniform(0, 2 * np.pi, n)
    ring = np.column_stack([np.cos(angle), np.sin(angle)]) * 80 + 500 + rng.normal(0, 12, (n, 2))
    return np.concatenate([ring, rng.uniform(0, 1000, (n, 2))]).T


@pytest.mark.parametrize("radius", [3.0, 25.0, 50.0, 400.0, 5000.0])
@pytest.mark.parametrize("offset", [0.0, -1e7, 1e8])
def test_counts_equal_those_over_all_pairs(radius, offset):
    x, y = ring_and_background(np.random.default_rng(1), 150) + offset
    assert neighbour_counts(x, y, radius).tolist() == plain_counts(x, y, radius).tolist()


# Integer positions and radii make exact ties, where "strictly closer" decides.
@given(
    st.lists(st.tuples(st.integers(-12, 12), st.integers(-12, 12)), max_size=60),
    st.integers(1, 15),
)
def test_ties_at_the_radius_and_duplicates_count_as_in_the_plain_count(points, radius):
    x, y = np.array(points, dtype=float).reshape(-1, 2).T
    assert neighbour_counts(x, y, float(radius)).tolist() == plain_counts(x, y, radius).tolist()


def test_position_at_exactly_the_radius_is_no_neighbour():
    x, y = np.array([0.0, 30.0, 29.999]), np.array([0.0, 40.0, 40.0])
    assert neighbour_counts(x, y, 50.0).tolist() == [1, 1, 2]


def test_exact_duplicates_are_one_position():
    x = np.array([0.0, 0.0, 0.0, 10.0])
    assert neighbour_counts(x, np.zeros(4), 50.0).tolist() == [1, 1, 1, 1]


def test_rows_without_a_position_have_and_are_no_neighbours():
    x = np.array([0.0, np.nan, 1.0, np.inf, 2.0, 1e300])
    y = np.array([0.0, 0.0, 0.0, 0.0, np.nan, 0.0])
    assert neighbour_counts(x, y, 50.0).tolist() == [1, 0, 1, 0, 0, 0]
    kept = dense_enough(pd.DataFrame({"x_nm": x, "y_nm": y}), DensityOptions(min_neighbours=0))
    assert kept.tolist() == [True, False, True, False, False, False]


def test_stray_far_position_changes_nothing_and_costs_nothing():
    x, y = ring_and_background(np.random.default_rng(2), 100)
    alone = neighbour_counts(x, y, 25.0)
    strayed = neighbour_counts(np.append(x, 9e11), np.append(y, -9e11), 25.0)
    assert strayed.tolist() == [*alone.tolist(), 0]


@pytest.mark.parametrize("threshold", [0, 1, 5, 15, 60, 1000])
def test_early_stop_keeps_the_same_rows_as_full_counts(threshold):
    x, y = ring_and_background(np.random.default_rng(3), 400)
    kept = dense_enough(
        pd.DataFrame({"x_nm": x, "y_nm": y}),
        DensityOptions(radius_nm=25.0, min_neighbours=threshold),
    )
    assert kept.tolist() == (neighbour_counts(x, y, 25.0) >= threshold).tolist()


def test_tables_of_no_and_of_one_row():
    assert neighbour_counts(np.empty(0), np.empty(0), 50.0).shape == (0,)
    assert neighbour_counts(np.array([1.0]), np.array([1.0]), 50.0).tolist() == [0]


def test_dense_rotor_needs_no_time_per_pair():
    # 200 000 localisations within one radius of each other: 2e10 ordered pairs.
    positions = np.random.default_rng(4).uniform(0, 20, (2, 200_000))
    neighbour_counts(*positions[:, :10], 50.0)
    start = time.process_time()
    counts = neighbour_counts(*positions, 50.0)
    assert time.process_time() - start < 5.0
    assert (counts == 199_999).all()


def test_wrong_radius_and_missing_positions_are_named():
    with pytest.raises(ConfigurationError, match="radius_nm"):
        neighbour_counts(np.zeros(2), np.zeros(2), 0.0)
    with pytest.raises(TableError, match="y_nm"):
        dense_enough(pd.DataFrame({"x_nm": [0.0]}), DensityOptions())
