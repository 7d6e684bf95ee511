import numpy as np
import pytest

from rotortrack.motion.optimum import crossing, curvature_inverse, maximise, profile_end

COVARIANCE = np.array([[4.0, 0.6, 0.0], [0.6, 0.5, -0.1], [0.0, -0.1, 0.2]])
BEST = np.array([10.0, -1.0, 0.3])
BOUNDS = np.array([[-np.inf] * 3, [np.inf] * 3])


def normal(point):
    away = point - BEST
    return -0.5 * away @ np.linalg.solve(COVARIANCE, away)


def test_a_normal_likelihood_is_recovered_with_its_covariance():
    found = maximise(normal, BEST + np.array([5.0, 1.0, -0.5]), np.array([1.0, 0.3, 0.3]), BOUNDS)
    np.testing.assert_allclose(found.point, BEST, atol=1e-6)
    np.testing.assert_allclose(found.covariance, COVARIANCE, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(
        curvature_inverse(normal, BEST, np.ones(3)), COVARIANCE, rtol=1e-6, atol=1e-9
    )


@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_profile_of_it_ends_at_the_quantile(index, side):
    found = maximise(normal, BEST + 0.1, np.array([1.0, 0.3, 0.3]), BOUNDS)
    end = profile_end(normal, found, index, 3.84, side)
    assert end == pytest.approx(BEST[index] + side * np.sqrt(3.84 * COVARIANCE[index, index]))


def test_a_skew_likelihood_is_climbed_from_afar():
    # Of the variance of a hundred normal numbers with mean square 3, in its logarithm.
    def skew(point):
        return -50.0 * (point[0] + 3.0 * np.exp(-point[0]))

    bounds = np.array([[-5.0], [15.0]])
    found = maximise(skew, np.array([4.0]), np.array([0.2]), bounds)
    assert found.point[0] == pytest.approx(np.log(3.0), abs=0.01)
    high = profile_end(skew, found, 0, 3.84, 1.0)
    assert 2 * (skew(found.point) - skew([high])) == pytest.approx(3.84, rel=0.03)


def test_bounds_hold():
    bounds = np.array([[-np.inf, -np.inf, 1.0], [np.inf] * 3])
    found = maximise(normal, np.array([9.0, -1.0, 2.0]), np.array([1.0, 0.3, 0.3]), bounds)
    assert found.point[2] >= 1.0


def test_a_crossing_is_found_on_the_side_asked_for():
    assert crossing(lambda x: x * x - 9.0, 0.0, 0.5) == pytest.approx(3.0, abs=1e-3)
    assert crossing(lambda x: x * x - 9.0, 0.0, -0.5) == pytest.approx(-3.0, abs=1e-3)
