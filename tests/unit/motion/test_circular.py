import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special, stats

from rotortrack.motion.circular import Grid, angles_needed, fit_circular, inverse_resultant
from rotortrack.motion.grid import UNIFORM_SHARE
from rotortrack.motion.likelihood import freedom, quantile
from rotortrack.motion.linear import fit_increments, log_densities, speed_information
from rotortrack.motion.readings import NoisePrior, Pace, Readings, Timing

FRAME_S = 0.002
PRIOR = NoisePrior(0.0, 0.3)


def track(rng, n, omega, diffusion, sigma, missing=0.0, exposed=1.0):
    timing = Timing(FRAME_S, exposed * FRAME_S)
    ends = np.cumsum(rng.normal(0.0, np.sqrt(timing.step_variance(diffusion)), n + 1))
    average = 0.5 * (ends[1:] + ends[:-1])
    average += rng.normal(0.0, np.sqrt(timing.deviation_variance(diffusion)), n)
    average += omega * FRAME_S * np.arange(n)
    place = np.exp(1j * average) + rng.normal(0.0, sigma, (2, n)).T @ [1, 1j]
    frame = np.flatnonzero(rng.random(n) >= missing)
    seen = place[frame]
    return Readings(frame, np.angle(seen), np.abs(seen), np.abs(seen) / sigma**2), timing


def reference(seen, timing, pace, size):
    """Sum over both ends of every interval, turn by turn, lap by lap; one frame after another."""
    cell = 2 * np.pi / size
    sd = np.sqrt(timing.step_variance(pace.diffusion_rad2_s))
    deviation = timing.deviation_variance(pace.diffusion_rad2_s)
    readings = dict(zip(seen.frame.tolist(), range(len(seen)), strict=True))
    density = np.full(size, 1.0 / size)
    logs = []
    turns = np.arange(-2 * size, 2 * size + 1)
    weights = stats.norm.pdf(turns * cell, scale=sd) * cell
    for frame in range(seen.frame[0], seen.frame[-1] + 1):
        after = np.zeros(size)
        row = readings.get(frame)
        if row is not None:
            kappa = seen.concentration[row] / pace.noise_factor
            length = special.i1e(kappa) / special.i0e(kappa) * np.exp(-deviation / 2)
            kappa = inverse_resultant(np.array([length]))[0]
            drift = pace.omega_rad_s * FRAME_S * (frame - seen.frame[0])
        for start in range(size):
            for turn, weight in zip(turns, weights, strict=True):
                told = 1.0
                if row is not None:
                    off = seen.theta_rad[row] - drift - cell * (start + turn / 2)
                    told = stats.vonmises.pdf(off, kappa) * (1 - UNIFORM_SHARE)
                    told += UNIFORM_SHARE / (2 * np.pi)
                after[(start + turn) % size] += density[start] * weight * told
        if row is not None:
            logs.append(np.log(after.sum()))
        density = after / after.sum()
    return np.array(logs)


@pytest.mark.parametrize(("diffusion", "exposed"), [(120.0, 1.0), (60.0, 0.0)])
def test_the_filter_is_the_sum_over_all_paths_of_the_grid(diffusion, exposed):
    rng = np.random.default_rng(1)
    seen, timing = track(rng, 9, 50.0, diffusion, 0.4, missing=0.4, exposed=exposed)
    pace = Pace(55.0, diffusion, 1.1)
    told = Grid(seen, timing, 24).log_densities(pace)
    # Turns beyond five standard deviations are left out.
    np.testing.assert_allclose(told, reference(seen, timing, pace, 24), atol=2e-5)


CORNERS = [
    (0.2, 0.05, 0.0, 1.0),
    (0.2, 0.5, 0.8, 0.0),
    (2.0, 0.2, 0.4, 1.0),
    (120.0, 0.05, 0.8, 1.0),
    (120.0, 0.5, 0.4, 0.0),
]


