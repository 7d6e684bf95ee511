"""Turning rigid rotors tell what the registration misses; what they do not share stays theirs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.twocolour.self_calibration import full_turns, local_shift, smooth_shift

FIELD_NM = 30_000.0


def vectors(rng, distance, shift, n=5000, noise=30.0, turns=100.0, breathing=0.0, phase=0.0):
    theta = rng.uniform(0, 2 * math.pi) + np.linspace(0, 2 * math.pi * turns, n)
    length = distance + breathing * np.cos(theta - phase)
    dx = shift[0] + length * np.cos(theta) + rng.normal(0, noise, n)
    dy = shift[1] - length * np.sin(theta) + rng.normal(0, noise, n)
    return dx, dy, np.full(n, noise)


def smooth_error(places):
    """An error of 30 nm rms that varies over the field as optics do."""
    x, y = (places / FIELD_NM - 0.5).T
    error = np.column_stack([25.0 + 60.0 * x * y - 40.0 * x**2, -20.0 + 70.0 * y - 30.0 * x * y])
    return error * 30.0 / 27.9


def test_the_centre_is_the_registrations_error():
    pulls = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        found = local_shift(*vectors(rng, 50.0, (18.0, -24.0), noise=20.0))
        assert found.rigid, found.reason
        assert found.radius_nm == pytest.approx(50.0, abs=2.0)
        pulls += [(found.x_nm - 18.0) / found.sd_nm, (found.y_nm + 24.0) / found.sd_nm]
    # Of 40 pulls the rms is 1 within 0.11.
    assert 0.75 < math.sqrt(np.mean(np.square(pulls))) < 1.3


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"distance": 150.0}, "longer than 100 nm"),
        ({"distance": 60.0, "turns": 10.0}, "fewer than 20 turns"),
        ({"distance": 3.0}, "traces no circle"),
    ],
)
def test_assumptions_that_fail_are_named(given, reason):
    rng = np.random.default_rng(7)
    found = local_shift(*vectors(rng, shift=(5.0, 5.0), noise=15.0, **given))
    assert not found.rigid
    assert reason in found.reason


def test_a_rod_that_breathes_is_not_rigid():
    rng = np.random.default_rng(8)
    dx, dy, noise = vectors(rng, 80.0, (0.0, 0.0), noise=10.0)
    length = np.hypot(dx, dy)
    stretch = 1.0 + rng.normal(0, 25.0, dx.size) / length
    found = local_shift(dx * stretch, dy * stretch, noise)
    assert not found.rigid
    assert "breathes" in found.reason


def test_turns_are_counted_either_way_and_noise_makes_none():
    there_and_back = np.concatenate([np.linspace(0, 20 * math.pi, 500)] * 2)
    there_and_back[500:] = there_and_back[499] - there_and_back[500:]
    assert full_turns(there_and_back) == pytest.approx(19, abs=1)
    rng = np.random.default_rng(9)
    assert full_turns(rng.normal(0, 0.5, 5000)) == 0
    assert full_turns(np.empty(0)) == 0


def shown(seed, error, n=40, breathing=0.0, noise=30.0):
    """Give places, shifts and their sd as n rotors of 5000 frames show them."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, FIELD_NM, (n, 2))
    found = [
        local_shift(
            *vectors(
                rng, rng.uniform(40, 90), shift, noise=noise,
                breathing=breathing, phase=rng.uniform(0, 2 * math.pi),
            )
        )
        for shift in error(places)
    ]  # fmt: skip
    shifts = np.array([(one.x_nm, one.y_nm) for one in found])
    return places, shifts, np.array([one.sd_nm for one in found])


def test_a_smooth_error_of_30_nm_is_corrected_to_less_than_one_and_a_half():
    left = []
    for seed in range(4):
        places, shifts, sd = shown(seed, smooth_error)
        assert math.sqrt(np.mean(smooth_error(places) ** 2)) > 25.0
        found = smooth_shift(places, shifts, sd)
        assert not isinstance(found, str), found
        missed = found.at(places) - smooth_error(places)
        left.append(math.sqrt(np.mean(missed**2)))
        assert found.between_nm < 1.5
    assert max(left) < 1.5


def test_breathing_in_phase_widens_the_interval_and_no_more():
    pulls = []
    for seed in range(6):
        places, shifts, sd = shown(20 + seed, smooth_error, breathing=20.0, noise=15.0)
        found = smooth_shift(places, shifts, sd)
        assert not isinstance(found, str)
        # A circle that breathes by 20 nm with its angle is one 20 nm aside: 14 nm a coordinate.
        assert 11.0 < found.between_nm < 18.0
        pulls.append((found.at(places) - smooth_error(places)) / found.sd_nm(places)[:, np.newaxis])
    assert math.sqrt(np.mean(np.square(pulls))) < 1.5


def test_rotors_that_share_nothing_correct_nothing():
    rng = np.random.default_rng(30)
    places = rng.uniform(0, FIELD_NM, (40, 2))
    found = smooth_shift(places, rng.normal(0, 8.0, (40, 2)), np.full(40, 0.7))
    assert found == "rotors show no error that they share"


def test_few_rotors_correct_a_constant_or_nothing():
    rng = np.random.default_rng(31)
    places = rng.uniform(0, FIELD_NM, (6, 2))
    shifts = np.array([20.0, -10.0]) + rng.normal(0, 1.0, (6, 2))
    found = smooth_shift(places, shifts, np.full(6, 1.0))
    assert not isinstance(found, str)
    assert found.name == "a constant"
    assert found.at(places)[0] == pytest.approx([20.0, -10.0], abs=1.5)
    assert found.sd_nm(places)[0] == pytest.approx(1.0 / math.sqrt(6), rel=0.5)
    assert "too few" in smooth_shift(places[:3], shifts[:3], np.ones(3))
