"""The angles of ideal rotors against the laws that they are drawn from."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.ideal import IdealRotor
from rotortrack.simulate.ideal_motion import exposure_angles, exposure_parts

PLACE = {"x_nm": 0.0, "y_nm": 0.0, "radius_nm": 100.0, "photons": 800.0}
DT = 0.002


def rotor(kind, **motion):
    return IdealRotor(kind=kind, **PLACE, **motion)


def angles(which, n_frames, *, exposure_s=DT, seed=0):
    return exposure_angles(
        which,
        n_frames=n_frames,
        frame_interval_s=DT,
        exposure_s=exposure_s,
        rng=np.random.default_rng(seed),
    )


@pytest.mark.parametrize("exposure_s", [DT, 0.4 * DT])
@pytest.mark.parametrize("diffusion", [1.0, 40.0])
def test_increments_have_the_variance_and_covariance_of_motion_blur(exposure_s, diffusion):
    n_frames = 200_000
    theta = angles(
        rotor("driven", omega_rad_s=5.0, diffusion_rad2_s=diffusion),
        n_frames,
        exposure_s=exposure_s,
    )
    assert (theta.shape[1] == 1) == (diffusion == 1.0)
    steps = np.diff(theta.mean(axis=1))
    blur = exposure_s / (6.0 * DT)
    variance = 2.0 * diffusion * DT * (1.0 - 2.0 * blur)
    covariance = 2.0 * diffusion * DT * blur
    assert steps.mean() == pytest.approx(5.0 * DT, abs=4.0 * np.sqrt(2 * diffusion * DT / n_frames))
    # Four standard deviations of a variance estimated from 2e5 correlated steps are 1.5 %.
    assert steps.var() == pytest.approx(variance, rel=0.015)
    assert np.cov(steps[:-1], steps[1:])[0, 1] == pytest.approx(covariance, abs=0.012 * variance)


def test_position_averaged_over_a_turning_exposure_follows_the_sinc_formula():
    omega = 0.7 * np.pi / DT
    theta = angles(rotor("driven", omega_rad_s=omega), 3)
    shrink = np.abs(np.exp(1j * theta).mean(axis=1))
    half = omega * DT / 2.0
    np.testing.assert_allclose(shrink, np.sin(half) / half, rtol=1e-3)


def test_position_averaged_over_a_diffusing_exposure_has_its_exact_second_moment():
    theta = angles(rotor("brownian", diffusion_rad2_s=150.0), 40_000)
    rms = np.sqrt(np.mean(np.abs(np.exp(1j * theta).mean(axis=1)) ** 2))
    a = 150.0 * DT
    # 1e-3 is what the parts promise, 7e-4 three standard deviations of this sample.
    assert rms == pytest.approx(np.sqrt(2.0 * (a - 1.0 + np.exp(-a)) / a**2), rel=1.7e-3)


@pytest.mark.parametrize(
    ("which", "parts"),
    [
        (rotor("stuck"), 1),
        (rotor("driven", omega_rad_s=-14.9), 1),
        (rotor("driven", omega_rad_s=-15.1), 2),
        (rotor("brownian", diffusion_rad2_s=2.4), 1),
        (rotor("brownian", diffusion_rad2_s=2.6), 2),
        (rotor("two_position", event_rate_per_s=1.0), 8),
    ],
)
def test_parts_of_an_exposure_are_as_many_as_the_motion_demands(which, parts):
    # One part may turn by 0.03 rad or spread by 0.1: 15 rad/s, or D = 2.5 rad^2/s, in 2 ms.
    assert exposure_parts(which, DT) == parts


def test_rotor_too_fast_to_follow_is_refused():
    with pytest.raises(ConfigurationError, match="lower omega_rad_s"):
        exposure_parts(rotor("driven", omega_rad_s=2.0 * np.pi * 1e6), DT)


@pytest.mark.parametrize("which", [rotor("stuck"), rotor("driven", omega_rad_s=4.0)])
def test_motion_without_chance_draws_no_random_number(which):
    rng = np.random.default_rng(5)
    before = rng.bit_generator.state
    exposure_angles(which, n_frames=50, frame_interval_s=DT, exposure_s=DT, rng=rng)
    assert rng.bit_generator.state == before


def test_stuck_rotor_has_one_angle_for_the_whole_movie():
    np.testing.assert_array_equal(angles(rotor("stuck", start_rad=1), 5000), [[1.0]])


def test_switching_rotor_turns_back_at_the_given_times():
    which = rotor("switching", omega_rad_s=10.0, start_rad=0.5, event_times_s=(0.2, 0.1, -1.0))
    theta = angles(which, 200)[:, 0]
    middle = (np.arange(200) + 0.5) * DT
    # One event before the start: first clockwise, then back from 0.1 s to 0.2 s, then on.
    expected = 0.5 - 10.0 * np.interp(middle, [0.0, 0.1, 0.2, 0.4], [0.0, 0.1, 0.0, 0.2])
    np.testing.assert_allclose(theta, expected, atol=1e-12)


def test_random_switching_happens_at_the_asked_rate():
    theta = angles(rotor("switching", omega_rad_s=10.0, event_rate_per_s=5.0), 100_000)[:, 0]
    # The step within which it turns back lies between the two speeds; 200 s at 5 per second.
    flips = np.count_nonzero(np.diff(np.sign(np.diff(theta))))
    assert flips == pytest.approx(1000, abs=5 * np.sqrt(1000))


def test_two_position_rotor_stands_in_two_opposite_poses():
    theta = angles(rotor("two_position", event_rate_per_s=20.0, start_rad=0.3), 20_000)
    assert set(np.round(np.unique(theta) - 0.3, 12)) == {0.0, round(np.pi, 12)}
    # Telegraph of equal rates k: half the time in each pose, correlation exp(-2 k t).
    state = (theta[:, 0] > 1.0) * 2.0 - 1.0
    assert state.mean() == pytest.approx(0.0, abs=0.2)
    lag = 10
    assert np.mean(state[lag:] * state[:-lag]) == pytest.approx(
        np.exp(-2 * 20 * lag * DT), abs=0.06
    )


@pytest.mark.parametrize("exposure_s", [DT, 0.5 * DT])
def test_wobble_is_stationary_and_relaxes_as_an_ornstein_uhlenbeck_process(exposure_s):
    which = rotor("two_position", event_times_s=(1e9,), wobble_sd_rad=0.2, diffusion_rad2_s=4.0)
    theta = angles(which, 100_000, exposure_s=exposure_s)[:, 3]
    assert theta.std() == pytest.approx(0.2, rel=0.02)
    relaxation_s = 0.2**2 / 4.0
    for lag in (1, 5):
        correlation = np.mean(theta[lag:] * theta[:-lag]) / theta.var()
        assert correlation == pytest.approx(np.exp(-lag * DT / relaxation_s), abs=0.02)
