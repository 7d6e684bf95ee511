"""Candidates are the local maxima of the plain definition."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.ndimage

from rotortrack.localise.candidates import local_maxima


def plain_maxima(plane, threshold, connectivity, border):
    footprint = scipy.ndimage.generate_binary_structure(2, 1 if connectivity == 4 else 2)
    highest = scipy.ndimage.maximum_filter(
        plane, footprint=footprint, mode="constant", cval=-np.inf
    )
    found = np.argwhere((plane >= threshold) & (plane == highest))
    inside = (found >= border).all(1) & (found < np.array(plane.shape) - border).all(1)
    return found[inside]


@pytest.mark.parametrize("connectivity", [4, 8])
@pytest.mark.parametrize("border", [0, 3])
@pytest.mark.parametrize("levels", [5, 10_000])
def test_maxima_equal_the_grey_dilation(connectivity, border, levels):
    # Few levels make plateaus and ties.
    plane = np.random.default_rng(3).integers(0, levels, (40, 31)).astype(np.float32)
    threshold = np.float32(levels * 0.6)
    np.testing.assert_array_equal(
        local_maxima(plane, threshold, connectivity, border),
        plain_maxima(plane, threshold, connectivity, border),
    )


def test_a_value_at_the_threshold_counts():
    plane = np.zeros((9, 9), np.float32)
    plane[4, 5] = 2.0
    assert local_maxima(plane, np.float32(2.0), 8, 3).tolist() == [[4, 5]]
    assert local_maxima(plane, np.float32(2.0001), 8, 3).tolist() == []


def test_nan_is_never_a_candidate():
    assert len(local_maxima(np.full((9, 9), np.nan, np.float32), np.float32(0), 8, 0)) == 0
