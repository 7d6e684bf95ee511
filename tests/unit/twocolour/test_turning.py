"""Speed and diffusion of a rotor from the steps of its ends alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.twocolour.turning import turning

INTERVAL = 0.002
PIVOT = np.array([5000.0, 4000.0])


def ends_of(angle, radii, noise, seed=0, breath=0.0):
    rng = np.random.default_rng([seed, 1])
    out = breath * rng.normal(size=angle.size)
    ends = []
    for radius, phase in zip(radii, (0.0, 1.8), strict=True):
        at = (radius + out) * np.exp(1j * (angle + phase))
        # On the displayed image y points down.
        place = PIVOT + np.column_stack([at.real, -at.imag])
        ends.append(place + noise * rng.normal(size=place.shape))
    return ends


def angles(omega, diffusion, frames, seed=0):
    steps = np.random.default_rng(seed).normal(
        omega * INTERVAL, math.sqrt(2 * diffusion * INTERVAL), frames
    )
    return np.cumsum(steps)


def told(angle, *, radii=(100.0, 60.0), noise=8.0, seed=0, breath=0.0, frame=None):
    frame = np.arange(angle.size) if frame is None else frame
    first, second = ends_of(angle, radii, noise, seed, breath)
    return turning(first[frame], second[frame], frame, pivot_nm=PIVOT, frame_interval_s=INTERVAL)


@pytest.mark.parametrize(("omega", "diffusion"), [(30.0, 2.0), (-60.0, 10.0), (0.0, 20.0)])
@pytest.mark.parametrize("breath", [0.0, 15.0])
def test_speed_and_diffusion_are_unbiased(omega, diffusion, breath):
    n = 3000
    found = np.array(
        [told(angles(omega, diffusion, n, k), seed=k, breath=breath) for k in range(30)]
    )
    error = math.sqrt(2 * diffusion / (n * INTERVAL))
    assert abs(found[:, 0].mean() - omega) < 4 * error / math.sqrt(30)
    assert found[:, 0].std() < 1.4 * error
    assert found[:, 1].mean() == pytest.approx(diffusion, rel=0.06)


def test_missing_frames_change_nothing_but_the_error():
    angle = angles(40.0, 3.0, 6000)
    frame = np.flatnonzero(np.random.default_rng(2).random(6000) > 0.3)
    assert told(angle, frame=frame) == pytest.approx(told(angle), rel=0.2)


def test_a_stuck_rotor_seems_neither_to_turn_nor_to_diffuse_beyond_its_noise():
    found = np.array([told(np.zeros(2000), seed=k) for k in range(60)])
    assert np.mean(found[:, 0] == 0.0) > 0.85
    assert np.mean(found[:, 1] == 0.0) > 0.85
    assert found[:, 1].max() < 1.0


def test_ends_that_meet_tell_by_the_radius_of_the_first():
    angle = angles(30.0, 2.0, 4000)
    rng = np.random.default_rng(4)
    first, _ = ends_of(angle, (100.0, 100.0), 8.0)
    second = first + 8.0 * rng.normal(size=first.shape)
    omega, _ = turning(first, second, np.arange(4000), pivot_nm=PIVOT, frame_interval_s=INTERVAL)
    assert omega == pytest.approx(30.0, abs=4 * math.sqrt(4.0 / 8.0))


def test_what_steps_cannot_tell_is_not_known():
    wide = told(angles(0.0, 3000.0, 2000))
    few = told(np.zeros(20))
    ends = np.full((100, 2), 5000.0)
    same = turning(ends, ends, np.arange(100), pivot_nm=ends[0], frame_interval_s=INTERVAL)
    assert np.isnan([*wide, *few, *same]).all()
