"""Distances between groups equal plain formulas; whole rotors are what is resampled."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rotortrack.twocolour.resampling import (
    bootstrap,
    curves_of_counts,
    curves_of_values,
    effects,
    gaps,
    matched_p,
    permutation_p,
    sizes,
)


def halves(n):
    first = np.arange(2 * n) < n
    return first, [np.flatnonzero(first), np.flatnonzero(~first)]


def of_frames(rng, n, shift_nm=0.0):
    """Draw rotors whose frames are far more alike than the rotors are."""
    means = rng.normal(180.0, 60.0, 2 * n) + shift_nm * (np.arange(2 * n) < n)
    lengths = rng.integers(50, 600, 2 * n)
    values = np.clip(np.repeat(means, lengths) + rng.normal(0.0, 20.0, lengths.sum()), 0.0, 599.0)
    return values, lengths


def counted(values, lengths, edges):
    parts = np.split(values, np.cumsum(lengths)[:-1])
    return np.array([np.histogram(part, edges)[0] for part in parts])


def sizes_of(curves, first, second):
    gap = gaps(curves, first[None], second[None])
    return {name: float(size(gap)[0]) for name, size in sizes(curves).items()}


def test_distances_are_those_of_scipy_for_weighted_rotors():
    rng = np.random.default_rng(1)
    values, weight = rng.normal(0.0, 30.0, 40), rng.uniform(0.5, 2.0, 40)
    first, _ = halves(20)
    found = sizes_of(curves_of_values(values), weight * first, weight * ~first)
    both = (values[first], values[~first], weight[first], weight[~first])
    assert found["wasserstein"] == pytest.approx(stats.wasserstein_distance(*both))
    assert found["energy"] == pytest.approx(stats.energy_distance(*both) ** 2)
    alone = sizes_of(curves_of_values(values), first * 1.0, ~first * 1.0)
    assert alone["ks"] == pytest.approx(stats.ks_2samp(*both[:2]).statistic)


def test_frames_in_fine_bins_give_the_distances_of_the_frames_themselves():
    values, lengths = of_frames(np.random.default_rng(2), 10, 40.0)
    first, _ = halves(10)
    edges = np.arange(0.0, 601.0)
    curves = curves_of_counts(counted(values, lengths, edges), edges)
    by_frames = sizes_of(curves, lengths * first, lengths * ~first)
    of_first = np.repeat(first, lengths)
    frames = values[of_first], values[~of_first]
    assert by_frames["wasserstein"] == pytest.approx(stats.wasserstein_distance(*frames), abs=0.1)
    assert by_frames["energy"] == pytest.approx(stats.energy_distance(*frames) ** 2, rel=2e-3)
    even = sizes_of(curves, first * 1.0, ~first * 1.0)
    alike = 1.0 / np.repeat(lengths, lengths)
    truth = stats.wasserstein_distance(*frames, alike[of_first], alike[~of_first])
    assert even["wasserstein"] == pytest.approx(truth, abs=0.1)
    assert even["wasserstein"] != pytest.approx(by_frames["wasserstein"], rel=1e-3)


def test_a_distribution_that_is_shifted_differs_by_its_shift():
    values = np.random.default_rng(3).normal(0.0, 10.0, 30)
    first, members = halves(30)
    curves = curves_of_values(np.concatenate([values + 25.0, values]))
    drawn = bootstrap(60, members, 200, np.random.default_rng(4))
    found = effects(curves, first * 1.0, ~first * 1.0, drawn)
    assert found.difference.value == pytest.approx(25.0)
    assert found.wasserstein.value == pytest.approx(25.0)
    assert found.wasserstein.low < 25.0 < found.wasserstein.high


def test_equal_groups_are_0_apart_and_the_interval_begins_there():
    values = np.random.default_rng(5).normal(0.0, 10.0, 20)
    first, members = halves(20)
    drawn = bootstrap(40, members, 200, np.random.default_rng(6))
    found = effects(
        curves_of_values(np.concatenate([values, values])), first * 1.0, ~first * 1.0, drawn
    )
    for interval in (found.wasserstein, found.energy, found.ks):
        assert (interval.value, interval.low) == (pytest.approx(0.0, abs=1e-12), 0.0)
        assert interval.high > 0.0


def test_resamples_draw_as_many_rotors_of_each_group_as_it_has():
    first, members = halves(7)
    drawn = bootstrap(14, members, 50, np.random.default_rng(7))
    assert (drawn[:, first].sum(axis=1) == 7).all()
    assert (drawn[:, ~first].sum(axis=1) == 7).all()
    assert len(np.unique(drawn, axis=0)) == 50


@pytest.mark.parametrize(
    ("shift_nm", "sd_nm"), [(0.0, 60.0), (20.0, 60.0), (60.0, 60.0), (0.0, 90.0)]
)
def test_intervals_hold_the_distance_of_the_populations(shift_nm, sd_nm):
    rng = np.random.default_rng(8)
    first, members = halves(45)
    x = np.linspace(-800.0, 900.0, 20_001)
    gap = stats.norm.cdf(x, 0.0, 60.0) - stats.norm.cdf(x, shift_nm, sd_nm)
    truth = {"wasserstein": np.trapezoid(np.abs(gap), x), "energy": 2.0 * np.trapezoid(gap**2, x)}
    inside = dict.fromkeys(truth, 0)
    for _ in range(100):
        values = np.concatenate([rng.normal(0.0, 60.0, 45), rng.normal(shift_nm, sd_nm, 45)])
        found = effects(
            curves_of_values(values), first * 1.0, ~first * 1.0, bootstrap(90, members, 200, rng)
        )
        for name, true in truth.items():
            interval = getattr(found, name)
            inside[name] += interval.low <= true <= interval.high
    # 95 % less three standard deviations of 100 repeats.
    assert min(inside.values()) >= 89


def test_halves_of_one_population_differ_in_one_of_twenty_comparisons():
    rng = np.random.default_rng(9)
    first, _ = halves(20)
    edges = np.arange(0.0, 601.0, 10.0)
    repeats, below = 400, np.zeros(2)
    for _ in range(repeats):
        values, lengths = of_frames(rng, 20)
        curves = curves_of_counts(counted(values, lengths, edges), edges)
        for k, weight in enumerate((lengths * 1.0, np.ones(40))):
            below[k] += permutation_p(curves, weight, first, 99, rng) <= 0.05
    # Two and a half standard deviations about the 5 % that 100 labellings give exactly.
    assert np.abs(below / repeats - 0.05) == pytest.approx(0.0, abs=0.027)


def test_a_test_on_frames_finds_halves_of_one_population_different():
    rng = np.random.default_rng(10)
    first, _ = halves(45)
    for _ in range(20):
        values, lengths = of_frames(rng, 45)
        of_first = np.repeat(first, lengths)
        assert stats.ks_2samp(values[of_first], values[~of_first]).pvalue < 1e-3


def test_groups_apart_by_their_spread_are_told():
    rng = np.random.default_rng(11)
    first, _ = halves(30)
    values = rng.normal(0.0, 60.0, 60) + 60.0 * first
    assert permutation_p(curves_of_values(values), np.ones(60), first, 199, rng) < 0.02


def test_a_rotor_and_its_twins_are_told_only_where_they_differ():
    rng = np.random.default_rng(12)
    repeats, below = 300, 0
    for _ in range(repeats):
        # Rotors differ in their noise, which their twins share.
        noise = rng.uniform(5.0, 80.0, 20)
        values = rng.normal(0.0, 30.0, (11, 20)) + noise * rng.normal(size=(11, 20))
        curves = curves_of_values(values.ravel())
        below += matched_p(curves, np.ones(220), 20, 99, rng) <= 0.05
    assert below / repeats == pytest.approx(0.05, abs=0.032)
    values[0] += 80.0
    assert matched_p(curves_of_values(values.ravel()), np.ones(220), 20, 99, rng) == 0.01


def test_p_is_never_0_and_equal_labels_count():
    values = np.array([1.0, 2.0, 10.0, 11.0])
    first, _ = halves(2)
    rng = np.random.default_rng(13)
    # Of the 6 ways to name two of four, 2 are as far apart.
    p = permutation_p(curves_of_values(values), np.ones(4), first, 5999, rng)
    assert p == pytest.approx(1 / 3, abs=0.02)
