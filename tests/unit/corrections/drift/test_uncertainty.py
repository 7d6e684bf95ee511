import numpy as np
import pytest

from rotortrack.corrections.drift.uncertainty import frame_sd, jackknife_sd, unresolved_sd


def test_jackknife_of_means_is_the_standard_error():
    values = np.random.default_rng(0).normal(size=(20, 2))
    replicates = (values.sum(axis=0) - values) / 19
    found = jackknife_sd((replicates - replicates.mean(axis=0))[np.newaxis])
    standard_error = values.std(axis=0, ddof=1) / np.sqrt(20)
    assert found == pytest.approx([np.sqrt(np.mean(standard_error**2))], rel=1e-12)


def test_one_group_or_a_missing_replicate_tells_nothing():
    assert np.isnan(jackknife_sd(np.zeros((3, 1, 2)))).all()
    deviations = np.zeros((3, 4, 2))
    deviations[1, 2] = np.nan
    assert np.isnan(jackknife_sd(deviations)).tolist() == [False, True, False]
    assert np.isnan(frame_sd(np.arange(9), np.array([1.0, 4.0, 7.0]), deviations, 0.0)).all()


def test_rough_paths_between_bins_are_resolved_no_better_than_stated():
    # Random walk of unit steps, bins every 100 steps: 25 is the variance in the middle of a gap.
    rng = np.random.default_rng(1)
    knots = np.arange(0.0, 1001.0, 100.0)
    walks = np.cumsum(rng.normal(size=(1001, 2, 200)), axis=0)[::100]
    found = [unresolved_sd(knots, walks[:, :, k], np.zeros(11)) ** 2 for k in range(200)]
    assert np.mean(found) == pytest.approx(25.0, rel=0.4)


def test_noise_of_the_bins_is_not_counted_twice():
    rng = np.random.default_rng(2)
    knots = np.arange(40.0)
    found = [unresolved_sd(knots, rng.normal(size=(40, 2)), np.ones(40)) for _ in range(50)]
    # Not zero on average, because a variance below zero is cut off; 0.9 if noise were left in.
    assert np.mean(np.square(found)) < 0.25


def test_two_bins_cannot_tell_what_lies_between_them():
    assert np.isnan(unresolved_sd(np.array([0.0, 9.0]), np.zeros((2, 2)), np.zeros(2)))


def test_error_grows_beyond_the_outer_bins():
    rng = np.random.default_rng(3)
    knots = np.array([50.0, 150.0, 250.0, 350.0])
    deviations = rng.normal(size=(4, 8, 2))
    deviations -= deviations.mean(axis=1, keepdims=True)
    sd = frame_sd(np.arange(500), knots, deviations, 1.0)
    assert sd[499] > sd[400] > sd[350]
    at_knot = np.hypot(jackknife_sd(deviations)[2], 1.0)
    assert sd[250] == pytest.approx(at_knot, rel=1e-9)
