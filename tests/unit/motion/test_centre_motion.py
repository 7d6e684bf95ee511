"""Centres that move by themselves, centres that move together, and those that stay."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from rotortrack.motion.centre_motion import PARTS, centre_motion, common_motion
from rotortrack.rotors.circle import fit_circle

FRAMES = 4000
TIME = np.arange(FRAMES) / FRAMES


def wave(rng, rms_nm):
    curve = np.sin(2.0 * np.pi * (TIME * rng.uniform(0.5, 2.0) + rng.random()))
    return rms_nm * (curve - curve.mean()) / curve.std()


def breath(rng, sd_nm, time):
    """Ornstein-Uhlenbeck process with a correlation time in frames."""
    kept = math.exp(-1.0 / time)
    pushes = sd_nm * math.sqrt(1.0 - kept**2) * rng.normal(size=FRAMES)
    return lfilter([1.0], [1.0, -kept], pushes, zi=[kept * sd_nm * rng.normal()])[0]


def moving(
    rng, shift_x=0.0, shift_y=0.0, *, diffusion=None, axis_ratio=1.0, omega=0.0, breathing=None
):
    """CentreMotion and radius of a rotor as it is found."""
    diffusion = diffusion or 10.0 ** rng.uniform(0.0, 1.7)
    radius, noise = rng.uniform(60.0, 180.0), rng.uniform(8.0, 20.0)
    theta = np.cumsum(rng.normal(0.002 * omega, math.sqrt(0.004 * diffusion), FRAMES))
    out = radius + (breath(rng, *breathing) if breathing else 0.0)
    x = out * np.cos(theta) + shift_x + noise * rng.normal(size=FRAMES)
    y = axis_ratio * out * np.sin(theta) + shift_y + noise * rng.normal(size=FRAMES)
    frame = np.flatnonzero(rng.random(FRAMES) < rng.uniform(0.3, 0.95))
    fit = fit_circle(x[frame], y[frame], outlier_sd=4.0)
    circle = (fit.x_nm, fit.y_nm, fit.radius_nm)
    return centre_motion(frame, x[frame], y[frame], circle, (0, FRAMES)), radius


@pytest.mark.parametrize("axis_ratio", [1.0, 0.8])
def test_centres_at_rest_are_not_taken_for_moving_ones(axis_ratio):
    rng = np.random.default_rng(1)
    found = [moving(rng, axis_ratio=axis_ratio) for _ in range(100)]
    assert max(motion.wander_nm / radius for motion, radius in found) < 0.15
    if axis_ratio == 1.0:
        assert np.mean([motion.wander_nm > 0.0 for motion, _ in found]) < 0.08


@pytest.mark.parametrize("time", [5.0, 25.0, 100.0])
def test_a_rod_that_breathes_is_not_taken_for_a_moving_centre(time):
    rng = np.random.default_rng(7)
    found = [
        moving(rng, omega=rng.uniform(-60.0, 60.0), breathing=(15.0, time))[0] for _ in range(60)
    ]
    assert np.mean([motion.wander_nm > 0.0 for motion in found]) < 0.08
    pull = np.concatenate([motion.shift_nm / motion.sd_nm for motion in found])
    assert 0.8 < np.nanstd(pull) < 1.2


def test_a_centre_that_moves_is_measured():
    rng = np.random.default_rng(2)
    for _ in range(20):
        motion, _ = moving(rng, wave(rng, 25.0), wave(rng, 25.0), diffusion=20.0)
        assert motion.wander_nm == pytest.approx(25.0, rel=0.25)


def test_shifts_are_those_of_the_parts_with_honest_errors():
    rng = np.random.default_rng(3)
    pulls = []
    for _ in range(40):
        dx, dy = wave(rng, 5.0), wave(rng, 5.0)
        motion, _ = moving(rng, dx, dy, diffusion=30.0)
        true = np.column_stack([v.reshape(PARTS, -1).mean(axis=1) for v in (dx, dy)])
        pulls.append((motion.shift_nm - true) / motion.sd_nm)
    pull = np.concatenate(pulls)
    assert 0.9 < np.nanstd(pull) < 1.15
    assert abs(np.nanmean(pull)) < 0.1


@pytest.mark.parametrize("rms_nm", [5.0, 20.0])
def test_what_centres_do_together_is_told_from_what_each_does(rms_nm):
    rng = np.random.default_rng(4)
    for _ in range(5):
        dx, dy = wave(rng, rms_nm), wave(rng, rms_nm)
        together = [moving(rng, dx + wave(rng, 5.0), dy)[0] for _ in range(20)]
        common, significance = common_motion(together)
        assert common == pytest.approx(rms_nm, rel=0.25)
        assert significance > 6.0
        apart = [moving(rng, wave(rng, rms_nm), wave(rng, rms_nm))[0] for _ in range(20)]
        assert common_motion(apart)[1] < 4.5


def test_few_rotors_and_short_arcs_tell_nothing():
    rng = np.random.default_rng(5)
    shift = wave(rng, 30.0)
    assert common_motion([moving(rng, shift, shift)[0] for _ in range(7)]) == (0.0, 0.0)
    frame = np.arange(FRAMES)
    theta = rng.uniform(-0.2, 0.2, FRAMES)
    arc = centre_motion(
        frame, 100.0 * np.cos(theta), 100.0 * np.sin(theta), (0.0, 0.0, 100.0), (0, FRAMES)
    )
    assert math.isnan(arc.wander_nm)
    none = centre_motion(frame[:0], theta[:0], theta[:0], (0.0, 0.0, 100.0), (0, FRAMES))
    assert math.isnan(none.wander_nm)
    assert common_motion([]) == (0.0, 0.0)
