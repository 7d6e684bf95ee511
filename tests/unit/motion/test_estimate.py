from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from rotortrack.motion.estimate import Reason, estimate_motion
from rotortrack.motion.readings import Circle

FRAME_S = 0.002


def positions(rng, n, omega, diffusion, sigma, missing=0.0, steps=None):
    if steps is None:
        steps = rng.normal(omega * FRAME_S, np.sqrt(2 * diffusion * FRAME_S), n)
    theta = rng.uniform(0, 2 * np.pi) + np.cumsum(steps)
    x = 100 * np.cos(theta) + rng.normal(0.0, 100 * sigma, n)
    y = -100 * np.sin(theta) + rng.normal(0.0, 100 * sigma, n)
    frame = np.flatnonzero(rng.random(n) >= missing)
    sd = np.full(frame.size, 100 * sigma)
    circle = Circle(x_nm=0.0, y_nm=0.0, radius_nm=100.0)
    return {
        "frame": frame,
        "x_nm": x[frame],
        "y_nm": y[frame],
        "x_sd_nm": sd,
        "y_sd_nm": sd,
    }, circle


def estimate(rows, circle, **options):
    return estimate_motion(
        **rows, circle=circle, frame_interval_s=FRAME_S, exposure_s=0.0, **options
    )


@pytest.mark.parametrize(
    ("diffusion", "sigma", "missing", "reason"),
    [
        (5.0, 0.1, 0.3, Reason.SMALL_STEPS),
        (120.0, 0.1, 0.6, Reason.WIDE_STEPS),
        (5.0, 0.5, 0.1, Reason.WIDE_NOISE),
    ],
)
def test_the_circle_is_used_where_steps_or_noise_are_wide(diffusion, sigma, missing, reason):
    rng = np.random.default_rng(1)
    found = estimate(*positions(rng, 2000, 20.0, diffusion, sigma, missing))
    assert found.reason is reason
    assert found.method == ("increments" if reason is Reason.SMALL_STEPS else "circular")
    low, high = found.fit.omega_interval_rad_s
    assert low < 20.0 < high
    assert not found.resampled


def test_a_rod_that_breathes_diffuses_no_slower_for_it():
    found = []
    for seed in range(20):
        rng = np.random.default_rng([8, seed])
        rows, circle = positions(rng, 2000, 20.0, 10.0, 0.08)
        # Out and in by 15 nm over 25 frames, which scatters the radius twice as far as noise does.
        kept = np.exp(-1.0 / 25.0)
        pushes = rng.normal(0.0, 15.0 * np.sqrt(1.0 - kept**2), rows["frame"].size)
        out = 1.0 + lfilter([1.0], [1.0, -kept], pushes) / np.hypot(rows["x_nm"], rows["y_nm"])
        rows |= {"x_nm": out * rows["x_nm"], "y_nm": out * rows["y_nm"]}
        fit = estimate(rows, circle).fit
        low, high = fit.diffusion_interval_rad2_s
        found.append((fit.diffusion_rad2_s, low < 10.0 < high))
    diffusion, inside = np.transpose(found)
    assert diffusion.mean() == pytest.approx(10.0, abs=3.0 * diffusion.std() / np.sqrt(20))
    assert inside.mean() >= 0.85


def test_false_spots_send_a_rotor_to_the_circle():
    rng = np.random.default_rng(2)
    rows, circle = positions(rng, 2000, 20.0, 3.0, 0.1)
    rows["x_nm"][500], rows["y_nm"][500] = -rows["x_nm"][500], -rows["y_nm"][500]
    found = estimate(rows, circle)
    assert found.reason is Reason.OUTLIERS
    assert found.n_false == 1


def test_a_slow_rotor_keeps_increments():
    rng = np.random.default_rng(3)
    found = estimate(*positions(rng, 2000, 0.0, 1e-5, 0.5))
    assert (found.method, found.reason) == ("increments", Reason.TOO_SLOW_FOR_GRID)


@pytest.mark.parametrize("method", ["increments", "circular"])
def test_a_method_can_be_asked_for(method):
    found = estimate(*positions(np.random.default_rng(4), 500, 20.0, 5.0, 0.2), method=method)
    assert (found.method, found.reason) == (method, Reason.ASKED_FOR)


