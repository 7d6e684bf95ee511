"""Correlations and slopes are right where both axes have errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from rotortrack.twocolour.correlation import (
    correlate,
    detectable_rho,
    errors_in_variables,
    spearman,
    weighted_spearman,
)

OPTIONS = {"axes": "log", "resamples": 300, "permutations": 199}


def rotors(rng, n=90, power=1.5, x_error=0.08, y_error=0.15):
    """Draw rotors whose speed goes with a power of their distance, and measure them."""
    log_x = rng.normal(math.log(180.0), 0.35, n)
    x, y = np.exp(log_x), np.exp(power * log_x - 2.0 + rng.normal(0.0, 0.3, n))
    x_sd, y_sd = x_error * rng.uniform(0.5, 1.5, n) * x, y_error * rng.uniform(0.5, 1.5, n) * y
    return x + rng.normal(0.0, x_sd), y + rng.normal(0.0, y_sd), x_sd, y_sd


def test_ranks_are_those_of_scipy_also_with_ties():
    rng = np.random.default_rng(1)
    x, y = rng.integers(0, 8, (3, 30)).astype(float), rng.normal(size=(3, 30))
    expected = [stats.spearmanr(a, b).statistic for a, b in zip(x, y, strict=True)]
    assert spearman(x, y) == pytest.approx(expected)
    assert np.isnan(spearman(np.ones((1, 5)), np.arange(5.0)[None]))[0]


def test_a_weight_of_2_is_a_point_twice():
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=20), rng.normal(size=20)
    weight = rng.integers(1, 4, 20)
    expected = stats.spearmanr(np.repeat(x, weight), np.repeat(y, weight)).statistic
    assert weighted_spearman(x, y, weight / weight.sum()) == pytest.approx(expected)


def test_90_rotors_tell_a_correlation_of_0_207():
    assert detectable_rho(90) == pytest.approx(0.207, abs=5e-4)
    rho = detectable_rho(20)
    t = rho * math.sqrt(18 / (1 - rho**2))
    assert 2 * stats.t.sf(t, 18) == pytest.approx(0.05)


def test_the_slope_is_freed_of_errors_that_flatten_a_plain_fit():
    rng = np.random.default_rng(3)
    found, plain, inside = [], [], 0
    for _ in range(60):
        x, y, x_sd, y_sd = rotors(rng, x_error=0.15)
        one = correlate(x, y, x_sd, y_sd, **OPTIONS, rng=rng)
        found.append(one.slope.value)
        inside += one.slope.low <= 1.5 <= one.slope.high
        plain.append(np.polyfit(np.log(x), np.log(np.abs(y)), 1)[0])
    assert np.mean(plain) < 1.35
    assert np.mean(found) == pytest.approx(1.5, abs=0.06)
    # 91 % less three standard deviations of 60 repeats.
    assert inside >= 48


def test_without_errors_the_slope_is_that_of_least_squares_on_a_line():
    x = np.linspace(1.0, 3.0, 12)[None]
    slope, reliability = errors_in_variables(x, 4.0 - 2.0 * x, 0.0 * x, 0.0 * x)
    assert slope == pytest.approx(-2.0)
    assert reliability == pytest.approx(1.0)


def test_distances_that_are_all_error_have_no_slope():
    rng = np.random.default_rng(4)
    x = rng.normal(0.0, 1.0, (1, 50))
    slope, reliability = errors_in_variables(x, rng.normal(size=(1, 50)), 0 * x + 1.0, 0 * x + 0.1)
    assert np.isnan(slope[0])
    assert reliability[0] < 0.1


def test_unrelated_rotors_are_told_related_in_one_of_twenty():
    rng = np.random.default_rng(5)
    options = {**OPTIONS, "resamples": 100, "permutations": 99}
    below = 0
    for _ in range(200):
        x, y, x_sd, y_sd = rotors(rng, n=20)
        below += correlate(x, rng.permutation(y), x_sd, y_sd, **options, rng=rng).p <= 0.05
    assert below / 200 == pytest.approx(0.05, abs=0.04)


def test_the_direction_of_turning_does_not_count():
    rng = np.random.default_rng(6)
    x, y, x_sd, y_sd = rotors(rng)
    signs = rng.choice([-1.0, 1.0], len(y))
    one, other = (
        correlate(x, s * y, x_sd, y_sd, **OPTIONS, rng=np.random.default_rng(7))
        for s in (1.0, signs)
    )
    assert one == other
    assert one.rho.low < one.rho.value < one.rho.high


def test_logarithmic_axes_count_what_is_resolved_and_rank_axes_have_no_slope():
    x = np.array([100.0, 150.0, 200.0, 250.0, 300.0, 10.0])
    y = np.array([10.0, 20.0, 25.0, 35.0, 50.0, 1.0])
    sd = np.array([5.0, 5.0, 5.0, 5.0, 5.0, 8.0])
    options = {**OPTIONS, "rng": np.random.default_rng(8)}
    found = correlate(x, y, sd, 0.1 * y, **options)
    assert (found.n, found.slope_n) == (6, 5)
    ranked = correlate(x, y, sd, 0.1 * y, **{**options, "axes": "rank"})
    assert ranked.rho.value == pytest.approx(1.0)
    assert math.isnan(ranked.slope.value)


def test_two_rotors_have_no_correlation():
    two = np.array([1.0, 2.0])
    found = correlate(two, two, two, two, **OPTIONS, rng=np.random.default_rng(9))
    assert found.n == 2
    assert math.isnan(found.rho.value)
    assert math.isnan(found.p)