@pytest.mark.parametrize(("diffusion", "sigma", "missing", "exposed"), CORNERS)
def test_doubling_the_grid_changes_nothing(diffusion, sigma, missing, exposed):
    rng = np.random.default_rng(2)
    seen, timing = track(rng, 2000, 30.0, diffusion, sigma, missing, exposed)
    pace = Pace(31.0, 0.9 * diffusion, 1.1)
    size = max(angles_needed(pace, seen, timing), 48)
    single, double = (Grid(seen, timing, s).log_densities(pace).sum() for s in (size, 2 * size))
    assert single == pytest.approx(double, abs=0.01)


def test_estimates_do_not_move_when_the_grid_doubles(monkeypatch):
    seen, timing = track(np.random.default_rng(3), 1500, -20.0, 20.0, 0.3, 0.5)
    start = Pace(-20.0, 20.0, 1.0)
    single = fit_circular(seen, timing, [start], PRIOR)
    monkeypatch.setattr("rotortrack.motion.circular._LEAST_ANGLES", 2 * single.grid.size)
    double = fit_circular(seen, timing, [start], PRIOR)
    assert double.grid.size == 2 * single.grid.size
    for name, sd in (
        ("omega_rad_s", single.fit.omega_sd_rad_s),
        ("diffusion_rad2_s", single.fit.diffusion_sd_rad2_s),
    ):
        assert abs(getattr(double.fit, name) - getattr(single.fit, name)) < 0.01 * sd


def test_where_increments_are_exact_both_agree():
    seen, timing = track(np.random.default_rng(4), 2000, 12.0, 2.0, 0.05, 0.3)
    start = Pace(12.0, 2.0, 1.0)
    line = fit_increments(seen, timing, start, PRIOR).fit
    circle = fit_circular(seen, timing, [start], PRIOR).fit
    for name in ("omega_rad_s", "omega_sd_rad_s"):
        assert getattr(circle, name) == pytest.approx(
            getattr(line, name), abs=0.03 * line.omega_sd_rad_s
        )
    for one, other in zip(
        (circle.diffusion_rad2_s, *circle.diffusion_interval_rad2_s),
        (line.diffusion_rad2_s, *line.diffusion_interval_rad2_s),
        strict=True,
    ):
        assert one == pytest.approx(other, abs=0.1 * line.diffusion_sd_rad2_s)
    np.testing.assert_allclose(
        circle.omega_interval_rad_s, line.omega_interval_rad_s, atol=0.1 * line.omega_sd_rad_s
    )


def test_the_density_of_a_step_is_that_of_the_line_where_noise_is_small():
    seen, timing = track(np.random.default_rng(5), 500, 12.0, 2.0, 0.05, 0.3)
    pace = Pace(12.0, 2.0, 1.0)
    grid = Grid(seen, timing, angles_needed(pace, seen, timing)).log_densities(pace)
    line = log_densities(seen, timing, pace)
    # Each reading is a von Mises and not a normal variable.
    assert abs(grid[1:].sum() - line[1:].sum()) < 1.0
    assert grid[0] == pytest.approx(-np.log(2 * np.pi), abs=1e-6)


def test_a_gap_of_any_length_is_prediction_alone():
    rng = np.random.default_rng(6)
    seen, timing = track(rng, 100, 5.0, 20.0, 0.2)
    for gap in (1, 31, 32, 33, 500):
        frame = np.where(seen.frame < 50, seen.frame, seen.frame + gap)
        gappy = Readings(frame, seen.theta_rad, seen.distance_nm, seen.concentration)
        pace = Pace(5.0, 20.0, 1.0)
        told = Grid(gappy, timing, 64).log_densities(pace)
        finer = Grid(gappy, timing, 128).log_densities(pace)
        np.testing.assert_allclose(told, finer, atol=1e-5)
    # After a second of diffusion at 20 rad^2/s nothing is known of the angle.
    assert told[50] == pytest.approx(-np.log(2 * np.pi), abs=1e-5)


