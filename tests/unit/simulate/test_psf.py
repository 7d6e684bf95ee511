"""The simulator's spot: against sums written out with math.erf, and what must hold of any spot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.simulate.psf import (
    add_windows,
    pixel_fractions,
    spot_images,
    window_corner,
    window_size,
)


def plain_spot(places, left, top, size, sigma):
    """Integrate a Gaussian over each pixel of a window, one place and one pixel after another."""

    def below(edge, centre):
        return 0.5 * math.erf((edge - centre) / (sigma * math.sqrt(2.0)))

    image = np.zeros((size, size))
    for x, y in places:
        for row in range(size):
            for column in range(size):
                across = below(left + column + 1, x) - below(left + column, x)
                down = below(top + row + 1, y) - below(top + row, y)
                image[row, column] += across * down / len(places)
    return image


def window(x, y, sigma, radius=0.0):
    size = window_size(radius, sigma)
    centre = np.array([[np.mean(x), np.mean(y)]])
    (corner,) = window_corner(centre, size)
    image = spot_images(np.array([x]), np.array([y]), corner[:1], corner[1:], size, sigma)
    return image[0], corner


def test_moving_spot_equals_the_plain_sum_over_places_and_pixels():
    x, y = [20.3, 21.1, 20.9], [11.7, 10.2, 12.4]
    image, (left, top) = window(x, y, 1.3, radius=1.5)
    expected = plain_spot(list(zip(x, y, strict=True)), left, top, image.shape[0], 1.3)
    np.testing.assert_allclose(image, expected, rtol=0, atol=1e-14)


@settings(max_examples=50, deadline=None)
@given(
    x=st.floats(-3.0, 40.0),
    y=st.floats(-3.0, 40.0),
    sigma=st.floats(0.9, 3.0),
)
def test_light_is_conserved_to_1e_6_and_its_centroid_is_the_place(x, y, sigma):
    image, (left, top) = window([x], [y], sigma)
    pixels = np.arange(image.shape[0]) + 0.5
    assert image.sum() == pytest.approx(1.0, abs=1e-6)
    # Sampling an integrated Gaussian shifts its centroid by less than exp(-2 pi^2 sigma^2).
    assert image.sum(axis=0) @ pixels + left == pytest.approx(x, abs=1e-6)
    assert image.sum(axis=1) @ pixels + top == pytest.approx(y, abs=1e-6)


def test_spot_at_the_rim_of_its_circle_keeps_its_light_within_the_window():
    size = window_size(1.6, 1.2)
    (corner,) = window_corner(np.array([[30.999, 20.001]]), size)
    for angle in np.linspace(0.0, 2.0 * np.pi, 12):
        place = (
            np.array([[30.999 + 1.6 * np.cos(angle)]]),
            np.array([[20.001 - 1.6 * np.sin(angle)]]),
        )
        image = spot_images(*place, corner[:1], corner[1:], size, 1.2)
        assert image.sum() == pytest.approx(1.0, abs=2e-7)


def test_variance_along_a_row_is_that_of_the_gaussian_plus_a_pixel():
    fractions = pixel_fractions(np.array([10.4]), np.array([0]), 21, 1.25)[0]
    pixels = np.arange(21) + 0.5
    variance = fractions @ (pixels - 10.4) ** 2
    assert variance == pytest.approx(1.25**2 + 1.0 / 12.0, abs=1e-6)


@pytest.mark.parametrize("left", [[3, 3, 3], [3, 4, -2]])
def test_windows_are_added_at_their_corners_and_cut_at_the_frame(left):
    rng = np.random.default_rng(3)
    windows = rng.random((3, 5, 5))
    top = np.array([-2, -2, -2]) if left[0] == left[1] else np.array([6, -2, 1])
    frames = np.ones((3, 8, 6))
    add_windows(frames, windows, np.array(left), top)
    for number in range(3):
        padded = np.pad(np.ones((8, 6)), 10)
        y, x = 10 + top[number], 10 + left[number]
        padded[y : y + 5, x : x + 5] += windows[number]
        np.testing.assert_array_equal(frames[number], padded[10:18, 10:16])


def test_window_wholly_outside_the_frame_adds_nothing():
    frames = np.zeros((2, 8, 6))
    add_windows(frames, np.ones((2, 3, 3)), np.array([6, 6]), np.array([-3, -3]))
    assert not frames.any()
