"""The wavelet planes equal the plain computation of their definition."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.localise.wavelet import bspline_taps, wavelet_planes


def plain_planes(frame, order, scale):
    taps = bspline_taps(order, scale)
    dilated = np.zeros(2 * taps.size - 1)
    dilated[::2] = taps
    margin = dilated.size // 2
    padded = np.pad(frame.astype(float), margin, mode="edge")

    def blur(image, kernel):
        for axis in (0, 1):
            image = scipy.ndimage.convolve1d(image, kernel, axis, mode="constant")
        return image

    v1 = blur(padded, taps)
    v2 = blur(v1, dilated)
    inside = (slice(margin, -margin), slice(margin, -margin))
    return v1[inside] - v2[inside], frame - v1[inside], frame - v2[inside]


def test_taps_of_the_default_are_one_four_six_four_one():
    np.testing.assert_allclose(bspline_taps(3, 2.0) * 16, [1, 4, 6, 4, 1], atol=1e-15)


@given(order=st.integers(1, 8), scale=st.floats(0.5, 4.0))
@settings(max_examples=60, deadline=None)
def test_taps_are_symmetric_positive_and_sum_to_one(order, scale):
    taps = bspline_taps(order, scale)
    assert taps.size % 2 == 1
    assert taps.sum() == pytest.approx(1.0, abs=1e-12)
    if order > 1:
        np.testing.assert_allclose(taps, taps[::-1], atol=1e-12)
        assert (taps > 0).all()


@pytest.mark.parametrize(("order", "scale"), [(3, 2.0), (1, 3.0), (4, 1.5), (5, 3.0)])
@pytest.mark.parametrize("shape", [(7, 7), (9, 40), (33, 18)])
def test_planes_equal_the_plain_convolutions_border_included(order, scale, shape):
    frame = np.random.default_rng(1).poisson(30.0, shape).astype(np.float32)
    planes = wavelet_planes(frame, bspline_taps(order, scale).astype(np.float32))
    for ours, plain in zip(planes, plain_planes(frame, order, scale), strict=True):
        np.testing.assert_allclose(ours, plain, atol=1e-5 * np.ptp(frame))


def test_a_flat_frame_gives_zero_planes_away_from_the_border():
    planes = wavelet_planes(
        np.full((20, 30), 100.0, np.float32), bspline_taps(3, 2.0).astype(np.float32)
    )
    np.testing.assert_allclose(planes.f[2:-2, 2:-2], 0.0, atol=1e-4)
    np.testing.assert_allclose(planes.f1, 0.0, atol=1e-4)
