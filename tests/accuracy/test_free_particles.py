"""Diffusion of mobile particles, from positions with gaps, noise and blur, against the truth."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.motion.free_particle import fit_free_particle
from rotortrack.motion.link_options import LinkOptions
from rotortrack.motion.particles import track_particles
from rotortrack.motion.readings import Timing

# (particles, frames, D um^2/s, noise nm, exposed part, missing part, greatest bias of D)
CORNERS = [
    (500, 300, 0.1, 20.0, 1.0, 0.1, 0.02),
    (500, 100, 0.02, 30.0, 1.0, 0.0, 0.03),
    (500, 60, 0.1, 5.0, 0.5, 0.3, 0.03),
    (500, 20, 0.1, 20.0, 0.0, 0.2, 0.12),
]


@pytest.mark.parametrize("corner", CORNERS)
def test_diffusion_is_unbiased_with_honest_intervals_and_the_noise_is_recovered(swimming, corner):
    particles, frames, diffusion, noise, exposed, missing, bias = corner
    table = swimming(
        np.random.default_rng(1), particles, frames,
        diffusion_um2_s=diffusion, noise_nm=noise, exposed=exposed, missing=missing,
    )  # fmt: skip
    timing = Timing(0.01, 0.01 * exposed)
    found = []
    for _, part in table.groupby("truth"):
        # The fit's own errors are a quarter too small, as those of real spots may be.
        variance = np.full(len(part), (noise / 1.25) ** 2)
        places = (part[name].to_numpy() for name in ("frame", "x_nm", "y_nm"))
        found.append(fit_free_particle(*places, variance, variance, timing))
    estimates = np.array([one.diffusion_nm2_s for one in found]) / 1e6
    intervals = np.array([one.diffusion_interval_nm2_s for one in found]) / 1e6
    assert estimates.mean() == pytest.approx(diffusion, rel=bias)
    inside = (intervals[:, 0] <= diffusion) & (diffusion <= intervals[:, 1])
    # The bar is 93 to 97 %, and chance moves the share of 500 by half a percent more.
    assert 0.925 <= inside.mean() <= 0.975
    shown = np.median([np.sqrt(one.noise_factor) for one in found]) * noise / 1.25
    assert shown == pytest.approx(noise, rel=0.25 if frames < 100 else 0.05)
    assert 0.025 <= np.mean([one.directed_p < 0.05 for one in found]) <= 0.08


def test_from_spots_to_diffusion_linking_included(swimming):
    table = swimming(np.random.default_rng(2), 80, 200, missing=0.1, box_nm=40_000.0)
    mixed = table.drop(columns="truth").sample(frac=1.0, random_state=3)
    found = track_particles(mixed, LinkOptions(), frame_interval_s=0.01, exposure_s=0.01)
    whole = found.ensemble
    assert whole.diffusion_nm2_s == pytest.approx(1e5, abs=3.5 * whole.diffusion_sd_nm2_s)
    assert whole.diffusion_nm2_s == pytest.approx(1e5, rel=0.03)
    assert whole.localisation_sd_nm == pytest.approx(20.0, rel=0.06)
    rows = found.particles[found.particles["n_frames"] >= 100]
    low, high = rows["diffusion_ci_low_um2_s"], rows["diffusion_ci_high_um2_s"]
    assert ((low <= 0.1) & (high >= 0.1)).mean() >= 0.88
    assert rows["diffusion_um2_s"].mean() == pytest.approx(0.1, rel=0.03)
