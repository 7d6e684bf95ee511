"""Where a period is cut: every part of every exposure is made of whole segments."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.segments import Segments

T = 0.002


@given(
    part_of_period=st.sampled_from([0.1, 0.5, 0.9, 1.0]),
    parts=st.integers(1, 12),
    delays=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=2),
)
def test_parts_average_a_known_path_exactly(part_of_period, parts, delays):
    exposure_s = part_of_period * T
    delays_s = tuple(delay * T for delay in delays)
    segments = Segments(Clock(9, T, exposure_s), parts, delays_s)
    assert segments.length_s.sum() == pytest.approx(T)
    begin = segments.begin_s(0, 5)
    end = begin + segments.length_s
    # The mean of t^2 over each segment, so that weights matter.
    path = (begin**2 + begin * end + end**2) / 3.0
    if segments.straddles:
        path = np.concatenate([path[:-1], path[1:]], axis=1)
    for delay_s, relative in zip(delays_s, segments.delays_s, strict=True):
        got = segments.exposed(path, relative)
        starts = np.arange(len(path))[:, np.newaxis] * T + delay_s
        starts = starts + np.arange(parts) * (exposure_s / parts)
        ends = starts + exposure_s / parts
        expected = (starts**2 + starts * ends + ends**2) / 3.0
        # Edges closer than 1e-9 of a period are one.
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-7 * T**2)


@pytest.mark.parametrize("delays_s", [(0.0,), (0.0, 0.0), (0.0003, 0.0017), (0.0, T)])
def test_instants_are_the_path_at_their_time(delays_s):
    segments = Segments(Clock(9, T, 0.0), 1, delays_s)
    begin = segments.begin_s(0, 5)
    path = begin + 0.5 * segments.length_s
    if segments.straddles:
        path = np.concatenate([path[:-1], path[1:]], axis=1)
    for delay_s, relative in zip(delays_s, segments.delays_s, strict=True):
        got = segments.exposed(path, relative)[:, 0]
        np.testing.assert_allclose(got, np.arange(len(path)) * T + delay_s, rtol=1e-12, atol=1e-15)
