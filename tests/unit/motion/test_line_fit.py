import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.motion.line_fit import fit_line


def points(rng, n=40, slope=2.0, scatter=0.0):
    true = rng.normal(5.0, 10.0, n)
    x_sd, y_sd = rng.uniform(1.0, 4.0, (2, n))
    y = slope * true * (1 + scatter * rng.normal(size=n))
    return true + rng.normal(0, x_sd), x_sd, y + rng.normal(0, y_sd), y_sd


def test_it_is_orthogonal_distance_regression():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        from scipy import odr
    x, x_sd, y, y_sd = points(np.random.default_rng(1))
    found = fit_line(x, x_sd, y, y_sd, ratio=2.0)
    data = odr.RealData(x, y, x_sd, y_sd)
    free = odr.ODR(data, odr.Model(lambda b, x: b[0] + b[1] * x), [0.0, 2.0]).run()
    through = odr.ODR(data, odr.Model(lambda b, x: b[0] * x), [2.0]).run()
    assert (found.intercept, found.free_slope) == pytest.approx(free.beta, rel=1e-3)
    assert found.slope == pytest.approx(through.beta[0], rel=1e-4)
    # Its covariance is the linear one, ours the curvature at the points as they are.
    assert found.slope_sd == pytest.approx(np.sqrt(through.cov_beta[0, 0]), rel=0.1)
    assert found.free_slope_sd == pytest.approx(np.sqrt(free.cov_beta[1, 1]), rel=0.1)
    assert found.intercept_sd == pytest.approx(np.sqrt(free.cov_beta[0, 0]), rel=0.1)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 100))
def test_exchanging_the_axes_inverts_the_slope(seed):
    x, x_sd, y, y_sd = points(np.random.default_rng(seed))
    one, other = fit_line(x, x_sd, y, y_sd, ratio=2.0), fit_line(y, y_sd, x, x_sd, ratio=0.5)
    assert one.slope * other.slope == pytest.approx(1.0, rel=1e-5)
    if one.scatter == 1.0:
        assert one.p_slope == pytest.approx(other.p_slope, rel=1e-3)
    assert one.p_errors == pytest.approx(other.p_errors, rel=1e-6)


@pytest.mark.parametrize("scatter", [0.0, 0.3])
def test_a_true_line_is_refused_as_often_as_it_should_and_a_wrong_one_often(scatter):
    rng = np.random.default_rng(2)
    found = [fit_line(*points(rng, scatter=scatter), ratio=2.0) for _ in range(200)]
    assert 0.005 < np.mean([one.p_slope < 0.05 for one in found]) < 0.09
    assert 0.005 < np.mean([one.p_line < 0.05 for one in found]) < 0.09
    pulls = [(one.slope - 2.0) / one.slope_sd for one in found]
    # Scatter that grows with speed is told from few fast rotors: Student's t makes up for it.
    assert 0.85 < np.std(pulls) < (1.3 if scatter else 1.15)
    assert abs(np.mean(pulls)) < 0.2
    wrong = [fit_line(*points(rng, scatter=scatter), ratio=1.3) for _ in range(30)]
    assert np.mean([one.p_slope < 0.05 for one in wrong]) > 0.9


def test_scatter_beyond_the_errors_is_told():
    rng = np.random.default_rng(3)
    plain = fit_line(*points(rng), ratio=2.0)
    varied = fit_line(*points(rng, scatter=0.5), ratio=2.0)
    assert plain.scatter == 1.0
    assert varied.scatter > 1.5
    assert varied.p_errors < 1e-3


def test_points_that_are_not_finite_or_too_few_are_no_line():
    x, x_sd, y, y_sd = points(np.random.default_rng(4), n=5)
    x[0] = y[1] = x_sd[2] = np.nan
    found = fit_line(x, x_sd, y, y_sd, ratio=2.0)
    assert found.n == 2
    assert np.isnan(found.slope)
    assert np.isnan(found.p_slope)
