"""Dropped frames are told from late ones, and irregular frames from both."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rotortrack.errors import MetadataWarning
from rotortrack.movies.timing import number_frames, told

INTERVAL_S = 0.002
CLOCK_ERROR = 30e-6


def numbers_with_drops(frames, places, sizes):
    """Give frame numbers that jump by the sizes before the places."""
    steps = np.ones(frames, np.int64)
    steps[0] = 0
    np.add.at(steps, np.asarray(places, np.int64), np.asarray(sizes, np.int64))
    return np.cumsum(steps)


def received(numbers, rng, *, interval_s, late, tick_s=0.0, stalls=0, longest=50):
    """Times at which a computer receives frames: never early, in order, stalls made good."""
    times_s = numbers * interval_s * (1 + CLOCK_ERROR)
    times_s += rng.exponential(late * interval_s, len(numbers)) if late else 0.0
    for start in rng.integers(0, len(numbers) - 200, stalls) if stalls else ():
        stall_s = rng.uniform(1, longest) * interval_s
        times_s[start:] = np.maximum(times_s[start:], times_s[start] + stall_s)
    times_s = np.maximum.accumulate(times_s) + 4.1471
    return np.floor(times_s / tick_s) * tick_s if tick_s else times_s


@given(
    st.integers(10, 500),
    st.floats(1e-4, 10.0),
    st.lists(st.tuples(st.floats(0, 1), st.integers(1, 60)), max_size=12),
)
def test_exact_times_give_every_number_back(frames, interval_s, drops):
    # Frames of one tick of a clock of whole ms show no drops.
    assume(abs(interval_s - 1e-3) > 1e-8)
    drops = drops[: frames // 5]
    places = [1 + int(place * (frames - 2)) for place, _ in drops]
    numbers = numbers_with_drops(frames, places, [size for _, size in drops])
    found = number_frames(numbers * interval_s)
    assert found.numbers.tolist() == numbers.tolist()
    assert found.interval_s == pytest.approx(interval_s, rel=1e-6)
    assert found.dropped == numbers[-1] + 1 - frames
    assert found.places == len({*places})
    assert found.jitter_s == pytest.approx(0.0, abs=1e-6 * interval_s)
    assert not found.irregular


@pytest.mark.parametrize("tick_s", [0.0, 1e-3])
@pytest.mark.parametrize("interval_s", [0.002, 0.00203, 0.01])
@pytest.mark.parametrize("late", [0.1, 1.0])
@pytest.mark.parametrize("drops", [0, 12])
def test_every_drop_is_found_and_none_invented(interval_s, late, tick_s, drops):
    rng = np.random.default_rng(7)
    frames = 100_000
    places = np.sort(rng.choice(np.arange(1, frames - 300), drops, replace=False))
    numbers = numbers_with_drops(frames, places, rng.integers(1, 4, drops))
    times_s = received(numbers, rng, interval_s=interval_s, late=late, tick_s=tick_s, stalls=20)
    found = number_frames(times_s)
    assert found.dropped == numbers[-1] + 1 - frames
    assert found.interval_s == pytest.approx(interval_s * (1 + CLOCK_ERROR), rel=3e-6)
    # Frames that are late when a drop happens may be numbered on its other side.
    assert np.count_nonzero(found.numbers != numbers) < 1e-3 * frames
    assert np.all(np.diff(found.numbers) > 0)
    assert not found.irregular


@pytest.mark.parametrize("every", [10, 50])
def test_frames_dropped_at_a_constant_rate_do_not_lengthen_the_interval(every):
    rng = np.random.default_rng(3)
    numbers = np.delete(np.arange(20_000), np.arange(every - 1, 20_000, every))
    times_s = received(numbers, rng, interval_s=INTERVAL_S, late=0.1, tick_s=1e-3)
    found = number_frames(times_s)
    assert found.interval_s == pytest.approx(INTERVAL_S, rel=1e-4)
    assert np.count_nonzero(found.numbers != numbers) < 0.01 * len(numbers)


def test_times_in_ticks_of_the_interval_tell_no_drops():
    every_ms = np.arange(1000) * 1e-3
    assert number_frames(every_ms).interval_s == pytest.approx(1e-3)
    assert not number_frames(every_ms).irregular
    rounded = np.floor(np.arange(1000) * 1.03) * 1e-3
    found = number_frames(rounded)
    assert found.dropped == 0
    assert found.interval_s == pytest.approx(1.03e-3, rel=2e-3)


@pytest.mark.parametrize("size", [4, 10, 30])
def test_frames_that_always_arrive_in_batches_are_regular(size):
    numbers = np.arange(5000)
    arrival = np.minimum((numbers // size + 1) * size - 1, numbers[-1])
    found = number_frames(arrival * INTERVAL_S)
    assert found.numbers.tolist() == numbers.tolist()
    assert found.interval_s == pytest.approx(INTERVAL_S, rel=1e-3)
    assert found.jitter_s == pytest.approx((size - 1) * INTERVAL_S, rel=0.2)


def test_a_stall_that_is_made_good_is_no_drop_and_one_that_lasts_is_one():
    times_s = np.arange(1000) * INTERVAL_S
    stalled = np.maximum(times_s, np.where(np.arange(1000) >= 400, times_s[400] + 0.1, 0.0))
    assert number_frames(stalled).dropped == 0
    paused = times_s + np.where(np.arange(1000) >= 400, 0.1, 0.0)
    found = number_frames(paused)
    assert found.dropped == 50
    assert found.numbers[400] == 450


def test_a_lateness_at_the_end_is_a_drop_only_where_none_like_it_was_made_good():
    times_s = np.arange(1000) * INTERVAL_S
    late = times_s.copy()
    late[-3:] += 5 * INTERVAL_S
    assert number_frames(late).dropped == 5
    late[500:504] = late[504]
    assert number_frames(late).dropped == 0


@pytest.mark.parametrize(("frames", "fewest"), [(300, 45), (3000, 50)])
@pytest.mark.parametrize("spread", [0.2, 0.5])
def test_frames_without_a_common_interval_are_irregular(frames, fewest, spread):
    films = [
        np.cumsum(0.1 * np.random.default_rng(seed).uniform(1 - spread, 1 + spread, frames))
        for seed in range(50)
    ]
    found = [number_frames(times_s) for times_s in films]
    irregular = [one for one in found if one.irregular]
    assert len(irregular) >= fewest
    assert sum(one.dropped > 0 for one in found) <= 50 - fewest
    for one in irregular:
        assert one.numbers.tolist() == list(range(frames))
        assert one.interval_s == pytest.approx(0.1, rel=0.1)
        assert one.low_s == pytest.approx(0.1 * (1 - 0.9 * spread), rel=0.1)
    with pytest.warns(MetadataWarning, match=r"no common interval .* ms between most"):
        assert told(irregular[0], "film.tif") is None


@given(
    st.lists(st.floats(0.0, 1e6), min_size=10, max_size=200).filter(lambda t: max(t) > min(t) + 1)
)
def test_numbers_increase_whatever_the_times(times):
    found = number_frames(np.sort(times))
    assert found.numbers[0] == 0
    assert np.all(np.diff(found.numbers) > 0)
    assert found.interval_s > 0


def test_drops_are_told_in_one_sentence():
    regular = number_frames(np.arange(100) * INTERVAL_S)
    some = number_frames(numbers_with_drops(100, [10, 50], [1, 11]) * INTERVAL_S)
    one = number_frames(numbers_with_drops(100, [10], [1]) * INTERVAL_S)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert told(regular, "film.tif") is None
        sentence = told(some, "film.tif")
        assert sentence is not None
        assert "12 frames were dropped at 2 places" in sentence
        assert "treated as gaps" in sentence
        assert "1 frame was dropped at 1 place" in str(told(one, "film.tif"))
