"""The radius factor against integrals over simulated exposures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.motion.blur import radius_factor


@pytest.mark.parametrize(("omega", "exposure"), [(100.0, 0.002), (700.0, 0.002), (-700.0, 0.001)])
def test_steady_rotation_shrinks_by_the_sinc(omega, exposure):
    half = omega * exposure / 2
    assert radius_factor(omega, 0.0, exposure) == pytest.approx(abs(math.sin(half) / half))


def test_the_published_example():
    # D 60, 1800 degrees/s, 2 ms: measured 0.9800.
    assert radius_factor(math.radians(1800), 60.0, 0.002) == pytest.approx(0.980, abs=5e-4)


@pytest.mark.parametrize(("omega", "diffusion"), [(0.0, 120.0), (300.0, 60.0)])
def test_diffusing_exposures_have_this_rms_radius(omega, diffusion):
    rng = np.random.default_rng(3)
    exposure, parts = 0.002, 200
    pace = exposure / parts
    steps = rng.normal(omega * pace, math.sqrt(2 * diffusion * pace), (20_000, parts))
    path = np.cumsum(steps, axis=1)
    rms = math.sqrt((abs(np.exp(1j * path).mean(axis=1)) ** 2).mean())
    assert radius_factor(omega, diffusion, exposure) == pytest.approx(rms, abs=1e-3)


def test_no_motion_and_unknown_motion_leave_the_radius():
    assert radius_factor(0.0, 0.0, 0.002) == 1.0
    assert radius_factor(math.nan, 1.0, 0.002) == 1.0


def test_the_series_meets_the_formula():
    for c in (0.0099, 0.0101):
        exact = math.sqrt(2 * (math.expm1(-c) + c)) / c
        assert radius_factor(0.0, c / 0.002, 0.002) == pytest.approx(exact, rel=1e-8)
