import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.motion.diffusion import Diffusion
from rotortrack.motion.timed_steps import fit_speeds, noise_of, steady, switching, timed_steps
from rotortrack.motion.windowed_speed import windowed_speed

FRAME_S = 0.002
TIMES = {"frame_interval_s": FRAME_S, "exposure_s": FRAME_S}
WHOLE = np.array([-np.inf, np.inf])


def known(diffusion, sigma):
    return Diffusion(diffusion, 0.1 * diffusion, sigma**2, np.zeros((2, 2)))


def dense_covariance(steps, diffusion, sigma, exposure_s=FRAME_S):
    """Variance and shared ends of every pair of steps, written out."""
    n = len(steps)
    matrix = np.zeros((n, n))
    for i in range(n):
        lasted = steps.stop_s[i] - steps.start_s[i]
        matrix[i, i] = 2 * diffusion * (lasted - exposure_s / 3) + 2 * sigma**2
        if i and np.isclose(steps.stop_s[i - 1], steps.start_s[i]):
            matrix[i, i - 1] = matrix[i - 1, i] = diffusion * exposure_s / 3 - sigma**2
    return matrix


def plain_speeds(steps, matrix, edges):
    """Weighted least squares with the inverse of the whole matrix."""
    design = np.array(
        [
            [max(0.0, min(b, high) - max(a, low)) for low, high in itertools.pairwise(edges)]
            for a, b in zip(steps.start_s, steps.stop_s, strict=True)
        ]
    )
    weight = np.linalg.inv(matrix)
    covariance = np.linalg.inv(design.T @ weight @ design)
    return covariance @ design.T @ weight @ steps.step_rad, covariance


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 50), sigma=st.floats(0.02, 0.4), diffusion=st.floats(0.5, 60.0))
def test_speeds_are_those_of_the_written_out_covariance(seed, sigma, diffusion):
    rng = np.random.default_rng(seed)
    frame = np.flatnonzero(rng.random(80) < 0.7)
    steps = timed_steps(
        frame, rng.uniform(-3, 3, frame.size), known(diffusion, sigma), steady(0.0), **TIMES
    )
    edges = np.array([-1.0, 0.0513, 0.11, 1.0])
    found = fit_speeds(steps, edges)
    omega, covariance = plain_speeds(steps, dense_covariance(steps, diffusion, sigma), edges)
    np.testing.assert_allclose(found.omega_rad_s, omega, rtol=1e-6, atol=1e-6 * np.abs(omega).max())
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-6, atol=1e-9)


def test_a_part_of_the_steps_has_its_own_covariance():
    rng = np.random.default_rng(1)
    frame = np.arange(40)
    steps = timed_steps(frame, rng.normal(0, 0.1, 40), known(5.0, 0.2), steady(0.0), **TIMES)
    part = steps.part(7, 25)
    unit = np.eye(18)
    expected = dense_covariance(part, 5.0, 0.2)
    np.testing.assert_allclose(part.over_covariance(expected), unit, atol=1e-9)


def test_white_noise_through_the_factor_has_the_covariance_of_the_steps():
    steps = timed_steps(np.arange(30), np.zeros(30), known(5.0, 0.2), steady(0.0), **TIMES)
    unit = np.eye(29)
    weights = steps.unwhitened_weights(unit)
    # C^-1 s for s = U^T z is U^-1 z, whose covariance is C^-1.
    np.testing.assert_allclose(
        weights @ weights.T @ dense_covariance(steps, 5.0, 0.2), unit, atol=1e-8
    )


def test_steps_across_gaps_are_those_nearest_to_the_expected_turn():
    omega = 150.0
    frame = np.array([0, 1, 2, 14, 15])
    theta = np.angle(np.exp(1j * omega * frame * FRAME_S))
    steps = timed_steps(frame, theta, known(2.0, 0.05), steady(omega), **TIMES)
    np.testing.assert_allclose(steps.step_rad, omega * np.diff(frame) * FRAME_S, atol=1e-12)


