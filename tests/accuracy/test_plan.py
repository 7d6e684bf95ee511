"""What a plan promises is what the analysis reaches, on simulated rotors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rotortrack.motion.estimate import estimate_motion
from rotortrack.motion.plan import (
    Setting,
    diffusion_relative_sd,
    smallest_speed,
    speed_sd,
    speed_test,
)
from rotortrack.motion.readings import Circle

FRAME_S = 0.002
PARTS = 12


def estimates(rng, setting, omega, rotors):
    """Speeds, their errors, p of no drift and D of rotors that are filmed as planned."""
    pace = FRAME_S / PARTS
    radius = setting.radius_nm
    for _ in range(rotors):
        n = int(setting.frames)
        turn = rng.normal(omega * pace, np.sqrt(2 * setting.diffusion_rad2_s * pace), n * PARTS)
        place = radius * np.exp(1j * np.cumsum(turn)).reshape(n, PARTS).mean(axis=1)
        seen = np.flatnonzero(rng.random(n) < setting.detection)
        sd = np.full(seen.size, setting.localisation_sd_nm)
        x = place.real[seen] + rng.normal(0, sd)
        y = -place.imag[seen] + rng.normal(0, sd)
        circle = Circle(0.0, 0.0, radius * setting.blur(omega))
        found = estimate_motion(
            seen, x, y, sd, sd, circle, frame_interval_s=FRAME_S, exposure_s=FRAME_S
        ).fit
        yield found.omega_rad_s, found.omega_sd_rad_s, found.drift_p, found.diffusion_rad2_s


@pytest.mark.parametrize(
    ("diffusion", "sd_nm", "frames", "detection"), [(10.0, 10.0, 1500, 1.0), (2.0, 20.0, 1500, 0.7)]
)
def test_speeds_are_told_as_often_and_as_exactly_as_planned(diffusion, sd_nm, frames, detection):
    setting = Setting(diffusion, 100.0, sd_nm, FRAME_S, FRAME_S, frames, detection)
    rotors = 160
    for errors, seed in ((3.5, 1), (1.96, 2)):
        omega = smallest_speed(setting, errors)
        found = np.array(list(estimates(np.random.default_rng(seed), setting, omega, rotors)))
        speed, sd, p, own_diffusion = found.T
        told = (p < 2 * stats.norm.sf(errors)) & (speed > 0)
        expected = speed_test(setting, errors).power(omega / speed_sd(setting, omega))
        assert expected == pytest.approx(0.95, abs=1e-3)
        # Three errors of a share of 160.
        assert told.mean() == pytest.approx(expected, abs=3 * np.sqrt(0.95 * 0.05 / rotors))
        assert speed.std() == pytest.approx(speed_sd(setting, omega), rel=0.17)
        assert np.median(sd) == pytest.approx(speed_sd(setting, omega), rel=0.05)
    relative = own_diffusion.std() / diffusion
    assert relative == pytest.approx(diffusion_relative_sd(setting), rel=0.17)
