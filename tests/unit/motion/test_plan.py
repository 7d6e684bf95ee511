"""Plans, against the exact likelihood, limits that have formulas, and their own inverses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.linalg import toeplitz

from rotortrack.motion.blur import radius_factor
from rotortrack.motion.linear import whitened_sums
from rotortrack.motion.plan import (
    Setting,
    SpeedTest,
    diffusion_relative_sd,
    fastest_speed,
    frames_needed,
    longest_exposure,
    most_noise,
    photons_needed,
    smallest_speed,
    speed_sd,
    speed_test,
)
from rotortrack.motion.plan_movie import advice, plan_movie
from rotortrack.motion.readings import Timing

FRAME_S = 0.002
PLAIN = Setting(20.0, 100.0, 20.0, FRAME_S, FRAME_S, 4000)

settings = st.builds(
    Setting,
    diffusion_rad2_s=st.floats(0.05, 100.0),
    radius_nm=st.floats(40.0, 200.0),
    localisation_sd_nm=st.floats(0.5, 30.0),
    frame_interval_s=st.just(FRAME_S),
    exposure_s=st.floats(0.0, FRAME_S),
    frames=st.integers(100, 20_000),
    detection=st.floats(0.2, 1.0),
)


@pytest.mark.parametrize("exposure", [0.0, 0.001, FRAME_S])
@pytest.mark.parametrize(("diffusion", "sd"), [(60.0, 2.0), (20.0, 20.0), (0.2, 40.0), (0.0, 20.0)])
def test_the_error_of_speed_is_that_of_the_inverse_covariance(diffusion, sd, exposure):
    n = 150
    setting = Setting(diffusion, 100.0, sd, FRAME_S, exposure, n + 1)
    noise, blur = setting.noise_rad() ** 2, diffusion * exposure / 3
    first = [2 * diffusion * FRAME_S - 2 * blur + 2 * noise, blur - noise]
    matrix = toeplitz([*first, *[0.0] * (n - 2)])
    information = np.linalg.solve(matrix, np.ones(n)).sum() * FRAME_S**2
    assert speed_sd(setting) == pytest.approx(information**-0.5, rel=1e-9)


@pytest.mark.parametrize("detection", [1.0, 0.6, 0.25])
def test_missing_frames_cost_what_the_exact_likelihood_says(detection):
    rng = np.random.default_rng(1)
    timing = Timing(FRAME_S, FRAME_S)
    for diffusion, sd in ((60.0, 5.0), (2.0, 20.0), (0.2, 30.0)):
        setting = Setting(diffusion, 100.0, sd, FRAME_S, FRAME_S, 3000, detection)
        frame = np.flatnonzero(rng.random(3000) < detection)
        step = timing.step_variance(diffusion)
        extra = step / 4 + timing.deviation_variance(diffusion)
        sums = whitened_sums(
            np.zeros(frame.size), FRAME_S * (frame - frame[0]), np.diff(frame),
            np.full(frame.size, setting.noise_rad() ** 2), np.array([step]), np.array([extra]),
        )  # fmt: skip
        assert speed_sd(setting) == pytest.approx(sums[0, 3] ** -0.5, rel=0.01)


def test_in_long_movies_the_error_is_that_of_diffusion_alone():
    for diffusion in (0.5, 5.0, 70.0):
        setting = replace(PLAIN, diffusion_rad2_s=diffusion, frames=200_000)
        assert speed_sd(setting) == pytest.approx(math.sqrt(2 * diffusion / 400), rel=5e-3)


def test_without_diffusion_it_is_the_slope_of_a_noisy_line():
    setting = replace(PLAIN, diffusion_rad2_s=0.0, frames=500)
    time = FRAME_S * np.arange(500)
    assert speed_sd(setting) == pytest.approx(
        setting.noise_rad() / math.sqrt(((time - time.mean()) ** 2).sum()), rel=1e-9
    )


def test_the_error_of_diffusion_without_noise_is_that_of_a_variance():
    setting = replace(PLAIN, localisation_sd_nm=0.0, exposure_s=0.0, frames=2001)
    assert diffusion_relative_sd(setting) == pytest.approx(math.sqrt(2 / 2000), rel=1e-3)
    assert diffusion_relative_sd(PLAIN) > diffusion_relative_sd(setting)


@given(settings, st.sampled_from([1.96, 3.5]))
def test_the_smallest_speed_is_told_in_95_percent_of_rotors(setting, threshold):
    omega = smallest_speed(setting, threshold)
    if math.isnan(omega):
        return
    told = speed_test(setting, threshold).power(omega / speed_sd(setting, omega))
    assert told == pytest.approx(0.95, abs=2e-3)


@given(settings, st.floats(0.5, 60.0))
def test_the_frames_needed_suffice_and_fewer_do_not(setting, omega):
    frames = frames_needed(setting, omega, 3.5)
    enough = replace(setting, frames=frames)
    assert speed_test(enough, 3.5).power(omega / speed_sd(enough, omega)) >= 0.95 - 1e-6
    fewer = replace(setting, frames=0.98 * frames - 2)
    if fewer.frames * setting.detection > 3:
        assert speed_test(fewer, 3.5).power(omega / speed_sd(fewer, omega)) < 0.95


@given(settings)
def test_longer_movies_less_noise_and_slower_diffusion_never_harm(setting):
    sd = speed_sd(setting)
    assert speed_sd(replace(setting, frames=2 * setting.frames)) < sd
    sharper = replace(setting, localisation_sd_nm=0.5 * setting.localisation_sd_nm)
    assert speed_sd(sharper) <= sd * (1 + 1e-9)
    slower = replace(setting, diffusion_rad2_s=0.5 * setting.diffusion_rad2_s)
    assert speed_sd(slower) < sd


def test_the_noise_that_is_allowed_just_suffices():
    setting = replace(PLAIN, diffusion_rad2_s=0.02, frames=400)
    omega = 1.25
    noise = most_noise(setting, omega, 3.5)
    assert 0 < noise < 0.5 * setting.radius_nm * 0.99
    just = replace(setting, localisation_sd_nm=noise)
    told = speed_test(just, 3.5).power(omega / speed_sd(just, omega))
    assert told == pytest.approx(0.95, abs=1e-3)
    assert math.isnan(most_noise(replace(setting, diffusion_rad2_s=50.0), omega, 3.5))


def test_photons_follow_from_the_error():
    def precision(photons):
        return 130.0 / math.sqrt(photons)

    assert photons_needed(precision, 13.0) == pytest.approx(100, abs=1)
    assert photons_needed(precision, 1e-9) != photons_needed(precision, 1e-9)
    assert photons_needed(precision, 1e3) == 1.0


def test_the_longest_exposure_shrinks_the_circle_by_5_percent():
    slow = replace(PLAIN, frame_interval_s=0.02, exposure_s=0.02)
    exposure = longest_exposure(slow, 100.0)
    assert radius_factor(100.0, 20.0, exposure) == pytest.approx(0.95, abs=1e-6)
    assert longest_exposure(PLAIN, 0.0) == FRAME_S


def test_the_fastest_speed_folds_one_step_in_forty():
    omega = fastest_speed(PLAIN)
    rng = np.random.default_rng(2)
    steps = rng.normal(omega * FRAME_S, PLAIN.step_sd_rad(omega), 200_000)
    assert np.mean(np.abs(steps) > np.pi) == pytest.approx(0.025, abs=0.002)
    assert fastest_speed(replace(PLAIN, diffusion_rad2_s=1000.0)) == 0.0


def told(setting, speed_deg_s, precision=None):
    omega = None if speed_deg_s is None else math.radians(speed_deg_s)
    return advice(plan_movie(setting, omega_rad_s=omega, driven_z=3.5, precision=precision))


def test_the_advice_names_what_limits():
    brownian = replace(PLAIN, diffusion_rad2_s=60.0, frames=8000)
    assert "more photons do not help: record 20.2 s" in told(brownian, 720.0)
    assert told(brownian, 1800.0).startswith("The speed is resolved")
    assert "more than half a turn a frame" in told(brownian, 100_000.0)
    noisy = replace(PLAIN, diffusion_rad2_s=0.02, frames=400, localisation_sd_nm=40.0)
    sentence = told(noisy, 70.0, lambda n: 130.0 / math.sqrt(n))
    assert "Localisation noise hides the speed" in sentence
    assert "photons a frame" in sentence
    assert "four times as long" in told(brownian, None)
    assert "film faster" in told(replace(PLAIN, diffusion_rad2_s=1000.0), None)
    assert "more photons a frame first" in told(replace(PLAIN, localisation_sd_nm=60.0), None)


def test_a_movie_of_few_frames_tells_nothing_and_does_no_harm():
    short = replace(PLAIN, frames=3, detection=0.3)
    assert speed_sd(short) == math.inf
    assert math.isnan(smallest_speed(short, 3.5))
    assert plan_movie(short, omega_rad_s=10.0, driven_z=3.5).power_z == pytest.approx(0, abs=1e-3)


def test_the_power_is_that_of_the_noncentral_t():
    for degrees, threshold in ((8.0, 3.0), (50.0, 2.0)):
        for distance in (1.0, threshold, threshold + 2.0):
            both = stats.nct.sf(threshold, degrees, distance)
            both += stats.nct.cdf(-threshold, degrees, distance)
            told = SpeedTest(threshold, degrees).power(distance)
            assert told == pytest.approx(both, abs=0.02)


def test_an_uncertain_diffusion_asks_for_more():
    sure = replace(PLAIN, frames=20_000)
    unsure = replace(PLAIN, diffusion_rad2_s=0.3, frames=200)
    assert speed_test(sure, 1.96).threshold == pytest.approx(1.96, rel=0.01)
    assert speed_test(unsure, 1.96).threshold > 2.1
    for setting in (sure, unsure):
        assert smallest_speed(setting, 1.96) < smallest_speed(setting, 3.5)