def test_a_gap_in_which_turns_cannot_be_counted_is_left_out():
    frame = np.array([0, 1, 2, 60, 61, 62])
    steps = timed_steps(frame, np.zeros(6), known(20.0, 0.1), steady(0.0), **TIMES)
    assert steps.start_s.tolist() == pytest.approx([0.0, 0.002, 0.12, 0.122])
    expected = dense_covariance(steps, 20.0, 0.1)
    np.testing.assert_allclose(steps.over_covariance(expected), np.eye(4), atol=1e-9)


def test_a_segment_without_steps_has_no_speed():
    steps = timed_steps(np.arange(50), np.zeros(50), known(5.0, 0.1), steady(0.0), **TIMES)
    found = fit_speeds(steps, np.array([-np.inf, 0.05, 5.0, 6.0]))
    assert np.isfinite(found.omega_rad_s).tolist() == [True, True, False]


def test_the_change_at_a_known_switch_has_the_sd_of_diffusion(turning):
    rng = np.random.default_rng(3)
    omega = np.where(np.arange(4000) * FRAME_S < 3.0, 5.0, 12.0)
    edges = np.array([-np.inf, 3.0, np.inf])
    pulls, sds = [], []
    for _ in range(60):
        frame, theta = turning(rng, 4000, diffusion=10.0, sigma=0.2, missing=0.2)
        theta = theta + np.cumsum(omega * FRAME_S)[frame]
        noise = noise_of(frame, theta, switching(edges, np.array([5.0, 12.0])), **TIMES)
        steps = timed_steps(frame, theta, noise, steady(8.0), **TIMES)
        change, sd = fit_speeds(steps, edges).changes()
        pulls.append((change[0] - 7.0) / sd[0])
        sds.append(sd[0])
    assert 0.75 < np.sqrt(np.mean(np.square(pulls))) < 1.28
    assert np.mean(sds) == pytest.approx(np.sqrt(2 * 10.0 * (1 / 3.0 + 1 / 5.0)), rel=0.05)


def test_a_change_of_speed_does_not_pass_for_diffusion(turning):
    rng = np.random.default_rng(4)
    omega = np.where(np.arange(8000) < 4000, 60.0, -60.0)
    frame, theta = turning(rng, 8000, diffusion=2.0, sigma=0.1)
    theta = np.angle(np.exp(1j * (theta + np.cumsum(omega * FRAME_S))))
    fooled = noise_of(frame, theta, steady(0.0), **TIMES)
    edges = np.array([-np.inf, 8.0, np.inf])
    found = noise_of(frame, theta, switching(edges, np.array([60.0, -60.0])), **TIMES)
    assert found.diffusion_rad2_s == pytest.approx(2.0, rel=0.15)
    assert fooled.diffusion_rad2_s > 3.0


def test_windowed_speeds_stay_within_the_band_of_diffusion(turning):
    rng = np.random.default_rng(5)
    frame, theta = turning(rng, 20_000, omega=8.0, diffusion=20.0, sigma=0.1, missing=0.1)
    noise = noise_of(frame, theta, steady(8.0), **TIMES)
    steps = timed_steps(frame, theta, noise, steady(8.0), **TIMES)
    found = windowed_speed(steps, window_s=0.5, windows_per_length=1)
    assert found.time_s.size == 79 or found.time_s.size == 80
    assert np.rad2deg(np.median(found.sd_rad_s)) == pytest.approx(512.0, rel=0.06)
    pulls = (found.omega_rad_s - 8.0) / found.sd_rad_s
    assert 0.8 < pulls.std() < 1.2


def test_a_track_shorter_than_a_window_has_none():
    steps = timed_steps(np.arange(50), np.zeros(50), known(5.0, 0.1), steady(0.0), **TIMES)
    assert windowed_speed(steps, window_s=0.5).time_s.size == 0
    assert fit_speeds(steps, WHOLE).omega_rad_s[0] == pytest.approx(0.0)
