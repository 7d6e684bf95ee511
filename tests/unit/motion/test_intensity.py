"""Stepwise rises and falls of intensity, and what must not be taken for one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.motion.intensity import intensity_steps
from rotortrack.motion.screen_options import ScreenOptions

LIMITS = ScreenOptions()
DYES = 20


def brightness(rng, n, *, noise=0.15, lifetime=math.inf):
    """Photons of a rotor whose dyes bleach one by one, with white noise and a slow wander."""
    period = max(1500.0, n * rng.uniform(0.3, 2.0))
    wander = 0.1 * np.sin(2.0 * np.pi * (np.arange(n) / period + rng.random()))
    dies = np.sort(rng.exponential(1.0, DYES)) * lifetime
    dyes = DYES - np.searchsorted(dies, np.arange(n))
    return 1000.0 * dyes / DYES * np.exp(noise * rng.normal(size=n) + wander)


def steps_of(rng, photons, seen=0.8):
    frame = np.flatnonzero((rng.random(photons.size) < seen) & (photons > 0.0))
    return intensity_steps(frame, photons[frame])


def triggers(steps):
    return steps.rise > LIMITS.max_intensity_step or steps.fall > LIMITS.max_intensity_fall


@pytest.mark.parametrize(("n", "seen"), [(2000, 0.5), (4000, 0.2), (8000, 0.9)])
def test_false_alarms_of_noise_wander_and_bleaching_are_below_half_a_percent(n, seen):
    rng = np.random.default_rng(1)
    lifetimes = (math.inf, 5.0 * n, 2.0 * n)
    alarms = [
        triggers(steps_of(rng, brightness(rng, n, lifetime=lifetimes[trial % 3]), seen))
        for trial in range(400)
    ]
    assert np.mean(alarms) <= 0.005


def test_dyes_that_bleach_within_the_movie_seldom_trigger():
    rng = np.random.default_rng(2)
    found = [steps_of(rng, brightness(rng, 8000, lifetime=8000.0)) for _ in range(200)]
    assert max(steps.rise for steps in found) < LIMITS.max_intensity_step
    assert np.mean([triggers(steps) for steps in found]) <= 0.01


@pytest.mark.parametrize(("n", "seen"), [(2000, 0.5), (4000, 0.2), (8000, 0.9)])
@pytest.mark.parametrize("arrives", [True, False])
def test_a_second_rotor_that_comes_or_goes_is_found(n, seen, arrives):
    rng = np.random.default_rng(3)
    missed = 0
    for trial in range(200):
        lifetime = (math.inf, 3.0 * n)[trial % 2]
        photons = brightness(rng, n, lifetime=lifetime)
        moment = int(n * rng.uniform(0.15, 0.85))
        with_two = slice(moment, None) if arrives else slice(None, moment)
        photons[with_two] *= 2.0
        steps = steps_of(rng, photons, seen)
        missed += not triggers(steps)
        frame = steps.rise_frame if arrives else steps.fall_frame
        assert not triggers(steps) or abs(frame - moment) < 80 / seen
    assert missed <= 2


def test_the_factor_is_that_of_the_step():
    rng = np.random.default_rng(4)
    photons = brightness(rng, 8000)
    photons[3000:5000] *= 2.0
    steps = steps_of(rng, photons)
    assert steps.rise == pytest.approx(2.0, rel=0.15)
    assert steps.fall == pytest.approx(2.0, rel=0.15)
    assert abs(steps.rise_frame - 3000) < 100
    assert abs(steps.fall_frame - 5000) < 100


@pytest.mark.parametrize("rate", [-1.0 / 400.0, 1.0 / 400.0])
def test_a_steady_slope_is_no_step(rate):
    frame = np.arange(4000)
    noise = np.random.default_rng(5).normal(0.0, 0.15, frame.size)
    assert not triggers(intensity_steps(frame, np.exp(10.0 + rate * frame + noise)))


def test_the_last_dyes_may_bleach():
    rng = np.random.default_rng(6)
    dyes = np.repeat([20, 15, 10, 6, 4, 3, 2, 1], 1000)
    steps = steps_of(rng, brightness(rng, dyes.size) * dyes / DYES)
    assert not triggers(steps)


def test_a_second_rotor_that_is_seen_apart_counts_too():
    rng = np.random.default_rng(7)
    frame = np.r_[np.arange(2000), np.arange(1000, 2000)]
    photons = 1000.0 * np.exp(0.15 * rng.normal(size=frame.size))
    assert intensity_steps(frame, photons).rise == pytest.approx(2.0, rel=0.1)


def test_single_bright_frames_do_not_count():
    rng = np.random.default_rng(8)
    photons = brightness(rng, 4000)
    photons[rng.integers(0, 4000, 20)] *= 30.0
    assert not triggers(steps_of(rng, photons))


def test_the_order_of_rows_and_the_unit_of_intensity_do_not_matter():
    rng = np.random.default_rng(9)
    frame, photons = np.arange(3000), brightness(rng, 3000)
    order = rng.permutation(3000)
    plain = intensity_steps(frame, photons)
    again = intensity_steps(frame[order], 7.0 * photons[order])
    assert (again.rise, again.fall) == pytest.approx((plain.rise, plain.fall), rel=1e-9)
    assert (again.rise_frame, again.fall_frame) == (plain.rise_frame, plain.fall_frame)


def test_too_few_or_unusable_intensities_say_nothing():
    frame = np.arange(400)
    for few in (np.ones(39), np.full(400, np.nan), np.zeros(400)):
        steps = intensity_steps(frame[: few.size], few)
        assert math.isnan(steps.rise)
        assert math.isnan(steps.fall)
    steps = intensity_steps(frame[:40], np.ones(40))
    assert (steps.rise, steps.rise_frame, steps.fall, steps.fall_frame) == (1.0, -1, 1.0, -1)
