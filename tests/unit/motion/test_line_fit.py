import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.motion.line_fit import fit_line


def points(rng, n=40, slope=2.0, scatter=0.0):
    true = rng.normal(5.0, 10.0, n)
    x_sd, y_sd = rng.uniform(1.0, 4.0, (2, n))
    y = slope * true * (1 + scatter * rng.normal(size=n))
    return true + rng.normal(0, x_sd), x_sd, y + rng.normal(0, y_sd), y_sd


def test_without_scatter_it_is_orthogonal_distance_regression():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        from scipy import odr
    x, x_sd, y, y_sd = points(np.random.default_rng(1), n=400)
    found = fit_line(x, x_sd, y, y_sd, ratio=2.0)
    data = odr.RealData(x, y, x_sd, y_sd)
    free = odr.ODR(data, odr.Model(lambda b, x: b[0] + b[1] * x), [0.0, 2.0]).run()
    through = odr.ODR(data, odr.Model(lambda b, x: b[0] * x), [2.0]).run()
    assert found.slope == pytest.approx(through.beta[0], abs=0.3 * found.slope_sd)
    assert found.free_slope == pytest.approx(free.beta[1], abs=0.3 * found.free_slope_sd)
    assert found.intercept == pytest.approx(free.beta[0], abs=0.3 * found.intercept_sd)
    assert found.slope_sd == pytest.approx(np.sqrt(through.cov_beta[0, 0]), rel=0.15)
    assert found.free_slope_sd == pytest.approx(np.sqrt(free.cov_beta[1, 1]), rel=0.15)
    assert found.intercept_sd == pytest.approx(np.sqrt(free.cov_beta[0, 0]), rel=0.15)


@pytest.mark.parametrize("n", [10, 40])
@pytest.mark.parametrize("scatter", [0.0, 0.1, 0.3])
def test_a_true_line_is_refused_in_5_percent_and_slopes_have_pulls_of_one(n, scatter):
    rng = np.random.default_rng(2)
    found = [fit_line(*points(rng, n, scatter=scatter), ratio=2.0) for _ in range(500)]
    most = 0.08 if scatter == 0.0 else 0.11
    assert 0.01 < np.mean([one.p_slope < 0.05 for one in found]) < most
    assert 0.01 < np.mean([one.p_line < 0.05 for one in found]) < most
    pulls = np.array([(one.slope - 2.0) / one.slope_sd for one in found])
    known = pulls[np.isfinite(pulls)]
    assert known.size > 480
    # With ten points a standard deviation is itself known to a quarter.
    assert 0.85 < np.std(known) < (1.2 if n == 40 else 1.5)
    assert abs(np.mean(known)) < 0.25


def test_a_wrong_line_is_refused():
    rng = np.random.default_rng(5)
    for scatter, least in ((0.0, 0.99), (0.3, 0.7)):
        wrong = [fit_line(*points(rng, scatter=scatter), ratio=1.4) for _ in range(100)]
        assert np.mean([one.p_slope < 0.05 for one in wrong]) > least


@pytest.mark.parametrize(("n", "least"), [(7, 5e-3), (30, 1e-6)])
def test_a_line_of_half_the_slope_is_refused_the_more_clearly_the_more_rotors(n, least):
    rng = np.random.default_rng(8)
    wrong = [fit_line(*points(rng, n, slope=1.0), ratio=2.0) for _ in range(200)]
    assert np.median([one.p_slope for one in wrong]) < least
    assert np.median([one.p_line for one in wrong]) < 10 * least


def test_scatter_beyond_the_errors_is_told():
    rng = np.random.default_rng(3)
    plain = fit_line(*points(rng), ratio=2.0)
    varied = fit_line(*points(rng, scatter=0.5), ratio=2.0)
    assert plain.scatter < 1.3
    assert plain.p_errors > 0.01
    assert varied.scatter > 1.5
    assert varied.p_errors < 1e-3


@given(scale=st.floats(1e-3, 1e3))
def test_units_do_not_matter(scale):
    x, x_sd, y, y_sd = points(np.random.default_rng(6))
    one, other = (fit_line(x * s, x_sd * s, y * s, y_sd * s, ratio=2.0) for s in (1.0, scale))
    assert other.slope == pytest.approx(one.slope)
    assert other.intercept == pytest.approx(scale * one.intercept, rel=1e-6)
    assert other.p_line == pytest.approx(one.p_line, rel=1e-6)


def test_rotors_that_do_not_turn_before_tell_no_slope():
    rng = np.random.default_rng(7)
    sd = np.ones(30)
    found = fit_line(rng.normal(0, sd), sd, rng.normal(0, sd), sd, ratio=2.0)
    assert np.isnan(found.slope)
    assert found.p_slope > 0.001


def test_points_that_are_not_finite_or_too_few_are_no_line():
    x, x_sd, y, y_sd = points(np.random.default_rng(4), n=5)
    x[0] = y[1] = x_sd[2] = np.nan
    found = fit_line(x, x_sd, y, y_sd, ratio=2.0)
    assert found.n == 2
    assert np.isnan(found.slope)
    assert np.isnan(found.p_slope)
