"""Spots on pixels against integrals: light, middle, width, and what is lost at the border."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, special

from rotortrack.simulate.film.airy import airy_pattern
from rotortrack.simulate.film.optics import Optics, Spots, gaussian_widths_nm
from rotortrack.simulate.film.options import PsfOptions

PIXEL_NM = 108.3
SIZE = 64
places = st.floats(28.0, 36.0)


def image(x_px, y_px, psf=None, light=1.0, ratio=1.0, size=SIZE):
    images = np.zeros((1, size, size))
    x, y = (np.atleast_2d(np.asarray(v, float)) * PIXEL_NM for v in (x_px, y_px))
    Optics(psf, PIXEL_NM, ratio).add(images, Spots(x, y, np.array([light])))
    return images[0]


def moments(picture):
    centres, picture = np.arange(len(picture)) + 0.5, picture / picture.sum()
    columns, rows = picture.sum(axis=0), picture.sum(axis=1)
    x, y = (columns * centres).sum(), (rows * centres).sum()
    return x, y, (columns * (centres - x) ** 2).sum(), (rows * (centres - y) ** 2).sum()


# Narrower ones are undersampled: their middle moves by 1e-3 px with the place in a pixel.
@given(x=places, y=places, sigma_nm=st.floats(110.0, 300.0))
def test_no_light_is_lost_and_its_middle_is_where_the_emitter_is(x, y, sigma_nm):
    picture = image(x, y, PsfOptions(sigma_nm=sigma_nm))
    assert picture.sum() == pytest.approx(1.0, abs=1e-6)
    assert moments(picture)[:2] == pytest.approx((x, y), abs=1e-6)


@given(shift_x=st.floats(-3.0, 3.0), shift_y=st.floats(-3.0, 3.0))
def test_a_shift_by_parts_of_a_pixel_shifts_the_middle_by_as_much(shift_x, shift_y):
    before, after = moments(image(32.2, 31.9)), moments(image(32.2 + shift_x, 31.9 + shift_y))
    assert after[0] - before[0] == pytest.approx(shift_x, abs=1e-6)
    assert after[1] - before[1] == pytest.approx(shift_y, abs=1e-6)


@given(x=places, y=places)
def test_a_pixel_holds_the_integral_of_the_gaussian_over_it(x, y):
    picture = image(x, y)
    sigma = 130.0 / PIXEL_NM
    row, column = int(y) + 1, int(x) - 1

    def part(first, middle):
        low, high = ((edge - middle) / sigma for edge in (first, first + 1))
        return special.ndtr(high) - special.ndtr(low)

    assert picture[row, column] == pytest.approx(part(row, y) * part(column, x), rel=1e-9)


def test_the_width_is_that_of_the_gaussian_and_of_the_pixel():
    _, _, across, down = moments(image(32.3, 31.8))
    expected = (130.0 / PIXEL_NM) ** 2 + 1.0 / 12.0
    assert (across, down) == pytest.approx((expected, expected), rel=1e-4)


def test_astigmatism_widens_x_and_y_on_either_side_of_the_focus():
    psf = PsfOptions(astigmatism_nm=400.0, defocus_nm=200.0, depth_nm=300.0)
    narrow, wide = gaussian_widths_nm(psf)
    assert narrow == pytest.approx(130.0)
    assert wide == pytest.approx(130.0 * math.hypot(1.0, 400.0 / 300.0))
    _, _, across, down = moments(image(32.3, 31.8, psf))
    assert across == pytest.approx((narrow / PIXEL_NM) ** 2 + 1 / 12, rel=1e-3)
    assert down == pytest.approx((wide / PIXEL_NM) ** 2 + 1 / 12, rel=1e-3)
    mirrored = gaussian_widths_nm(
        PsfOptions(astigmatism_nm=400.0, defocus_nm=-200.0, depth_nm=300.0)
    )
    assert mirrored == pytest.approx((wide, narrow))


def test_a_second_colour_may_be_wider():
    _, _, across, _ = moments(image(32.3, 31.8, ratio=1.3))
    assert across == pytest.approx((1.3 * 130.0 / PIXEL_NM) ** 2 + 1 / 12, rel=1e-4)


@pytest.mark.parametrize("model", ["gaussian", "airy"])
def test_a_moving_spot_is_the_mean_of_its_places(model):
    psf = PsfOptions(model=model)
    xs, ys = [30.1, 31.4, 33.0], [32.2, 32.9, 31.1]
    apart = sum(image(x, y, psf, light=2.0) for x, y in zip(xs, ys, strict=True))
    np.testing.assert_allclose(image(xs, ys, psf, light=6.0), apart, atol=1e-15)


@pytest.mark.parametrize("model", ["gaussian", "airy"])
@pytest.mark.parametrize("place", [(0.4, 5.3), (63.8, 63.9), (-1.5, 20.3), (66.3, 2.4)])
def test_what_falls_outside_is_lost_and_the_rest_is_as_in_a_larger_frame(model, place):
    psf = PsfOptions(model=model)
    small = image(*place, psf)
    large = image(place[0] + 64, place[1] + 64, psf, size=192)
    np.testing.assert_allclose(small, large[64:128, 64:128], atol=1e-12)


def test_far_outside_there_is_nothing():
    assert not image(500.0, -300.0).any()
    assert not image(500.0, -300.0, PsfOptions(model="airy")).any()


def test_frames_do_not_depend_on_those_beside_them():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(3000, 4000, (2, 20, 5))
    light = rng.uniform(0, 500, 20)
    optics = Optics(None, PIXEL_NM)
    whole = np.zeros((20, SIZE, SIZE))
    optics.add(whole, Spots(x, y, light))
    for cut in (slice(0, 7), slice(7, 20)):
        part = np.zeros((cut.stop - cut.start, SIZE, SIZE))
        optics.add(part, Spots(x[cut], y[cut], light[cut]))
        np.testing.assert_array_equal(part, whole[cut])


def test_what_stands_still_is_told_once():
    images = np.zeros((3, SIZE, SIZE))
    still = np.full((1, 1), 3000.0)
    Optics(None, PIXEL_NM).add(images, Spots(still, still, np.array([1.0, 0.0, 2.0])))
    np.testing.assert_allclose(images[2], 2.0 * images[0])
    assert not images[1].any()


def test_the_airy_pattern_has_the_light_and_the_zero_of_theory():
    first_zero = 1.21967 * 670.0 / 2.0 / 1.4
    assert airy_pattern(np.array([first_zero]), 670.0, 1.4)[0] < 1e-12
    inside = integrate.quad(
        lambda r: 2.0 * math.pi * r * airy_pattern(np.array(r), 670.0, 1.4), 0.0, first_zero
    )[0]
    assert inside == pytest.approx(0.8378, abs=1e-4)


@given(x=places, y=places)
def test_an_airy_spot_loses_no_light_and_stands_where_it_is(x, y):
    picture = image(x, y, PsfOptions(model="airy"))
    assert picture.sum() == pytest.approx(1.0, abs=1e-9)
    assert moments(picture)[:2] == pytest.approx((x, y), abs=2e-6)


def test_pixels_of_an_airy_spot_hold_its_integral():
    picture = image(32.3, 32.7, PsfOptions(model="airy"))
    ratios = []
    for row, column in ((32, 32), (32, 34), (30, 31), (36, 32)):
        low_x, low_y = (column - 32.3) * PIXEL_NM, (row - 32.7) * PIXEL_NM
        light = integrate.dblquad(
            lambda y, x: airy_pattern(np.hypot(x, y), 670.0, 1.4),
            *(low_x, low_x + PIXEL_NM, low_y, low_y + PIXEL_NM),
        )[0]
        ratios.append(picture[row, column] / light)
    # What lies beyond 2 um is given to the rest, evenly.
    assert 1.015 < ratios[0] < 1.03
    assert ratios == pytest.approx([ratios[0]] * 4, rel=2e-4)


def test_an_airy_pattern_is_nowhere_negative_and_is_filmed_without_background():
    rng = np.random.default_rng(4)
    images = np.zeros((50, 64, 64))
    places = rng.uniform(2000.0, 5000.0, (2, 50, 1))
    Optics(PsfOptions(model="airy"), 108.3).add(images, Spots(*places, np.array([1e6])))
    assert images.min() >= 0.0
    assert images.sum(axis=(1, 2)) == pytest.approx(1e6, rel=1e-6)
