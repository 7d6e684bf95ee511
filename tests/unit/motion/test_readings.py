import numpy as np
import pytest
from scipy.signal import lfilter

from rotortrack.motion.readings import Circle, Timing, first_guess, noise_prior, readings

CIRCLE = Circle(x_nm=500.0, y_nm=-200.0, radius_nm=100.0)
FRAME_S = 0.002


def spin(rng, n, omega, diffusion, sd_nm, missing=0.0):
    theta = np.cumsum(rng.normal(omega * FRAME_S, np.sqrt(2 * diffusion * FRAME_S), n))
    x = 500.0 + 100.0 * np.cos(theta) + rng.normal(0.0, sd_nm, n)
    y = -200.0 - 100.0 * np.sin(theta) + rng.normal(0.0, sd_nm, n)
    frame = np.flatnonzero(rng.random(n) >= missing)
    return frame, x[frame], y[frame]


def read(frame, x, y, sd):
    return readings(frame, x, y, np.full(x.size, sd), np.full(x.size, sd), CIRCLE)


def test_a_direction_is_as_sharp_as_the_positions_likelihood():
    x, y = np.array([540.0]), np.array([-230.0])
    seen = read(np.array([3]), x, y, 20.0)
    assert seen.theta_rad[0] == pytest.approx(np.arctan2(30.0, 40.0))
    candidates = np.linspace(-3.0, 3.0, 7)
    on_circle = 500.0 + 100.0 * np.cos(candidates), -200.0 - 100.0 * np.sin(candidates)
    log_likelihood = -((x - on_circle[0]) ** 2 + (y - on_circle[1]) ** 2) / (2 * 20.0**2)
    told = seen.concentration * np.cos(seen.theta_rad - candidates)
    np.testing.assert_allclose(np.diff(told), np.diff(log_likelihood))


def test_rows_without_a_number_are_left_out_and_missing_sds_come_from_the_radius():
    rng = np.random.default_rng(0)
    frame, x, y = spin(rng, 4000, 10.0, 5.0, 15.0)
    x[7] = np.nan
    known = read(frame, x, y, 15.0)
    unknown = read(frame, x, y, np.nan)
    assert 7 not in known.frame
    assert len(known) == frame.size - 1
    ratio = unknown.concentration / known.concentration
    np.testing.assert_allclose(ratio, ratio[0])
    assert ratio[0] == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize(
    ("omega", "diffusion", "missing"), [(30.0, 2.0, 0.0), (-700.0, 20.0, 0.5), (5.0, 120.0, 0.8)]
)
def test_the_first_guess_is_near_however_fast_the_rotor_and_long_the_gaps(
    omega, diffusion, missing
):
    rng = np.random.default_rng(1)
    seen = read(*spin(rng, 8000, omega, diffusion, 20.0, missing), 20.0)
    guess = first_guess(seen, Timing(FRAME_S, 0.0))
    # A few standard deviations of the mean displacement, which no estimate can beat.
    assert abs(guess.omega_rad_s - omega) < 8.0 * np.sqrt(2 * diffusion / (8000 * FRAME_S))
    assert 0.6 < guess.diffusion_rad2_s / diffusion < 1.6


def test_no_adjacent_frames_no_guess():
    frame, x, y = spin(np.random.default_rng(2), 100, 1.0, 1.0, 5.0)
    seen = read(frame[::2], x[::2], y[::2], 5.0)
    assert np.isnan(first_guess(seen, Timing(FRAME_S, 0.0)).omega_rad_s)


@pytest.mark.parametrize("sd_nm", [5.0, 20.0, 50.0])
def test_the_radius_tells_the_noise(sd_nm):
    rng = np.random.default_rng(3)
    frame, x, y = spin(rng, 20000, 10.0, 5.0, sd_nm)
    prior = noise_prior(read(frame, x, y, 0.8 * sd_nm), Timing(FRAME_S, 0.0), 5.0, 100.0)
    assert prior.log_factor == pytest.approx(np.log(1.25**2), abs=0.1)


@pytest.mark.parametrize("time", [25.0, 200.0])
def test_a_rod_that_breathes_over_many_frames_tells_its_noise_all_the_same(time):
    rng = np.random.default_rng(4)
    frame, x, y = spin(rng, 20000, 10.0, 5.0, 8.0)
    kept = np.exp(-1.0 / time)
    breath = lfilter([15.0 * np.sqrt(1.0 - kept**2)], [1.0, -kept], rng.normal(size=frame.size))
    out = 1.0 + breath / np.hypot(x - 500.0, y + 200.0)
    x, y = 500.0 + out * (x - 500.0), -200.0 + out * (y + 200.0)
    prior = noise_prior(read(frame, x, y, 8.0), Timing(FRAME_S, 0.0), 5.0, 100.0)
    # A step takes its share of the breath along: that of 25 frames 15^2 (1 - kept) / 8^2 = 0.14.
    assert prior.log_factor == pytest.approx(np.log1p((15.0 / 8.0) ** 2 * (1.0 - kept)), abs=0.05)
    assert prior.log_factor < 0.15


@pytest.mark.parametrize("exposed", [0.0, 0.3, 1.0])
def test_intervals_about_the_exposure_keep_the_variance_and_covariance_of_steps(exposed):
    diffusion = 3.0
    timing = Timing(FRAME_S, exposed * FRAME_S)
    blur = exposed / 6.0
    step = timing.step_variance(diffusion)
    deviation = timing.deviation_variance(diffusion)
    # Two averages midway between the ends of adjacent intervals, each with its own deviation.
    assert step / 2 + 2 * deviation == pytest.approx(2 * diffusion * FRAME_S * (1 - 2 * blur))
    assert step / 4 - deviation == pytest.approx(2 * blur * diffusion * FRAME_S)
