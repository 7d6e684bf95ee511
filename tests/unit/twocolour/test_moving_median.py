"""The moving median is that of movmedian: even windows, edges, nan."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from rotortrack.twocolour.moving_median import moving_median

VALUES = st_numpy.arrays(
    np.float64, st.integers(1, 60), elements=st.floats(-1e6, 1e6) | st.just(np.nan)
)


def plainly(values, window):
    before, behind = window // 2, (window - 1) // 2
    medians = []
    for i in range(len(values)):
        part = values[max(i - before, 0) : i + behind + 1]
        part = part[~np.isnan(part)]
        medians.append(np.median(part) if len(part) else np.nan)
    return np.array(medians)


@given(VALUES, st.integers(1, 45))
def test_it_is_the_median_of_what_is_around(values, window):
    np.testing.assert_array_equal(moving_median(values, window), plainly(values, window))


def test_an_even_window_looks_further_back():
    assert moving_median(np.array([1.0, 2, 3, 4, 5]), 4).tolist() == [1.5, 2, 2.5, 3.5, 4]


def test_of_40_values_20_lie_before_and_19_behind():
    step = np.repeat([0.0, 1.0], 100)
    smooth = moving_median(step, 40)
    assert np.flatnonzero(smooth == 0.5).tolist() == [100]
    assert (smooth[:100] == 0).all()
    assert (smooth[101:] == 1).all()


def test_an_empty_window_is_refused():
    with pytest.raises(ValueError, match="at least one value"):
        moving_median(np.ones(3), 0)