def test_intervals_end_where_the_likelihood_has_fallen():
    seen, timing = track(np.random.default_rng(7), 1500, 60.0, 60.0, 0.3, 0.6)
    found = fit_circular(seen, timing, [Pace(60.0, 60.0, 1.0)], PRIOR)
    limit = quantile(freedom(found.fit.diffusion_relative_sd))

    def objective(point):
        pace = Pace(point[0], np.exp(point[1]), np.exp(point[2]))
        information = speed_information(seen, timing, pace.diffusion_rad2_s, pace.noise_factor)
        told = found.grid.log_densities(pace).sum()
        return told - 0.5 * (np.log(information) + PRIOR.deviance(point[2]))

    best = found.maximum.point
    for offset in np.random.default_rng(8).normal(0.0, 0.5 * found.maximum.sd, (20, 3)):
        assert objective(best + offset) < found.maximum.value + 0.005
    for end in found.fit.omega_interval_rad_s:
        slope = found.maximum.covariance[:, 0] / found.maximum.covariance[0, 0]
        fallen = found.maximum.value - objective(best + slope * (end - best[0]))
        assert 2 * fallen == pytest.approx(limit, rel=0.05)


def test_false_spots_are_seen_through():
    rng = np.random.default_rng(9)
    seen, timing = track(rng, 2000, 20.0, 3.0, 0.1)
    false = rng.random(2000) < 0.02
    theta = np.where(false, rng.uniform(-np.pi, np.pi, 2000), seen.theta_rad)
    spoilt = Readings(seen.frame, theta, seen.distance_nm, seen.concentration)
    found = fit_circular(spoilt, timing, [Pace(20.0, 3.0, 1.0)], PRIOR)
    clean = fit_circular(seen, timing, [Pace(20.0, 3.0, 1.0)], PRIOR).fit
    assert abs(found.fit.diffusion_rad2_s - clean.diffusion_rad2_s) < clean.diffusion_sd_rad2_s
    pace = Pace(found.fit.omega_rad_s, found.fit.diffusion_rad2_s, found.fit.noise_factor)
    named = found.grid.false_readings(pace)
    far = false & (np.abs(np.angle(np.exp(1j * (theta - seen.theta_rad)))) > 1.0)
    assert named[far].mean() > 0.95
    assert named[~false].mean() < 0.005


@pytest.mark.parametrize(("diffusion", "sigma"), [(20.0, 0.5), (120.0, 0.1)])
def test_residuals_are_white_of_unit_variance_however_wide_the_noise(diffusion, sigma):
    rng = np.random.default_rng(10)
    seen, timing = track(rng, 20000, 15.0, diffusion, sigma, 0.2)
    deviation, ahead = Grid(seen, timing, 64).residuals(Pace(15.0, diffusion, 1.0))
    n = len(seen)
    assert abs(deviation.mean()) < 3 / np.sqrt(n)
    assert deviation.var() == pytest.approx(1.0, abs=0.03)
    lagged = [deviation[lag:] @ deviation[:-lag] / n for lag in range(1, 11)]
    assert n * np.sum(np.square(lagged)) < stats.chi2.isf(0.001, 10)
    off = seen.theta_rad - ahead
    np.testing.assert_allclose(np.sign(np.sin(off)), np.sign(deviation))


@given(st.floats(1e-6, 1e6))
def test_the_concentration_of_a_resultant_is_found(kappa):
    length = np.array([special.i1e(kappa) / special.i0e(kappa)])
    again = inverse_resultant(length)
    assert special.i1e(again) / special.i0e(again) == pytest.approx(length, rel=1e-7)


def test_turns_without_diffusion_stay_where_they_are():
    seen, timing = track(np.random.default_rng(7), 3, 5.0, 20.0, 0.2)
    grid = Grid(seen, timing, 48)
    for variance in (0.0, 5e-324, 1e-12):
        weights = grid.circle_turns(variance)
        assert weights[24] == 1.0
        assert weights.sum() == 1.0
