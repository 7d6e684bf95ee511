import numpy as np
import pytest
from scipy import stats

from rotortrack.motion.diffusion import UNKNOWN, Diffusion, estimate_diffusion
from rotortrack.motion.increments import increments
from rotortrack.motion.speed import Speed, estimate_speed

FRAME_S = 0.002


def measure(frame, theta, gap_mode="drop"):
    moves = increments(frame, theta, gap_mode)
    times = {"frame_interval_s": FRAME_S, "exposure_s": FRAME_S}
    return estimate_speed(moves, estimate_diffusion(moves, **times), **times)


def speed_given(frame, theta, gap_mode, diffusion, noise_variance):
    moves = increments(frame, theta, gap_mode)
    known = Diffusion(diffusion, 0.0, noise_variance, np.zeros((2, 2)))
    return estimate_speed(moves, known, frame_interval_s=FRAME_S, exposure_s=FRAME_S)


def test_without_gaps_it_is_displacement_over_time_with_the_sd_of_the_model():
    theta = np.cumsum(np.random.default_rng(1).normal(0.05, 0.3, 400))
    found = speed_given(np.arange(400), theta, "drop", 20.0, 0.01)
    lasted = 399 * FRAME_S
    assert found.omega_rad_s == pytest.approx((theta[-1] - theta[0]) / lasted)
    variance = 2 * 20.0 * (lasted - FRAME_S / 3) + 2 * 0.01
    assert found.omega_sd_rad_s == pytest.approx(np.sqrt(variance) / lasted)
    assert found.freedom == np.inf


def test_runs_are_weighted_by_the_variance_of_their_speed():
    frame = np.array([0, 1, 2, 3, 4, 10, 11])
    theta = np.array([0.0, 0.1, 0.2, 0.4, 0.5, 1.0, 1.4])
    found = speed_given(frame, theta, "drop", 5.0, 0.04)
    turned, lasted = np.array([0.5, 0.4]), np.array([4, 1]) * FRAME_S
    variance = 2 * 5.0 * (lasted - FRAME_S / 3) + 2 * 0.04
    information = lasted**2 / variance
    expected = np.average(turned / lasted, weights=information)
    assert found.omega_rad_s == pytest.approx(expected)
    assert found.omega_sd_rad_s == pytest.approx(1 / np.sqrt(information.sum()))


def test_bridging_counts_the_whole_track():
    frame = np.array([0, 1, 2, 10])
    found = speed_given(frame, np.array([0.0, 0.1, 0.2, 0.7]), "bridge", 5.0, 0.04)
    assert found.omega_rad_s == pytest.approx(0.7 / (10 * FRAME_S))


@pytest.mark.parametrize("gap_mode", ["drop", "bridge"])
@pytest.mark.parametrize(("diffusion", "sigma"), [(0.2, 0.2), (2.0, 0.2), (60.0, 0.1)])
def test_pulls_are_one_with_noise_blur_and_gaps(turning, gap_mode, diffusion, sigma):
    rng = np.random.default_rng(6)
    pulls = []
    for _ in range(120):
        track = turning(rng, 1500, omega=-25.0, diffusion=diffusion, sigma=sigma, missing=0.15)
        found = measure(*track, gap_mode)
        pulls.append((found.omega_rad_s + 25.0) / found.omega_sd_rad_s)
    # The rms of 120 normal numbers scatters by 6.5 %.
    assert 0.85 < np.sqrt(np.mean(np.square(pulls))) < 1.18
    assert abs(np.mean(pulls)) < 0.3


def test_a_rotor_that_switches_direction_gets_a_wide_interval():
    rng = np.random.default_rng(4)
    direction = np.repeat([1, -1, 1, 1, -1, 1, -1, -1], 500)
    theta = np.cumsum(direction * 0.04 + rng.normal(0.0, 0.1, 4000))
    found = measure(np.arange(4000), theta)
    assert found.excess > 5.0
    assert not found.differs_from_zero(3.5)


def test_a_short_track_has_few_degrees_of_freedom(turning):
    track = turning(np.random.default_rng(0), 8, omega=10.0, diffusion=5.0, sigma=0.1)
    found = measure(*track)
    assert found.freedom < 7.0
    low, high = found.interval()
    assert high - low > 2 * 2.3 * found.omega_sd_rad_s


def test_the_interval_is_students():
    found = Speed(10.0, 2.0, 5.0, 1.0)
    low, high = found.interval(0.9)
    assert (low, high) == pytest.approx(stats.t.interval(0.9, 5.0, 10.0, 2.0))
    assert found.differs_from_zero(2.0)
    # At five degrees of freedom 5 sd are as rare as 3.2 of a normal variable.
    assert not found.differs_from_zero(3.5)
    assert Speed(10.0, 2.0, np.inf, 1.0).differs_from_zero(3.5)


def test_a_noiseless_steady_turn_is_measured_exactly():
    theta = np.angle(np.exp(0.3j * np.arange(100)))
    found = measure(np.arange(100), theta)
    assert found.omega_rad_s == pytest.approx(150.0, rel=1e-12)
    assert found.omega_sd_rad_s < 1e-9
    assert found.differs_from_zero(3.5)


def test_a_motionless_noiseless_angle_has_speed_zero():
    found = measure(np.arange(100), np.ones(100))
    assert (found.omega_rad_s, found.omega_sd_rad_s) == (0.0, 0.0)
    assert not found.differs_from_zero(3.5)


def test_without_diffusion_there_is_a_speed_but_no_sd():
    moves = increments(np.array([0, 1, 5, 6]), np.array([0.0, 0.1, 0.5, 0.6]), "drop")
    found = estimate_speed(moves, UNKNOWN, frame_interval_s=FRAME_S, exposure_s=FRAME_S)
    assert found.omega_rad_s == pytest.approx(50.0)
    assert np.isnan(found.omega_sd_rad_s)
    assert not found.differs_from_zero(3.5)
