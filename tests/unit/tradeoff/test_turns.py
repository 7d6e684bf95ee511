"""Settings are timed in turns; intervals of a root mean square hold the truth."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.tradeoff.turns import in_turns, rms_interval


def test_each_work_is_done_once_before_it_is_timed_in_turns():
    done, told = [], []

    def work(name):
        done.append(name)
        return len(done)

    works = {name: (lambda name=name: work(name)) for name in "ab"}
    results = in_turns(works, 2, lambda *given: told.append(given), "group")
    assert done == ["a", "b"] * 3
    assert {name: result for name, (result, _) in results.items()} == {"a": 1, "b": 2}
    assert all(seconds >= 0.0 for _, seconds in results.values())
    assert told == [("group", number, 6) for number in range(6)]


def test_intervals_hold_the_truth_in_95_of_100_cases():
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(1000):
        _, low, high = rms_interval(rng.normal(0.0, 3.0, 400) ** 2)
        held += low <= 3.0 <= high
    assert 925 <= held <= 970


def test_errors_that_are_alike_leave_no_interval():
    assert rms_interval(np.full(10, 4.0)) == pytest.approx((2.0, 2.0, 2.0))