@pytest.mark.parametrize("method", ["increments", "circular"])
def test_place_and_start_of_the_movie_do_not_matter(method):
    rows, circle = positions(np.random.default_rng(5), 500, 20.0, 5.0, 0.2, 0.2)
    here = estimate(rows, circle, method=method)
    moved = {
        **rows,
        "frame": rows["frame"] + 1_000_000,
        "x_nm": rows["x_nm"] + 1e6,
        "y_nm": rows["y_nm"] - 2e6,
    }
    there = estimate(moved, Circle(x_nm=1e6, y_nm=-2e6, radius_nm=100.0), method=method)
    assert there.fit.omega_rad_s == pytest.approx(here.fit.omega_rad_s, rel=1e-6)
    assert there.fit.diffusion_rad2_s == pytest.approx(here.fit.diffusion_rad2_s, rel=1e-6)
    np.testing.assert_allclose(there.posterior.x_nm - 1e6, here.posterior.x_nm, atol=1e-5)


def test_standard_deviations_may_be_unknown():
    rows, circle = positions(np.random.default_rng(6), 3000, 20.0, 5.0, 0.2, 0.2)
    known = estimate(rows, circle)
    unknown = estimate({**rows, "x_sd_nm": np.full(rows["frame"].size, np.nan)}, circle)
    assert unknown.fit.diffusion_rad2_s == pytest.approx(known.fit.diffusion_rad2_s, rel=0.03)
    assert unknown.noise_sd_rad == pytest.approx(known.noise_sd_rad, rel=0.05)


def test_the_posterior_covers_every_frame_from_the_first_to_the_last_seen():
    rows, circle = positions(np.random.default_rng(7), 1000, 20.0, 5.0, 0.2, 0.5)
    after = estimate(rows, circle).posterior
    assert after.frame[0] == rows["frame"][0]
    assert after.frame[-1] == rows["frame"][-1]
    assert np.all(np.diff(after.frame) == 1)
    missed = ~np.isin(after.frame, rows["frame"])
    assert after.theta_sd_rad[missed].mean() > after.theta_sd_rad[~missed].mean()


@pytest.mark.parametrize(
    ("rows", "radius", "reason"),
    [
        (slice(0, 0), 100.0, Reason.TOO_FEW_FRAMES),
        (slice(0, 9), 100.0, Reason.TOO_FEW_FRAMES),
        (slice(0, 500, 2), 100.0, Reason.TOO_FEW_FRAMES),
        (slice(0, 500), np.nan, Reason.NO_CIRCLE),
    ],
)
def test_nothing_is_told_where_nothing_is_known(rows, radius, reason):
    table, circle = positions(np.random.default_rng(8), 500, 20.0, 5.0, 0.2)
    circle = replace(circle, radius_nm=radius)
    found = estimate({name: column[rows] for name, column in table.items()}, circle)
    assert (found.method, found.reason) == ("none", reason)
    assert np.isnan(found.fit.omega_rad_s)
    assert found.posterior is None
    assert found.reason.sentence.endswith(".")


def test_a_rotor_that_switches_direction_is_flagged_and_gets_wider_intervals():
    rng = np.random.default_rng(9)
    direction = np.repeat(rng.choice([-1.0, 1.0], 20), 200)
    steps = 0.06 * direction + rng.normal(0.0, np.sqrt(2 * 3.0 * FRAME_S), 4000)
    rows, circle = positions(rng, 4000, 0.0, 0.0, 0.1, 0.1, steps)
    found = estimate(rows, circle)
    assert found.resampled
    assert found.white.slow_p < 1e-4
    trusting = estimate(rows, circle, white_p=0.0)
    assert not trusting.resampled
    assert found.fit.omega_sd_rad_s > 1.5 * trusting.fit.omega_sd_rad_s
    assert found.fit.drift_p > trusting.fit.drift_p


def test_circular_results_are_flagged_and_resampled_too():
    rng = np.random.default_rng(10)
    direction = np.repeat(rng.choice([-1.0, 1.0], 20), 200)
    steps = 0.06 * direction + rng.normal(0.0, np.sqrt(2 * 3.0 * FRAME_S), 4000)
    rows, circle = positions(rng, 4000, 0.0, 0.0, 0.5, 0.1, steps)
    found = estimate(rows, circle)
    assert found.method == "circular"
    assert found.resampled


def test_results_are_reproducible():
    rows, circle = positions(np.random.default_rng(11), 800, 20.0, 60.0, 0.3, 0.5)
    once, again = estimate(rows, circle), estimate(rows, circle)
    assert replace(once, posterior=None) == replace(again, posterior=None)
    np.testing.assert_array_equal(once.posterior.x_nm, again.posterior.x_nm)
