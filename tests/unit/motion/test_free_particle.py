"""The likelihood of a free particle, against the dense one and by what must not change it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize

from rotortrack.motion.free_particle import fit_free_particle
from rotortrack.motion.readings import Timing


def walk(seed, n=60, missing=0.2, noise=20.0, diffusion=1e5, dt=0.01):
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(0, np.sqrt(2 * diffusion * dt), (n, 2)), axis=0)
    seen = np.flatnonzero(rng.random(n) >= missing)
    x, y = (path + rng.normal(0, noise, path.shape))[seen].T
    return seen, x, y


def restricted_deviance(diffusion, noise, frame, x, y, timing):
    """Twice the negative restricted log-likelihood, by matrices as large as the track."""
    dt, exposure = timing.frame_interval_s, timing.exposure_s
    start = np.minimum.outer(frame, frame) * dt
    cov = 2 * diffusion * (start + (frame[:, None] != frame) * exposure / 2)
    cov[np.diag_indices(frame.size)] += 2 * diffusion * exposure / 3 + noise
    design = np.stack([np.ones(frame.size), frame * dt], axis=1)
    inverse = np.linalg.inv(cov)
    inside = design.T @ inverse @ design
    total = 2 * np.linalg.slogdet(cov)[1] + 2 * np.linalg.slogdet(inside)[1]
    for place in (x, y):
        left = place - design @ np.linalg.solve(inside, design.T @ inverse @ place)
        total += left @ inverse @ left
    return total


@pytest.mark.parametrize("exposure", [0.01, 0.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_maximum_is_that_of_the_dense_likelihood(seed, exposure):
    frame, x, y = walk(seed)
    timing = Timing(0.01, exposure)
    noise = np.full(frame.size, 300.0)
    found = fit_free_particle(frame, x, y, noise, noise, timing, noise_log_sd=math.inf)
    best = optimize.minimize(
        lambda p: restricted_deviance(*np.exp(p), frame, x, y, timing),
        np.log([1e5, 400.0]),
        method="Nelder-Mead",
        options={"xatol": 1e-5, "fatol": 1e-8},
    )
    diffusion, variance = np.exp(best.x)
    assert found.diffusion_nm2_s == pytest.approx(diffusion, rel=0.04)
    assert found.noise_factor * 300.0 == pytest.approx(variance, rel=0.06)
    low, high = found.diffusion_interval_nm2_s
    for end in (low, high):
        profile = optimize.minimize_scalar(
            lambda v, end=end: restricted_deviance(end, np.exp(v), frame, x, y, timing),
            bounds=(-2.0, 9.0),
            method="bounded",
        )
        assert 3.8 <= profile.fun - best.fun <= 5.2


def test_a_spot_that_only_jitters_may_have_no_diffusion():
    rng = np.random.default_rng(7)
    x, y = rng.normal(0, 20, (2, 300))
    noise = np.full(300, 400.0)
    found = fit_free_particle(np.arange(300), x, y, noise, noise, Timing(0.01, 0.01))
    assert found.diffusion_interval_nm2_s[0] == 0.0
    assert found.diffusion_interval_nm2_s[1] < 200.0
    assert math.sqrt(found.noise_factor) == pytest.approx(1.0, abs=0.1)


def test_errors_of_single_frames_count():
    """A third of the frames with ten times the error must hardly blur the answer."""
    rng = np.random.default_rng(8)
    sd = np.where(np.arange(400) % 3 == 0, 200.0, 20.0)
    x, y = np.cumsum(rng.normal(0, 45, (2, 400)), axis=1) + rng.normal(0, sd, (2, 400))
    frame = np.arange(400)
    known = fit_free_particle(frame, x, y, sd**2, sd**2, Timing(0.01, 0.0))
    flat = np.full(400, np.mean(sd**2))
    blind = fit_free_particle(frame, x, y, flat, flat, Timing(0.01, 0.0))
    assert known.diffusion_nm2_s == pytest.approx(45**2 / 0.02, rel=0.25)
    assert known.diffusion_sd_nm2_s < 0.7 * blind.diffusion_sd_nm2_s


def test_a_steady_velocity_is_found_and_does_not_pass_for_diffusion():
    frame, x, y = walk(9, n=300)
    noise = np.full(frame.size, 400.0)
    still = fit_free_particle(frame, x, y, noise, noise, Timing(0.01, 0.0))
    carried = fit_free_particle(
        frame, x + 30.0 * frame, y - 40.0 * frame, noise, noise, Timing(0.01, 0.0)
    )
    assert carried.diffusion_nm2_s == pytest.approx(still.diffusion_nm2_s, rel=1e-6)
    assert np.subtract(carried.velocity_nm_s, still.velocity_nm_s) == pytest.approx([3000, -4000])
    assert carried.directed_p < 1e-6 < 0.01 < still.directed_p


@given(st.integers(0, 200), st.floats(0.01, 100.0), st.floats(-1e6, 1e6))
def test_scale_place_and_axes_do_not_matter(seed, scale, shift):
    frame, x, y = walk(seed, n=25)
    noise = np.full(frame.size, 400.0)
    plain = fit_free_particle(frame, x, y, noise, noise, Timing(0.01, 0.005))
    moved = fit_free_particle(
        frame + 1000, scale * y + shift, shift - scale * x, scale**2 * noise, scale**2 * noise,
        Timing(0.01, 0.005),
    )  # fmt: skip
    assert moved.diffusion_nm2_s == pytest.approx(scale**2 * plain.diffusion_nm2_s, rel=1e-4)
    ends = np.array(plain.diffusion_interval_nm2_s) * scale**2
    assert moved.diffusion_interval_nm2_s == pytest.approx(ends, rel=1e-2)
    assert moved.directed_p == pytest.approx(plain.directed_p, rel=1e-3)


def test_three_positions_give_finite_numbers():
    noise = np.full(3, 400.0)
    place = np.array([0.0, 50.0, 10.0])
    found = fit_free_particle(np.array([0, 1, 5]), place, place, noise, noise, Timing(0.01, 0.01))
    assert np.isfinite([found.diffusion_nm2_s, *found.diffusion_interval_nm2_s]).all()
