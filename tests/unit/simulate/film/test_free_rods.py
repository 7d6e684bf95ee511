"""Rods that drift by: Brownian motion with a flow, seen through exposures."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.free_rods import FreeRods
from rotortrack.simulate.film.options import FreeRodsOptions

T = 0.002
SHAPE_PX, PIXEL_NM = (100, 200), 100.0
SIZE_NM = (24_000.0, 14_000.0)
"""Of the field and 2 um around it."""

D_UM2_S = 3.0
D_NM2_S = D_UM2_S * 1e6


def rods_of(n, exposure_s=T, seed=5, **options):
    clock = Clock(n, T, exposure_s)
    return FreeRods(FreeRodsOptions(**options), clock, SHAPE_PX, PIXEL_NM, seed)


def steps_of(rods):
    """Ways from exposure to exposure, x and y of all rods, whichever side they came in."""
    ways = []
    for axis, size_nm in enumerate(SIZE_NM):
        places = np.array([rod[axis].mean(axis=1) for rod in rods])
        ways.append((np.diff(places, axis=1) + 0.5 * size_nm) % size_nm - 0.5 * size_nm)
    return np.array(ways)


@pytest.mark.parametrize("exposure_s", [0.0, 0.5 * T, T])
def test_steps_between_exposures_have_the_blurred_law(exposure_s):
    flow_um_s = (20.0, -7.0)
    rods = rods_of(4000, exposure_s, count=6, diffusion_um2_s=D_UM2_S, flow_um_s=flow_um_s)
    steps = steps_of(rods.advance(4000))
    count = steps[0].size
    variance = 2.0 * D_NM2_S * (T - exposure_s / 3.0)
    for axis in range(2):
        # Errors of neighbouring steps hardly sum up in their mean: the way from end to end.
        error = 5.0 * math.sqrt(2.0 * D_NM2_S * T / count)
        assert steps[axis].mean() == pytest.approx(1e3 * flow_um_s[axis] * T, abs=error)
        error = 5.0 * math.sqrt(2.0 / count) * variance * 1.2
        assert steps[axis].var() == pytest.approx(variance, abs=error)
        neighbours = steps[axis] - steps[axis].mean()
        found = (neighbours[:, 1:] * neighbours[:, :-1]).mean()
        assert found == pytest.approx(D_NM2_S * exposure_s / 3.0, abs=5.0 * variance / count**0.5)
    across = (steps[0] - steps[0].mean()) * (steps[1] - steps[1].mean())
    assert across.mean() == pytest.approx(0.0, abs=5.0 * variance / math.sqrt(count))


def test_parts_of_an_exposure_are_means_over_equal_times():
    ((x_nm, _, _),) = rods_of(4000, count=1, diffusion_um2_s=D_UM2_S).advance(4000)
    parts = x_nm.shape[1]
    # The least number whose rms way is 60 nm.
    assert parts == math.ceil(2.0 * D_NM2_S * T / 60.0**2)
    steps = np.diff(x_nm, axis=1)
    expected = 2.0 * D_NM2_S * (T / parts) * 2.0 / 3.0
    assert steps.var() == pytest.approx(expected, rel=6.0 * math.sqrt(2.0 / steps.size))


@pytest.mark.parametrize(
    ("exposure_s", "diffusion", "flow", "parts"),
    [
        (0.0, 3.0, (9.0, 0.0), 1),
        (T, 0.01, (0.0, 0.0), 1),
        (T, 1e-9, (0.0, 149.0), 5),
        (T, 1e4, (0.0, 0.0), 50),
    ],
)
def test_there_are_as_many_parts_as_the_motion_needs(exposure_s, diffusion, flow, parts):
    rods = rods_of(3, exposure_s, count=2, diffusion_um2_s=diffusion, flow_um_s=flow)
    for x_nm, y_nm, photons in rods.advance(3):
        assert x_nm.shape == y_nm.shape == (3, parts)
        assert photons.shape == (1,)


def test_they_are_everywhere_and_stay_everywhere():
    count = 600
    rods = rods_of(400, count=count, diffusion_um2_s=200.0, flow_um_s=(9000.0, -4000.0))
    lights = rods.advance(400)
    for axis, size_nm in enumerate(SIZE_NM):
        places = np.array([rod[axis].mean(axis=1) for rod in lights])
        assert places.min() >= -2000.0
        assert places.max() < size_nm - 2000.0
        for frame in (0, 399):
            even = stats.uniform(-2000.0, size_nm)
            assert stats.kstest(places[:, frame], even.cdf).pvalue > 1e-3


def test_an_exposure_at_the_edge_is_not_torn():
    lights = rods_of(3000, count=5, diffusion_um2_s=200.0).advance(3000)
    extent = max(np.ptp(rod[axis], axis=1).max() for rod in lights for axis in range(2))
    assert extent < 10.0 * math.sqrt(2.0 * 200e6 * T)


def test_brightness_is_drawn_from_its_range_once():
    photons = [rod[2][0] for rod in rods_of(2, count=500, photons=(300.0, 1000.0)).advance(2)]
    assert stats.kstest(photons, stats.uniform(300.0, 700.0).cdf).pvalue > 1e-3
    again = rods_of(2, count=2, photons=(300.0, 1000.0))
    first = [rod[2][0] for rod in again.advance(1)]
    assert first == [rod[2][0] for rod in again.advance(1)] == photons[:2]


def test_more_rods_change_none_of_the_others():
    few, many = rods_of(30, count=3).advance(30), rods_of(30, count=5).advance(30)
    for left, right in zip(few, many, strict=False):
        for one, other in zip(left, right, strict=True):
            np.testing.assert_array_equal(one, other)


def test_blur_leaves_rods_where_they_are():
    sharp = rods_of(300, 0.0, count=2).advance(300)
    blurred = rods_of(300, 1e-9, count=2).advance(300)
    for (x_nm, y_nm, _), (blurred_x_nm, blurred_y_nm, _) in zip(sharp, blurred, strict=True):
        np.testing.assert_allclose(blurred_x_nm, x_nm, atol=0.5)
        np.testing.assert_allclose(blurred_y_nm, y_nm, atol=0.5)


def test_a_flow_moves_rods_by_half_an_exposure_until_its_middle():
    flow = {"count": 3, "diffusion_um2_s": 1e-15, "flow_um_s": (100.0, 0.0)}
    sharp, blurred = (rods_of(20, exposure_s, **flow).advance(20) for exposure_s in (0.0, T))
    for one, other in zip(sharp, blurred, strict=True):
        np.testing.assert_allclose(other[0].mean(axis=1) - one[0][:, 0], 100e3 * T / 2, atol=0.1)
        np.testing.assert_allclose(other[1].mean(axis=1), one[1][:, 0], atol=0.1)


@settings(max_examples=30)
@given(
    cuts=st.lists(st.integers(1, 99), max_size=10, unique=True),
    exposure_s=st.sampled_from([0.0, 0.4 * T, T]),
)
def test_blocks_do_not_change_a_bit(cuts, exposure_s):
    options = {"count": 2, "diffusion_um2_s": 50.0, "flow_um_s": (300.0, 0.0)}
    piecewise = rods_of(100, exposure_s, **options)
    pieces = [
        piecewise.advance(after - before) for before, after in pairwise([0, *sorted(cuts), 100])
    ]
    whole = rods_of(100, exposure_s, **options).advance(100)
    for rod, expected in enumerate(whole):
        for axis in range(2):
            joined = np.concatenate([piece[rod][axis] for piece in pieces])
            np.testing.assert_array_equal(joined, expected[axis])
