import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.corrections.drift.time_bins import split_into_bins


def test_bins_hold_equal_numbers_and_the_last_takes_the_rest():
    bins = split_into_bins(np.arange(23), 5)
    assert np.diff(bins.edges).tolist() == [4, 4, 4, 4, 7]
    assert bins.centres.tolist() == [1.5, 5.5, 9.5, 13.5, 19.0]


def test_a_bin_is_extended_to_the_end_of_its_frame():
    bins = split_into_bins(np.array([0, 1, 1, 1, 2, 3]), 3)
    assert bins.edges.tolist() == [0, 4, 6]
    assert bins.centres.tolist() == [0.5, 2.5]


def test_one_frame_is_one_bin():
    bins = split_into_bins(np.full(10, 7), 4)
    assert len(bins) == 1
    assert bins.centres.tolist() == [7.0]


@given(st.lists(st.integers(0, 40), min_size=1, max_size=200), st.data())
def test_bins_cover_all_rows_and_split_no_frame(frames, data):
    wanted = data.draw(st.integers(1, len(frames)))
    ordered = np.sort(np.array(frames))
    bins = split_into_bins(ordered, wanted)
    parts = [set(ordered[bins.rows(b)].tolist()) for b in range(len(bins))]
    assert 1 <= len(bins) <= wanted
    assert sum(len(part) for part in parts) == len(set(frames))
    assert all(parts)
    assert sum(np.diff(bins.edges)) == len(frames)
    assert (np.diff(bins.centres) > 0).all()


@pytest.mark.parametrize("first", [0, 1, 1_000_000])
def test_centres_move_with_the_first_frame(first):
    assert split_into_bins(np.arange(20) + first, 2).centres.tolist() == [first + 4.5, first + 14.5]
