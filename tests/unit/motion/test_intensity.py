"""Stepwise rises of intensity, and what must not be taken for one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.motion.intensity import intensity_step


def brightness(rng, n, noise=0.15):
    """Photons of a rotor with 20 dyes, white noise and a slow wander of 5 %."""
    wander = 0.05 * np.sin(np.arange(n) / 900.0 + rng.uniform(0.0, 6.3))
    return 1000.0 * np.exp(noise * rng.normal(size=n) + wander)


def step_of(rng, photons, seen=0.8):
    frame = np.flatnonzero(rng.random(photons.size) < seen)
    return intensity_step(frame, photons[frame])


def test_steady_and_bleaching_rotors_never_trigger():
    rng = np.random.default_rng(1)
    dyes = np.maximum(20 - np.arange(8000) // 500, 4) / 20.0
    for _ in range(100):
        assert step_of(rng, brightness(rng, 8000))[0] < 1.2
        assert step_of(rng, brightness(rng, 8000) * dyes)[0] < 1.25


@pytest.mark.parametrize("n", [800, 8000])
def test_a_second_rotor_is_found_with_its_time(n):
    rng = np.random.default_rng(2)
    for _ in range(50):
        photons = brightness(rng, n)
        docked = int(n * rng.uniform(0.2, 0.8))
        photons[docked:] *= 2.0
        factor, frame = step_of(rng, photons)
        assert factor == pytest.approx(2.0, rel=0.15)
        assert abs(frame - docked) < 250


def test_a_second_rotor_that_is_seen_apart_counts_too():
    rng = np.random.default_rng(3)
    frame = np.r_[np.arange(2000), np.arange(1000, 2000)]
    assert intensity_step(frame, brightness(rng, 3000))[0] == pytest.approx(2.0, rel=0.1)


def test_a_fall_of_intensity_is_no_step():
    rng = np.random.default_rng(4)
    photons = brightness(rng, 4000)
    photons[2000:] /= 2.0
    assert step_of(rng, photons)[0] < 1.2


def test_single_bright_frames_do_not_count():
    rng = np.random.default_rng(5)
    photons = brightness(rng, 4000)
    photons[rng.integers(0, 4000, 20)] *= 30.0
    assert step_of(rng, photons)[0] < 1.2


def test_too_few_or_unusable_intensities_say_nothing():
    frame = np.arange(400)
    assert math.isnan(intensity_step(frame[:159], np.ones(159))[0])
    assert intensity_step(frame[:160], np.ones(160)) == (1.0, 40)
    assert math.isnan(intensity_step(frame, np.full(400, np.nan))[0])
    assert math.isnan(intensity_step(frame, np.zeros(400))[0])
