"""Two colours on one sensor: each term of the distortion by itself, and the way back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.simulate.film.options import SplitOptions
from rotortrack.simulate.film.split import Split

PIXEL_NM = 100.0
SHAPE_PX = (200, 400)
"""Height and width: halves of 20 x 20 um side by side, of 40 x 10 um one below the other."""


def split_of(**options):
    return Split(SplitOptions(**options), SHAPE_PX, PIXEL_NM)


def seen(place, **options):
    x, y = split_of(**options).to_second(np.array([place[0]]), np.array([place[1]]))
    return float(x[0]), float(y[0])


@pytest.mark.parametrize(
    ("layout", "there"), [("left-right", (23000.0, 4000.0)), ("top-bottom", (3000.0, 14000.0))]
)
def test_without_distortion_the_second_half_shows_the_same(layout, there):
    assert seen((3000.0, 4000.0), layout=layout) == pytest.approx(there)


def test_a_shift_is_added():
    assert seen((3000.0, 4000.0), shift_nm=(12.0, -7.0)) == pytest.approx((23012.0, 3993.0))


def test_magnification_is_about_the_middle_of_the_half():
    assert seen((10000.0, 10000.0), scale=1.1) == pytest.approx((30000.0, 10000.0))
    assert seen((11000.0, 8000.0), scale=1.1) == pytest.approx((31100.0, 7800.0))


def test_a_positive_turn_is_counter_clockwise_on_the_image():
    # What lies right of the middle moves up, which is to smaller y.
    turned = seen((15000.0, 10000.0), rotation_deg=2.0)
    turn = math.radians(2.0)
    expected = (30000.0 + 5000.0 * math.cos(turn), 10000.0 - 5000.0 * math.sin(turn))
    assert turned == pytest.approx(expected)


def test_shear_moves_x_by_y():
    assert seen((10000.0, 15000.0), shear=0.01) == pytest.approx((30050.0, 15000.0))


def test_a_mirrored_image_is_flipped_left_to_right():
    assert seen((12000.0, 4000.0), mirrored=True) == pytest.approx((28000.0, 4000.0))


@pytest.mark.parametrize("mirrored", [False, True])
def test_radial_distortion_points_outwards_and_grows_with_the_cube(mirrored):
    side = -1.0 if mirrored else 1.0
    edge = seen((20000.0, 10000.0), radial_nm=120.0, mirrored=mirrored)
    assert edge == pytest.approx((30000.0 + side * 10120.0, 10000.0))
    halfway = seen((10000.0, 15000.0), radial_nm=120.0, mirrored=mirrored)
    assert halfway == pytest.approx((30000.0, 15000.0 + 120.0 / 8.0))


def test_the_edge_of_a_long_half_is_that_of_its_longer_side():
    edge = seen((40000.0, 5000.0), radial_nm=120.0, layout="top-bottom")
    assert edge == pytest.approx((40120.0, 15000.0))


def test_keystone_moves_the_corners_along_x():
    corners = {(20000.0, 20000.0): 40.0, (0.0, 20000.0): -40.0, (20000.0, 0.0): -40.0}
    for corner, moved in corners.items():
        expected = (corner[0] + 20000.0 + moved, corner[1])
        assert seen(corner, keystone_nm=40.0) == pytest.approx(expected)
    assert seen((20000.0, 10000.0), keystone_nm=40.0) == pytest.approx((40000.0, 10000.0))


@given(
    layout=st.sampled_from(["left-right", "top-bottom"]),
    shift_nm=st.tuples(st.floats(-3000, 3000), st.floats(-3000, 3000)),
    scale=st.floats(0.81, 1.2),
    rotation_deg=st.floats(-180, 180),
    shear=st.floats(-0.1, 0.1),
    radial_nm=st.floats(-300, 300),
    keystone_nm=st.floats(-300, 300),
    mirrored=st.booleans(),
    places=st.lists(
        st.tuples(st.floats(-2000, 42000), st.floats(-2000, 22000)), min_size=1, max_size=5
    ),
)
def test_the_way_back_is_exact(places, **options):
    split = split_of(**options)
    x, y = np.array(places).T
    back = split.to_first(*split.to_second(x, y))
    assert np.abs(back[0] - x).max() < 1e-6
    assert np.abs(back[1] - y).max() < 1e-6


def test_a_distortion_that_folds_the_image_is_not_undone():
    split = split_of(radial_nm=-9000.0)
    with pytest.raises(ArithmeticError, match="too strong"):
        split.to_first(np.array([41000.0]), np.array([21000.0]))


def test_places_keep_their_shape():
    x, y = split_of(radial_nm=50.0).to_second(np.zeros((3, 1)), np.zeros((3, 4)))
    assert x.shape == y.shape == (3, 4)
