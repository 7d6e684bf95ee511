from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from rotortrack.motion.diffusion import estimate_diffusion
from rotortrack.motion.increments import increments
from rotortrack.motion.likelihood import freedom, profile_rise
from rotortrack.motion.linear import fit_increments, log_densities, speed_information
from rotortrack.motion.readings import NoisePrior, Pace, Readings, Timing

FRAME_S = 0.002
NO_PRIOR = NoisePrior(0.0, 1e3)


def track(rng, n, omega, diffusion, sigma, missing=0.0, exposed=1.0):
    """Angles whose exposure averages are exact by construction of their covariance."""
    timing = Timing(FRAME_S, exposed * FRAME_S)
    ends = np.cumsum(rng.normal(0.0, np.sqrt(timing.step_variance(diffusion)), n + 1))
    average = 0.5 * (ends[1:] + ends[:-1])
    average += rng.normal(0.0, np.sqrt(timing.deviation_variance(diffusion)), n)
    theta = average + omega * FRAME_S * np.arange(n) + rng.normal(0.0, sigma, n)
    frame = np.flatnonzero(rng.random(n) >= missing)
    wrapped = np.angle(np.exp(1j * theta[frame]))
    concentration = np.full(frame.size, sigma**-2)
    return Readings(frame, wrapped, np.ones(frame.size), concentration), timing


def covariance_of_averages(frame, timing, diffusion):
    """Covariance of exposure averages of a walk that starts at zero, from integrals over time."""
    dt, exposure = timing.frame_interval_s, timing.exposure_s
    start = (frame + 1) * dt
    earlier = np.minimum(start[:, None], start[None, :])
    covariance = 2 * diffusion * (earlier + exposure / 2)
    np.fill_diagonal(covariance, 2 * diffusion * (start + exposure / 3))
    return covariance


@given(
    seed=st.integers(0, 1000),
    exposed=st.floats(0.0, 1.0),
    missing=st.floats(0.0, 0.7),
    omega=st.floats(-20.0, 20.0),
)
@settings(max_examples=30, deadline=None)
def test_the_likelihood_is_that_of_a_multivariate_normal(seed, exposed, missing, omega):
    rng = np.random.default_rng(seed)
    seen, timing = track(rng, 40, omega, 2.0, 0.1, missing, exposed)
    if len(seen) < 3:
        return
    seen = replace(seen, concentration=rng.uniform(20.0, 200.0, len(seen)))
    pace = Pace(omega, 3.0, 1.2)
    covariance = covariance_of_averages(seen.frame, timing, 3.0)
    covariance += np.diag(1.2 * seen.noise_rad2)
    difference = np.diff(np.eye(len(seen)), axis=0)
    drift = omega * FRAME_S * seen.frame
    steps = np.diff(seen.theta_rad - drift)
    steps -= 2 * np.pi * np.round(steps / (2 * np.pi))
    told = log_densities(seen, timing, pace).sum()
    exact = stats.multivariate_normal(cov=difference @ covariance @ difference.T).logpdf(steps)
    assert told == pytest.approx(exact, rel=1e-9)
    precision = np.linalg.inv(difference @ covariance @ difference.T)
    durations = FRAME_S * np.diff(seen.frame)
    information = durations @ precision @ durations
    assert speed_information(seen, timing, 3.0, 1.2) == pytest.approx(information, rel=1e-9)


def test_without_gaps_it_agrees_with_the_sine_transform():
    seen, timing = track(np.random.default_rng(1), 6000, 20.0, 5.0, 0.15)
    found = fit_increments(seen, timing, Pace(19.0, 3.0, 1.0), NO_PRIOR).fit
    moves = increments(seen.frame, seen.theta_rad, "drop")
    sine = estimate_diffusion(moves, frame_interval_s=FRAME_S, exposure_s=FRAME_S)
    # That one fits the mean step, this one integrates it out: 1e-3 of a standard deviation.
    close = 0.01 * sine.diffusion_sd_rad2_s
    assert found.diffusion_rad2_s == pytest.approx(sine.diffusion_rad2_s, abs=close)
    assert found.diffusion_sd_rad2_s == pytest.approx(sine.diffusion_sd_rad2_s, rel=0.03)
    noise = found.noise_factor * seen.noise_rad2[0]
    assert noise == pytest.approx(sine.noise_variance_rad2, rel=0.005)


