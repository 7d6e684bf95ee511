"""The covariance estimator of D, against what was put in and by what must not change it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.motion.covariance import StepProducts, covariance_estimate, step_products
from rotortrack.motion.readings import Timing


def sums_of(table):
    parts = [part for _, part in table.groupby("truth")]
    return [step_products(*(p[n].to_numpy() for n in ("frame", "x_nm", "y_nm"))) for p in parts]


@pytest.mark.parametrize("exposed", [1.0, 0.5, 0.0])
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_diffusion_and_noise_of_many_short_tracks_are_unbiased(swimming, exposed, missing):
    rng = np.random.default_rng(3)
    table = swimming(rng, 1500, 40, exposed=exposed, missing=missing)
    found = covariance_estimate(
        sum(sums_of(table), StepProducts(0, 0, 0.0, 0.0)), Timing(0.01, 0.01 * exposed)
    )
    assert found.diffusion_nm2_s == pytest.approx(1e5, rel=0.03)
    assert np.sqrt(found.noise_nm2) == pytest.approx(20.0, rel=0.05)


def test_the_standard_deviation_is_that_of_the_scatter(swimming):
    table = swimming(np.random.default_rng(4), 1000, 60)
    found = [covariance_estimate(sums, Timing(0.01, 0.01)) for sums in sums_of(table)]
    scatter = np.std([one.diffusion_nm2_s for one in found])
    told = np.sqrt(np.mean([one.diffusion_sd_nm2_s**2 for one in found]))
    assert told == pytest.approx(scatter, rel=0.1)


def test_steps_over_missing_frames_are_left_out():
    frame = np.array([0, 1, 2, 4, 5, 9, 10, 11])
    x = np.array([0.0, 1.0, 3.0, 90.0, 91.0, 500.0, 502.0, 499.0])
    sums = step_products(frame, x, np.zeros(8))
    assert (sums.steps, sums.pairs) == (5, 2)
    assert sums.squares == 1 + 4 + 1 + 4 + 9
    assert sums.products == 1 * 2 + 2 * -3


def test_a_particle_left_out_is_as_if_it_had_not_been_there(swimming):
    one, two, three = sums_of(swimming(np.random.default_rng(5), 3, 30))
    left = one + two + three - two
    assert (left.steps, left.pairs) == ((one + three).steps, (one + three).pairs)
    assert left.squares == pytest.approx((one + three).squares)


def test_a_common_flow_is_taken_off():
    frame = np.arange(6)
    sums = step_products(frame, 3.0 * frame, -2.0 * frame, (3.0, -2.0))
    assert sums.squares == 0.0
    assert sums.products == 0.0


def test_without_adjoining_steps_nothing_is_known():
    sums = step_products(np.array([0, 1, 5, 6]), np.arange(4.0), np.arange(4.0))
    assert np.isnan(covariance_estimate(sums, Timing(0.01, 0.01)).diffusion_nm2_s)


@given(
    st.lists(st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)), min_size=3, max_size=30),
    st.floats(-1e5, 1e5),
    st.floats(0.1, 10.0),
)
def test_place_direction_of_time_and_axes_do_not_matter(places, shift, scale):
    x, y = np.array(places).T
    frame = np.arange(x.size)
    timing = Timing(0.01, 0.004)
    plain = covariance_estimate(step_products(frame, x, y), timing)
    moved = step_products(frame, -scale * y[::-1] + shift, scale * x[::-1] - shift)
    other = covariance_estimate(moved, timing)
    size = scale**2 * (np.ptp(x) ** 2 + np.ptp(y) ** 2 + 1.0) * 1e2
    assert other.diffusion_nm2_s == pytest.approx(scale**2 * plain.diffusion_nm2_s, abs=1e-6 * size)
    assert other.noise_nm2 == pytest.approx(scale**2 * plain.noise_nm2, abs=1e-6 * size)
