from dataclasses import replace

import numpy as np
import pytest

from rotortrack.motion.angle_profile import angle_profile
from rotortrack.motion.estimate import NOT_ESTIMATED, estimate_motion
from rotortrack.motion.readings import Circle

from .planted import FRAME_S, filmed, free, washboard


def profile(rotor, estimate=NOT_ESTIMATED, **options):
    return angle_profile(estimate, rotor.frame, rotor.theta, frame_interval_s=FRAME_S, **options)


def measured(rotor):
    return estimate_motion(
        rotor.frame,
        rotor.x_nm,
        rotor.y_nm,
        rotor.sd_nm,
        rotor.sd_nm,
        Circle(0.0, 0.0, 100.0),
        frame_interval_s=FRAME_S,
        exposure_s=FRAME_S,
    )


def test_bins_count_every_frame_once():
    rng = np.random.default_rng(1)
    rotor = filmed(rng, free(rng, 20_000, 5.0, 20.0), 0.2, 0.1, 1.0, 20.0, 5.0)
    found = profile(rotor)
    assert found.n_frames.sum() == rotor.frame.size
    assert found.occupancy.sum() == pytest.approx(1.0)
    edges = np.linspace(-np.pi, np.pi, 25)
    np.testing.assert_array_equal(found.n_frames, np.histogram(rotor.theta, edges)[0])
    np.testing.assert_allclose(found.angle_rad, 0.5 * (edges[1:] + edges[:-1]))
    assert found.potential.p != found.potential.p


def test_errors_of_a_free_rotor_know_that_frames_are_correlated():
    rng = np.random.default_rng(2)
    occupied, speeds = [], []
    for _ in range(60):
        rotor = filmed(rng, free(rng, 40_000, 20.0, 20.0), 0.2, 0.1, 1.0, 20.0, 20.0)
        found = profile(rotor)
        occupied.append((found.occupancy - 1 / 24) / found.occupancy_sd)
        speeds.append((found.omega_rad_s - 20.0) / found.omega_sd_rad_s)
    assert 0.85 < np.std(occupied) < 1.15
    # The noise of the steps of a bin partly cancels, and 40 blocks know their scatter to 11 %.
    assert 0.75 < np.std(speeds) < 1.1
    assert abs(np.mean(speeds)) < 0.1
    independent = np.sqrt(23 / 24**2 / rotor.frame.size)
    assert np.mean(found.occupancy_sd) > 1.5 * independent


def test_noise_does_not_bend_local_speeds():
    # Noise of a third of a radian at 60 rad/s; binned by their starts, steps would lean back.
    rng = np.random.default_rng(3)
    path = washboard(rng, 80_000, 4.0, 15.0, (0.0, 0.0))
    found = profile(filmed(rng, path, 0.3, 0.0, 1.0, 60.0, 4.0))
    assert np.mean((found.omega_rad_s - 60.0) / found.omega_sd_rad_s) == pytest.approx(0.0, abs=0.6)


def test_a_pinned_rotor_is_slow_where_it_dwells():
    rng = np.random.default_rng(4)
    path = washboard(rng, 80_000, 10.0, 4.0, (0.0, -1.5))
    rotor = filmed(rng, path, 0.1, 0.0, 1.0, 0.0, 10.0)
    found = profile(rotor, measured(rotor))
    # Its current is the same everywhere: speed times occupancy.
    current = found.omega_rad_s * found.occupancy * 24
    error = np.abs(current) * np.hypot(
        found.omega_sd_rad_s / found.omega_rad_s, found.occupancy_sd / found.occupancy
    )
    turning = (path[-1] - path[0]) / (8000 * FRAME_S)
    assert np.mean(np.abs(current - turning) < 3 * error) > 0.9
    assert found.omega_rad_s[np.argmax(found.occupancy)] < 0.6 * found.omega_rad_s.max()
    low, high = found.potential.barrier_interval_kt
    assert low < 3.0 < high
    assert found.potential.p < 1e-4


def test_rows_are_a_table():
    rng = np.random.default_rng(5)
    rotor = filmed(rng, free(rng, 20_000, 5.0, 20.0), 0.2, 0.1, 1.0, 20.0, 5.0)
    table = profile(rotor, bins=12).table(7)
    assert len(table) == 12
    assert table["rotor"].eq(7).all()
    assert table["bin"].tolist() == list(range(12))


def test_directions_that_were_never_visited_have_no_speed():
    rng = np.random.default_rng(6)
    rotor = filmed(rng, np.zeros(10_000), 0.05, 0.0, 1.0, 0.0, 0.0)
    found = profile(rotor)
    assert np.isnan(found.omega_rad_s).sum() >= 20
    assert np.all(np.isnan(found.omega_rad_s) == np.isnan(found.omega_sd_rad_s))
    assert np.all(found.occupancy[np.isnan(found.omega_rad_s)] == 0.0)


def test_too_few_frames_have_no_profile():
    rng = np.random.default_rng(7)
    rotor = filmed(rng, free(rng, 900, 5.0, 20.0), 0.2, 0.0, 1.0, 20.0, 5.0)
    assert profile(rotor) is None
    assert replace(NOT_ESTIMATED).posterior is None


def test_the_height_of_wells_that_are_forgotten_within_frames_is_not_told():
    rng = np.random.default_rng(9)
    path = washboard(rng, 40_000, 40.0, 0.0, (0.0, 2.0))
    found = profile(rotor := filmed(rng, path, 0.1, 0.0, 1.0, 0.0, 40.0), measured(rotor))
    assert found.potential.p < 1e-3
    assert np.isnan(found.potential.barrier_kt)
    assert np.isnan(found.potential.barrier_interval_kt).all()
