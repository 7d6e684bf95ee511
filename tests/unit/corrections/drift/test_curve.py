import numpy as np
import pytest

from rotortrack.corrections.drift.curve import _line_at, curve_through, loess


def test_two_points_in_the_window_leave_the_values_alone():
    y = np.random.default_rng(0).normal(size=10)
    assert loess(np.arange(10.0), y, 2).tolist() == y.tolist()


def test_a_line_is_kept_by_any_window():
    x = np.array([0.0, 1.0, 2.5, 3.0, 5.0, 8.0])
    for points in range(2, 7):
        assert loess(x, 3 - 0.5 * x, points) == pytest.approx(3 - 0.5 * x, abs=1e-12)


def test_local_line_is_the_weighted_least_squares_line():
    x, y = np.arange(4.0), np.array([0.0, 1.0, 0.0, 1.0])
    w = np.sqrt((1 - (x / 3) ** 3) ** 3)
    design = np.column_stack([np.ones(4), x])
    first = np.linalg.lstsq(design * w[:, None], y * w, rcond=None)[0][0]
    assert _line_at(x, y, w**2, fallback=np.nan) == pytest.approx(first, abs=1e-12)


def test_one_outlier_among_many_bins_is_ignored():
    x = np.arange(20.0)
    y = 0.1 * x + np.random.default_rng(1).normal(0, 0.01, 20)
    spoilt = y.copy()
    spoilt[10] += 50
    smoothed = loess(x, spoilt, 8)
    assert smoothed == pytest.approx(0.1 * x, abs=0.05)


def test_smoothing_lowers_noise():
    rng = np.random.default_rng(2)
    x = np.arange(40.0)
    noise = rng.normal(size=40)
    assert np.std(loess(x, noise, 20)) < 0.5 * np.std(noise)


def test_natural_spline_passes_the_knots_with_no_curvature_at_its_ends():
    knots = np.array([0.0, 1.0, 3.0, 4.0, 6.0])
    values = np.array([0.0, 2.0, -1.0, 0.5, 1.0])
    assert curve_through(knots, values, knots) == pytest.approx(values, abs=1e-12)
    h = 1e-3
    for end, side in ((0.0, 1), (6.0, -1)):
        a, b, c = curve_through(knots, values, end + side * h * np.arange(3.0))
        assert (a - 2 * b + c) / h**2 == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("n", [2, 3, 6])
def test_beyond_the_outer_knots_the_slope_is_constant_and_continuous(n):
    knots = np.arange(n, dtype=float)
    values = np.sin(2 * knots)
    h = 1e-5
    for end, side in ((knots[0], -1), (knots[-1], 1)):
        inside, at, near, far = curve_through(
            knots, values, end + side * np.array([-h, 0.0, 1.0, 5.0])
        )
        assert near - at == pytest.approx((at - inside) / h, abs=1e-3)
        assert far - at == pytest.approx(5 * (near - at), abs=1e-9)


def test_fewer_than_four_knots_are_joined_by_straight_lines():
    knots, values = np.array([0.0, 2.0, 3.0]), np.array([0.0, 4.0, 1.0])
    assert curve_through(knots, values, np.array([1.0, 2.0, 2.5])).tolist() == [2.0, 4.0, 2.5]


def test_single_knot_gives_a_constant():
    assert curve_through(np.array([5.0]), np.array([2.0]), np.arange(3.0)).tolist() == [2.0] * 3


def test_several_curves_at_once_equal_one_by_one():
    rng = np.random.default_rng(3)
    for n in (3, 7):
        knots, values, at = np.arange(n) * 1.5, rng.normal(size=(n, 4)), np.linspace(-3, 14, 30)
        together = curve_through(knots, values, at)
        for k in range(4):
            assert together[:, k] == pytest.approx(curve_through(knots, values[:, k], at))
