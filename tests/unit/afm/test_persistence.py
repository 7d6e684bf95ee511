"""The estimate from turns against chains that are known without an image."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from rotortrack.afm.centre_line import smooth
from rotortrack.afm.persistence import (
    estimate_persistence,
    mean_square_distance,
    tangent_correlation,
    turn_covariance,
    turns_of,
)
from rotortrack.simulate.afm import worm_like_chain

SETTING = {"segment_nm": 36.0, "smooth_nm": 0.0, "resamples": 500, "seed": 0}


def chains(seed, count, persistence, length=450.0):
    rng = np.random.default_rng(seed)
    return [worm_like_chain(rng, length, persistence) for _ in range(count)]


def estimate(paths, noise=0.0, **changed):
    return estimate_persistence(paths, noise_nm=[noise] * len(paths), **{**SETTING, **changed})


def test_turns_of_an_unsmoothed_chain_have_two_thirds_and_a_sixth():
    assert turn_covariance(4, 0.0) == pytest.approx([2 / 3, 1 / 6, 0.0, 0.0], abs=1e-5)
    assert turn_covariance(2, 1e-3) == pytest.approx([2 / 3, 1 / 6], abs=1e-4)


def test_turns_of_a_smoothed_chain_follow_their_integral():
    # Spacing 0.5 nm, smoothed over 12 nm, cut into segments of 40 nm; ends, where smoothing
    # differs, apart.
    turns = np.stack([turns_of(smooth(c, 24.0)[200:-200], 40.0) for c in chains(0, 3000, 2000.0)])
    scale = 40.0 / 2000.0
    expected = scale * turn_covariance(3, 12.0 / 40.0)
    for lag, value in enumerate(expected):
        products = (turns[:, : turns.shape[1] - lag] * turns[:, lag:]).mean(axis=1)
        error = products.std() / np.sqrt(len(products))
        assert products.mean() == pytest.approx(value, abs=4.0 * error)


@pytest.mark.parametrize("persistence", [200.0, 1500.0, 20_000.0])
def test_the_estimate_is_unbiased_and_its_interval_covers(persistence):
    inside, bends = 0, []
    for seed in range(200):
        found = estimate(chains(seed, 8, persistence))
        inside += found.ci_low_nm <= persistence <= found.ci_high_nm
        bends.append(persistence / found.persistence_nm)
    # In stiff rods a turn is a small angle; at 200 nm some are not.
    slack = 0.02 if persistence < 500.0 else 0.0
    assert np.mean(bends) == pytest.approx(1.0, abs=3.0 * np.std(bends) / np.sqrt(200) + slack)
    assert inside >= 184


def rough(rng, path, sd):
    """A path with noise of this standard deviation, alike over 6 nm, in both directions."""
    noise = gaussian_filter1d(rng.normal(size=path.shape), 12.0, axis=0, mode="wrap")
    return path + sd * noise / noise.std()


def test_known_noise_is_taken_off():
    rng = np.random.default_rng(1)
    bends = []
    for seed in range(80):
        found = estimate([rough(rng, chain, 0.8) for chain in chains(seed, 10, 5000.0)], noise=0.8)
        bends.append(5000.0 / found.persistence_nm)
    assert 0.2 < found.noise_share < 0.6
    assert np.mean(bends) == pytest.approx(1.0, abs=3.0 * np.std(bends) / np.sqrt(80) + 0.02)


def test_rods_too_stiff_for_the_noise_give_a_lower_limit():
    rng = np.random.default_rng(2)
    straight = np.stack([np.linspace(0.0, 450.0, 13), np.zeros(13)], axis=1)
    paths = [straight + rng.normal(0.0, 0.5, straight.shape) for _ in range(10)]
    found = estimate(paths, noise=0.5, segment_nm=37.0)
    assert found.is_limit
    assert np.isinf(found.ci_high_nm)
    assert 1000.0 < found.ci_low_nm < 1e6


def test_one_rod_has_the_interval_of_the_model_and_none_has_no_estimate():
    found = estimate(chains(3, 1, 500.0, 2000.0))
    assert found.ci_low_nm < found.persistence_nm < found.ci_high_nm
    assert estimate([]) is None
    assert estimate(chains(0, 4, 500.0, 50.0)) is None


def test_all_three_estimates_agree_for_many_rods():
    found = estimate(chains(4, 2000, 800.0))
    assert found.persistence_nm == pytest.approx(800.0, rel=0.05)
    assert found.by_tangents_nm == pytest.approx(800.0, rel=0.1)
    assert found.by_end_to_end_nm == pytest.approx(800.0, rel=0.1)


def test_the_tangent_correlation_decays_as_in_the_plane():
    lag, mean, sd = tangent_correlation(chains(5, 2000, 400.0), 36.0)
    far = lag >= 36.0
    # Chords of 9 nm average the direction over their length.
    expected = np.exp(-(lag[far] - 3.0) / 800.0)
    assert (np.abs(mean[far] - expected) < 5.0 * sd[far]).all()


def test_the_mean_square_distance_has_its_limits():
    length = np.array([450.0])
    assert mean_square_distance(length, 1e7) == pytest.approx(length**2, rel=1e-4)
    assert mean_square_distance(length, 0.45) == pytest.approx(4.0 * 0.45 * 450.0, rel=0.01)
    near = [float(mean_square_distance(length, 225.0 / u)[0]) for u in (0.0099999, 0.0100001)]
    assert near[0] == pytest.approx(near[1], rel=1e-6)
