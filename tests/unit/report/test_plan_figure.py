from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rotortrack.motion.plan import Setting
from rotortrack.motion.plan_movie import plan_movie
from rotortrack.report import style
from rotortrack.report.figures import plan

sys.path.insert(0, str(Path(__file__).parent))
from mock_run import clipped, overlaps


@pytest.mark.parametrize("diffusion", [0.01, 3.0, 400.0])
@pytest.mark.parametrize("frames", [20, 8000, 10_000_000])
@pytest.mark.parametrize("speed", [None, 5.0, 30_000.0])
def test_nothing_overlaps_whatever_is_planned(diffusion, frames, speed):
    setting = Setting(diffusion, 100.0, 10.0, 0.002, 0.002, frames)
    omega = None if speed is None else math.radians(speed)
    figure = plan.figure(plan_movie(setting, omega_rad_s=omega, driven_z=3.5))
    assert overlaps(figure) == []
    assert clipped(figure) == []


def rows(n):
    rng = np.random.default_rng(n)
    return pd.DataFrame(
        {
            "smallest_deg_s": rng.uniform(100, 900, n),
            "speed_deg_s": rng.normal(0, 800, n) ** 3 / 1e6,
            "speed_sd_deg_s": rng.uniform(20, 90, n),
            "behaviour": rng.choice(list(style.BEHAVIOURS), n),
        }
    )


@pytest.mark.parametrize("n", [0, 1, 3, 200])
def test_nothing_overlaps_whatever_the_rotors(n):
    figure = plan.resolved(rows(n), 3.5)
    assert overlaps(figure) == []
    assert clipped(figure) == []
