import numpy as np
import pytest

from rotortrack.motion.circular import Grid, angles_needed
from rotortrack.motion.linear import unwrap
from rotortrack.motion.posterior import posterior, smooth_on_circle, smooth_on_line
from rotortrack.motion.readings import Circle, Pace, Readings, Timing

FRAME_S = 0.002
CIRCLE = Circle(x_nm=1000.0, y_nm=400.0, radius_nm=100.0)


def track(rng, n, omega, diffusion, sigma, missing):
    timing = Timing(FRAME_S, FRAME_S)
    ends = np.cumsum(rng.normal(0.0, np.sqrt(timing.step_variance(diffusion)), n + 1))
    average = 0.5 * (ends[1:] + ends[:-1])
    average += rng.normal(0.0, np.sqrt(timing.deviation_variance(diffusion)), n)
    average += omega * FRAME_S * np.arange(n)
    place = 100 * np.exp(1j * average) + 100 * (rng.normal(0.0, sigma, (2, n)).T @ [1, 1j])
    frame = np.flatnonzero(rng.random(n) >= missing)
    z = place[frame]
    seen = Readings(frame, np.angle(z), np.abs(z), np.abs(z) / (100 * sigma**2))
    return seen, timing, average[frame[0] : frame[-1] + 1]


def gaussian_posterior(seen, timing, pace, strayed):
    """Condition all exposure averages on the readings by one dense linear system."""
    frames = np.arange(seen.frame[-1] - seen.frame[0] + 1)
    start = (frames + 1) * timing.frame_interval_s
    earlier = np.minimum(start[:, None], start[None, :])
    covariance = 2 * pace.diffusion_rad2_s * (earlier + timing.exposure_s / 2)
    np.fill_diagonal(covariance, 2 * pace.diffusion_rad2_s * (start + timing.exposure_s / 3))
    covariance += 1e3
    rows = seen.frame - seen.frame[0]
    noisy = covariance[np.ix_(rows, rows)] + np.diag(pace.noise_factor * seen.noise_rad2)
    gain = np.linalg.solve(noisy, covariance[rows]).T
    return gain @ strayed, np.diag(covariance - gain @ covariance[rows])


def test_the_line_smoother_is_the_conditional_normal():
    seen, timing, _ = track(np.random.default_rng(1), 60, 10.0, 3.0, 0.1, 0.4)
    pace = Pace(10.0, 2.5, 1.2)
    strayed, _, _ = unwrap(seen, timing, pace)
    first, second = smooth_on_line(seen, timing, strayed, pace)
    mean, variance = gaussian_posterior(seen, timing, pace, strayed)
    drift = 10.0 * FRAME_S * np.arange(mean.size)
    np.testing.assert_allclose(first, np.exp(1j * (mean + drift) - variance / 2), atol=5e-6)
    np.testing.assert_allclose(second, np.exp(2j * (mean + drift) - 2 * variance), atol=5e-6)


@pytest.mark.parametrize("missing", [0.0, 0.4])
def test_circle_and_line_agree_where_noise_is_small(missing):
    seen, timing, _ = track(np.random.default_rng(2), 200, 10.0, 3.0, 0.05, missing)
    pace = Pace(10.0, 3.0, 1.0)
    strayed, _, _ = unwrap(seen, timing, pace)
    line = smooth_on_line(seen, timing, strayed, pace)
    grid = Grid(seen, timing, angles_needed(pace, seen, timing))
    circle = smooth_on_circle(grid, pace)
    np.testing.assert_allclose(circle[0], line[0], atol=2e-3)
    np.testing.assert_allclose(circle[1], line[1], atol=5e-3)


@pytest.mark.parametrize("edge", [1024, 2048])
def test_the_ends_of_blocks_leave_no_trace_in_a_long_track(edge):
    seen, timing, _ = track(np.random.default_rng(2), 2500, 10.0, 3.0, 0.05, 0.2)
    pace = Pace(10.0, 3.0, 1.0)
    strayed, _, _ = unwrap(seen, timing, pace)
    line = smooth_on_line(seen, timing, strayed, pace)
    circle = smooth_on_circle(Grid(seen, timing, angles_needed(pace, seen, timing)), pace)
    near = slice(edge - 20, edge + 20)
    np.testing.assert_allclose(circle[0][near], line[0][near], atol=2e-3)


@pytest.mark.parametrize(
    ("diffusion", "sigma", "missing"),
    [(2.0, 0.2, 0.0), (60.0, 0.3, 0.3), (120.0, 0.5, 0.8)],
)
def test_told_errors_are_the_errors_seen_or_missed(diffusion, sigma, missing):
    seen, timing, truth = track(np.random.default_rng(3), 4000, -30.0, diffusion, sigma, missing)
    pace = Pace(-30.0, diffusion, 1.0)
    grid = Grid(seen, timing, max(angles_needed(pace, seen, timing), 48))
    # The truth here is a point on the circle, as nothing pulls averages of angles inwards.
    found = posterior(seen, timing, pace, smooth_on_circle(grid, pace), CIRCLE)
    depth = (2 * diffusion * FRAME_S) ** 2 / 180.0
    off_x = found.x_nm - (1000.0 + 100.0 * np.cos(truth))
    off_y = found.y_nm - (400.0 - 100.0 * np.sin(truth))
    there = np.isin(found.frame, seen.frame)
    for some in (there, ~there):
        if not some.any():
            continue
        told = found.x_sd_nm[some] ** 2 + found.y_sd_nm[some] ** 2 - 1e4 * depth
        pull = np.sqrt((off_x[some] ** 2 + off_y[some] ** 2).mean() / told.mean())
        assert 0.93 < pull < 1.07
    close = found.theta_sd_rad < 0.3
    if close.sum() > 1000:
        away = np.angle(np.exp(1j * (found.theta_rad - truth)))[close]
        assert np.sqrt(np.mean((away / found.theta_sd_rad[close]) ** 2)) == pytest.approx(
            1.0, abs=0.1
        )


def test_the_distance_from_the_centre_is_believed_where_blur_makes_it_vary():
    rng = np.random.default_rng(4)
    seen, timing, _ = track(rng, 50, 0.0, 120.0, 0.02, 0.0)
    pulled = Readings(seen.frame, seen.theta_rad, seen.distance_nm - 8.0, seen.concentration)
    pace = Pace(0.0, 120.0, 1.0)
    grid = Grid(pulled, timing, 256)
    found = posterior(pulled, timing, pace, smooth_on_circle(grid, pace), CIRCLE)
    distance = np.hypot(found.x_nm - 1000.0, found.y_nm - 400.0).mean()
    assert 92.0 < distance < 96.0