def deviance(seen, timing, prior, point):
    pace = Pace(point[0], np.exp(point[1]), np.exp(point[2]))
    information = speed_information(seen, timing, pace.diffusion_rad2_s, pace.noise_factor)
    likelihood = log_densities(seen, timing, pace).sum()
    return -2 * likelihood + np.log(information) + prior.deviance(point[2])


@pytest.mark.parametrize("index", [0, 1])
def test_intervals_end_where_the_profile_says(index):
    prior = NoisePrior(0.1, 0.3)
    seen, timing = track(np.random.default_rng(2), 1500, 4.0, 2.0, 0.1, missing=0.3)
    found = fit_increments(seen, timing, Pace(4.0, 2.0, 1.0), prior).fit
    best = np.array([found.omega_rad_s, np.log(found.diffusion_rad2_s), np.log(found.noise_factor)])
    least = deviance(seen, timing, prior, best)
    for other in np.random.default_rng(3).normal(0.0, [0.3, 0.05, 0.05], (20, 3)):
        assert deviance(seen, timing, prior, best + other) > least - 1e-3
    degrees = freedom(found.diffusion_relative_sd)
    rise = profile_rise(degrees)
    ends = (found.omega_interval_rad_s, np.log(found.diffusion_interval_rad2_s))[index]
    rest = [i for i in range(3) if i != index]
    for end in ends:

        def at_end(others, end=end):
            point = np.empty(3)
            point[index], point[rest] = end, others
            return deviance(seen, timing, prior, point)

        profile = optimize.minimize(at_end, best[rest], method="Nelder-Mead").fun
        assert profile - least == pytest.approx(rise, abs=0.02)


def test_slower_clocks_slow_everything_alike():
    seen, timing = track(np.random.default_rng(4), 2000, 15.0, 3.0, 0.1, missing=0.2)
    once = fit_increments(seen, timing, Pace(15.0, 3.0, 1.0), NO_PRIOR).fit
    slow = Timing(10 * timing.frame_interval_s, 10 * timing.exposure_s)
    tenth = fit_increments(seen, slow, Pace(1.5, 0.3, 1.0), NO_PRIOR).fit
    assert tenth.omega_rad_s == pytest.approx(once.omega_rad_s / 10, rel=1e-6)
    assert tenth.diffusion_rad2_s == pytest.approx(once.diffusion_rad2_s / 10, rel=1e-6)
    assert tenth.drift_p == pytest.approx(once.drift_p, rel=1e-4)
    mirrored = replace(seen, theta_rad=-seen.theta_rad)
    back = fit_increments(mirrored, timing, Pace(-15.0, 3.0, 1.0), NO_PRIOR).fit
    assert back.omega_rad_s == pytest.approx(-once.omega_rad_s, rel=1e-9)


def test_a_poor_guess_still_unwraps():
    seen, timing = track(np.random.default_rng(5), 3000, 100.0, 5.0, 0.1, missing=0.6)
    good = fit_increments(seen, timing, Pace(100.0, 5.0, 1.0), NO_PRIOR)
    poor = fit_increments(seen, timing, Pace(80.0, 30.0, 4.0), NO_PRIOR)
    assert poor.fit.omega_rad_s == pytest.approx(good.fit.omega_rad_s, rel=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_a_rotor_at_rest_gets_an_upper_limit_of_d_alone(seed):
    seen, timing = track(np.random.default_rng(seed), 1000, 0.0, 0.0, 0.1, missing=0.2)
    found = fit_increments(seen, timing, Pace(0.0, 0.1, 1.0), NO_PRIOR).fit
    assert found.one_sided
    low, high = found.diffusion_interval_rad2_s
    assert low == 0.0
    assert 0.0 < high < 0.01
    assert found.omega_interval_rad_s[0] < 0.0 < found.omega_interval_rad_s[1]


def test_angles_without_any_noise_are_no_obstacle():
    frame = np.arange(200)
    theta = np.angle(np.exp(0.05j * frame))
    seen = Readings(frame, theta, np.ones(200), np.full(200, 1e8))
    found = fit_increments(seen, Timing(FRAME_S, FRAME_S), Pace(25.0, 0.1, 1.0), NO_PRIOR).fit
    assert found.omega_rad_s == pytest.approx(25.0)
