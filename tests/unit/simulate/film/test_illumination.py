"""Laser, background and flicker against their laws."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.film import illumination as module
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.illumination import Flicker, background_image, laser_at, laser_map
from rotortrack.simulate.film.options import BackgroundOptions, FlickerOptions, LaserOptions

PIXEL_NM = 100.0
T = 0.002


@pytest.fixture
def no_draws(monkeypatch):
    def refuse(*_):
        raise AssertionError("a stream was asked for")

    monkeypatch.setattr(module, "stream", refuse)
    monkeypatch.setattr(module.Streams, "of", refuse)


def test_the_laser_falls_to_the_square_of_1_over_e_at_its_waist():
    options = LaserOptions(waist_nm=4000.0, centre_nm=(3000.0, 1000.0))
    x_nm = 3000.0 + 4000.0 * np.array([0.0, 1.0, -0.6, 0.0])
    y_nm = 1000.0 + 4000.0 * np.array([0.0, 0.0, 0.8, 0.5])
    light = laser_at(options, (64, 32), PIXEL_NM, x_nm, y_nm)
    np.testing.assert_allclose(light, np.exp([0.0, -2.0, -2.0, -0.5]))


def test_without_a_place_the_laser_is_in_the_middle_of_the_field():
    image = laser_map(LaserOptions(waist_nm=2000.0), (40, 60), PIXEL_NM)
    assert image.shape == (40, 60)
    np.testing.assert_array_equal(image, image[::-1, ::-1])
    assert image[20, 30] == image.max() == pytest.approx(math.exp(-4.0 * (50.0 / 2000.0) ** 2))


def test_the_map_is_the_light_in_the_middle_of_each_pixel_and_has_all_its_power():
    options = LaserOptions(waist_nm=900.0, centre_nm=(2000.0, 3400.0))
    image = laser_map(options, (64, 50), PIXEL_NM)
    row, column = 30, 22
    there = laser_at(options, (64, 50), PIXEL_NM, np.array(2250.0), np.array(3050.0))
    assert image[row, column] == pytest.approx(float(there))
    power = image.sum() * PIXEL_NM**2
    assert power == pytest.approx(0.5 * math.pi * 900.0**2, rel=1e-3)


@pytest.mark.usefixtures("no_draws")
def test_an_even_background_is_even_and_draws_nothing():
    image = background_image(BackgroundOptions(photons=7.0), (5, 8), PIXEL_NM, 1)
    np.testing.assert_array_equal(image, np.full((5, 8), 7.0))


@pytest.mark.usefixtures("no_draws")
def test_a_gradient_changes_the_light_from_edge_to_edge():
    image = background_image(
        BackgroundOptions(photons=10.0, gradient=(0.4, -0.2)), (20, 50), PIXEL_NM, 1
    )
    assert image.mean() == pytest.approx(10.0)
    # From pixel to pixel, edges being half a pixel outside the first and last middles.
    np.testing.assert_allclose(np.diff(image, axis=1), 10.0 * 0.4 / 50.0)
    np.testing.assert_allclose(np.diff(image, axis=0), -10.0 * 0.2 / 20.0)


@pytest.mark.parametrize("length_px", [0.4, 1.0, 4.0])
def test_the_texture_has_the_correlations_of_a_gaussian_field(length_px):
    options = BackgroundOptions(photons=10.0, texture=0.1, texture_length_nm=length_px * PIXEL_NM)
    seeds, (height, width) = 150, (48, 64)
    images = [background_image(options, (height, width), PIXEL_NM, seed) for seed in range(seeds)]
    fields = (np.array(images) / 10.0 - 1.0) / 0.1
    # Pixels whose products are independent of one another.
    free = fields.size / (1.0 + math.pi * length_px**2)
    assert fields.mean() == pytest.approx(0.0, abs=5.0 * math.sqrt(2.0 / free))
    error = 5.0 * math.sqrt(2.0 / free)
    for down, across in ((0, 0), (0, 1), (1, 0), (2, 1), (0, 4), (6, 0)):
        here = fields[:, : height - down, : width - across]
        there = fields[:, down:, across:]
        expected = math.exp(-0.5 * (down**2 + across**2) / length_px**2)
        assert (here * there).mean() == pytest.approx(expected, abs=error)
    for ends in (fields[:, 0] * fields[:, -1], fields[:, :, 0] * fields[:, :, -1]):
        edge = ends.size / (1.0 + math.sqrt(math.pi) * length_px)
        assert ends.mean() == pytest.approx(0.0, abs=5.0 / math.sqrt(edge))


def test_a_background_that_would_be_negative_is_refused():
    with pytest.raises(ConfigurationError, match="% of the pixels negative"):
        background_image(BackgroundOptions(gradient=(2.0, 2.0)), (20, 20), PIXEL_NM, 1)


def test_a_texture_coarser_than_the_field_is_refused():
    options = BackgroundOptions(texture=0.1, texture_length_nm=2100.0)
    with pytest.raises(ConfigurationError, match="longer than the field of 2000 nm"):
        background_image(options, (10, 20), PIXEL_NM, 1)


def flicker_of(n, exposure_s=T, seed=5, **options):
    return Flicker(FlickerOptions(**options), Clock(n, T, exposure_s), seed).advance(n)


@pytest.mark.usefixtures("no_draws")
@pytest.mark.parametrize("time_s", [0.0, 0.1])
def test_no_flicker_is_steady_and_draws_nothing(time_s):
    np.testing.assert_array_equal(flicker_of(9, sd=0.0, time_s=time_s), np.ones(9))


def covariance(values, lag):
    """Covariance about 1 at a lag, and its standard error from blocks of 500."""
    products = (values[: values.size - lag] - 1.0) * (values[lag:] - 1.0)
    blocks = products[: products.size // 500 * 500].reshape(-1, 500).mean(axis=1)
    return products.mean(), blocks.std() / math.sqrt(blocks.size)


def test_flicker_without_a_time_is_new_in_each_frame():
    n, sd = 50_000, 0.05
    factors = flicker_of(n, sd=sd)
    assert factors.mean() == pytest.approx(1.0, abs=5.0 * sd / math.sqrt(n))
    assert factors.std() == pytest.approx(sd, rel=5.0 * math.sqrt(0.5 / n))
    for lag in (1, 2, 10):
        found, error = covariance(factors, lag)
        assert found == pytest.approx(0.0, abs=5.0 * error)


@pytest.mark.parametrize("exposure_s", [0.0, 0.5 * T, T])
@pytest.mark.parametrize("time_s", [0.0007, 0.02])
def test_flicker_with_a_time_has_the_correlations_of_averages_over_exposures(exposure_s, time_s):
    n, sd = 100_000, 0.05
    factors = flicker_of(n, exposure_s, sd=sd, time_s=time_s)
    a = exposure_s / time_s
    at_once = 2.0 * (a - 1.0 + math.exp(-a)) / a**2 if a else 1.0
    apart = 2.0 * (math.cosh(a) - 1.0) / a**2 if a else 1.0
    for lag in (0, 1, 5):
        expected = at_once if lag == 0 else apart * math.exp(-lag * T / time_s)
        found, error = covariance(factors, lag)
        assert found == pytest.approx(sd**2 * expected, abs=5.0 * error)


def test_light_is_never_negative():
    factors = flicker_of(50_000, sd=0.3)
    assert factors.min() == 0.0


@settings(max_examples=30)
@given(
    cuts=st.lists(st.integers(1, 199), max_size=12, unique=True),
    time_s=st.sampled_from([0.0, 0.01]),
)
def test_blocks_do_not_change_a_bit(cuts, time_s):
    def flicker():
        return Flicker(FlickerOptions(sd=0.1, time_s=time_s), Clock(200, T, 0.5 * T), 5)

    piecewise = flicker()
    pieces = [
        piecewise.advance(after - before) for before, after in pairwise([0, *sorted(cuts), 200])
    ]
    np.testing.assert_array_equal(np.concatenate(pieces), flicker().advance(200))
