"""What rounding adds up to in long runs: 1e7 steps of a rod, 1e6 frames of a rotor."""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from rotortrack.motion.estimate import estimate_motion
from rotortrack.motion.msd import msd
from rotortrack.motion.readings import Circle
from rotortrack.simulate.rod.options import RodOptions, SteppingOptions
from rotortrack.simulate.rod.run import run_rod

_spec = importlib.util.spec_from_file_location(
    "rod_steps", Path(__file__).parents[1] / "unit" / "simulate" / "rod" / "steps.py"
)
_steps = importlib.util.module_from_spec(_spec)
sys.modules["rod_steps"] = _steps
_spec.loader.exec_module(_steps)

pytestmark = pytest.mark.slow

DT_S = 0.002
FRAMES = 1_000_000


def test_ten_million_steps_of_a_rod_keep_its_links_and_its_way():
    rod = RodOptions(n_vertices=5, length_nm=36.0)
    stepping = {"duration_us": 0.2, "sample_us": 0.02}
    short = run_rod(rod, SteppingOptions(**stepping, max_step_us=2.1e-8), _steps.arc(5))
    long = run_rod(rod, SteppingOptions(**stepping, tolerance_nm=1e-8), _steps.arc(5))
    assert short.n_steps > 9_500_000
    links = np.linalg.norm(np.diff(short.positions_nm, axis=1), axis=2)
    assert np.abs(links / links[0, 0] - 1.0).max() < 2e-9
    np.testing.assert_allclose(short.positions_nm, long.positions_nm, atol=1e-5)


def test_a_million_frames_of_a_rotor_tell_its_speed_as_well_as_they_can():
    rng = np.random.default_rng(1)
    omega, diffusion = 40.0, 5.0
    steps = rng.normal(omega * DT_S, math.sqrt(2.0 * diffusion * DT_S), FRAMES)
    theta = np.cumsum(steps)
    x = 120.0 * np.cos(theta) + rng.normal(0.0, 8.0, FRAMES)
    y = -120.0 * np.sin(theta) + rng.normal(0.0, 8.0, FRAMES)
    sd = np.full(FRAMES, 8.0)
    found = estimate_motion(
        np.arange(FRAMES), x, y, sd, sd, Circle(0.0, 0.0, 120.0),
        frame_interval_s=DT_S, exposure_s=1e-9, method="increments",
    ).fit  # fmt: skip
    bound = math.sqrt(2.0 * diffusion / (FRAMES * DT_S))
    assert found.omega_sd_rad_s == pytest.approx(bound, rel=0.02)
    assert abs(found.omega_rad_s - omega) < 4.0 * bound
    assert found.diffusion_rad2_s == pytest.approx(diffusion, rel=0.02)


def test_the_msd_of_a_million_frames_keeps_its_digits_after_80_000_rad():
    rng = np.random.default_rng(2)
    theta = np.cumsum(rng.normal(0.08, 0.1, FRAMES))
    assert theta[-1] > 7e4
    found = msd(theta)
    for lag in (1, 10, 1000, FRAMES // 2, FRAMES - 1):
        exact = np.mean(np.square(theta[lag:] - theta[:-lag], dtype=np.longdouble))
        assert found.values[lag - 1] == pytest.approx(float(exact), rel=1e-8)
