"""Overlapping spots are fitted together; single ones, however odd their shape, are left alone."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import j1

from rotortrack.flags import FIT_FAILED, FitFlag
from rotortrack.localise.joint import resolve

_spec = importlib.util.spec_from_file_location(
    "overlap_helpers", Path(__file__).parent / "overlaps.py"
)
overlaps = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(overlaps)


def split_rate(frames, **options):
    candidates = overlaps.brightest(frames)
    joint = overlaps.resolved(frames, candidates, **options)[2]
    return (len(joint.owners) - len(candidates)) / len(candidates)


def blurred(rng, n, photons, degrees, radius_px=100 / 108.3, moments=24):
    """Tips that turn by an angle during the exposure."""
    start = rng.uniform(0, 2 * np.pi, (n, 1))
    angle = start + np.deg2rad(degrees) * np.linspace(-0.5, 0.5, moments)
    shift = rng.uniform(-0.5, 0.5, (2, n, 1))
    x = shift[0] + radius_px * (np.cos(angle) - np.cos(start))
    y = shift[1] + radius_px * (np.sin(angle) - np.sin(start))
    return overlaps.expected_frames(x, y, np.full(x.shape, photons / moments))


def airy(x, y, photons, background, fine=8):
    """Spots of a round aperture whose core has the width of the Gaussian."""
    size = overlaps.SIZE
    grid = (np.arange(size * fine) + 0.5) / fine - size / 2
    wave = 2 * np.pi * 0.21 / overlaps.SIGMA_PX
    frames = np.empty((len(x), size, size))
    for k in range(len(x)):
        phase = wave * np.hypot(grid[None, :] - x[k], grid[:, None] - y[k]) + 1e-9
        light = (2 * j1(phase) / phase) ** 2 * wave**2 / (4 * np.pi) / fine**2
        binned = light.reshape(size, fine, size, fine).sum(axis=(1, 3))
        frames[k] = photons * binned + background
    return frames


@pytest.mark.parametrize(("photons", "background"), [(250.0, 8.0), (800.0, 50.0), (5000.0, 2.0)])
def test_single_spots_are_split_less_than_once_in_a_thousand(photons, background):
    # 20 000 spots each gave at most 2e-4; 4000 and a bound of 1e-3 leave 4 splits.
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-0.5, 0.5, (2, 4000, 1))
    expected = overlaps.expected_frames(x, y, np.full((4000, 1), photons), background)
    assert split_rate(overlaps.noisy(rng, expected)) <= 1e-3


@pytest.mark.parametrize("photons", [2000.0, 5000.0])
@pytest.mark.parametrize("degrees", [30.0, 60.0, 90.0])
def test_a_tip_blurred_along_its_arc_is_one_spot(photons, degrees):
    rng = np.random.default_rng(2)
    frames = overlaps.noisy(rng, blurred(rng, 600, photons, degrees))
    assert split_rate(frames) <= (0.002 if degrees < 90 else 0.01)


@pytest.mark.parametrize("background", [2.0, 50.0])
def test_rings_of_a_bright_airy_spot_are_no_emitters(background):
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-0.5, 0.5, (2, 150))
    frames = overlaps.noisy(rng, airy(x, y, 5000.0, background))
    assert split_rate(frames) <= 0.01


def test_noise_of_a_pixel_map_is_no_emitter():
    rng = np.random.default_rng(4)
    noise = rng.lognormal(np.log(1.2), 0.2, (overlaps.SIZE, overlaps.SIZE))
    noise = np.where(rng.random(noise.shape) < 0.03, rng.uniform(4, 12, noise.shape), noise)
    x, y = rng.uniform(-0.5, 0.5, (2, 2000, 1))
    expected = overlaps.expected_frames(x, y, np.full((2000, 1), 800.0))
    frames = overlaps.noisy(rng, expected, noise)
    assert split_rate(frames, arrays=overlaps.camera(noise)) <= 1e-3


@pytest.mark.parametrize(
    ("separation_px", "photons", "found"),
    [
        (1.5, (2000.0, 2000.0), 0.9),
        (2.0, (1000.0, 1000.0), 0.97),
        (2.5, (500.0, 500.0), 0.95),
        (3.5, (250.0, 250.0), 0.9),
        (2.5, (1000.0, 333.0), 0.9),
        (4.0, (2000.0, 667.0), 0.9),
    ],
)
def test_true_pairs_are_found_with_honest_errors(separation_px, photons, found):
    rng = np.random.default_rng(5)
    x, y, light = overlaps.some_pairs(rng, 300, separation_px, photons)
    frames = overlaps.noisy(rng, overlaps.expected_frames(x, y, light))
    candidates = overlaps.brightest(frames)
    joint = overlaps.resolved(frames, candidates)[2]
    errors, sd = overlaps.pair_errors(joint, candidates, x, y)
    assert len(errors) >= found * len(x)
    assert 0.9 <= overlaps.rms(errors / sd) <= 1.15
    assert np.abs(errors.mean(axis=(0, 1))).max() < 4 * overlaps.rms(sd) / np.sqrt(2 * len(errors))
    assert (joint.flags[joint.owners == 0] == FitFlag.JOINT).all()


def numerical_bound(parameters, shape, pixels):
    """Standard deviations of x, y, photons of each emitter, background, sigma."""

    def model(p):
        emitters = p[:-2].reshape(-1, 3)
        return overlaps.expected_frames(
            *emitters.T[:, None, :], background=p[-2], sigma=p[-1], size=shape
        )[0][pixels]

    steps = 1e-5 * np.maximum(np.abs(parameters), 1.0)
    slopes = np.array(
        [
            (model(parameters + step) - model(parameters - step)).ravel() / (2 * step.sum())
            for step in np.diag(steps)
        ]
    )
    information = (slopes / (model(parameters).ravel() + overlaps.READ_NOISE_E**2)) @ slopes.T
    return np.sqrt(np.diag(np.linalg.inv(information)))


def test_reported_errors_are_the_bound_of_the_joint_model():
    rng = np.random.default_rng(6)
    x, y, light = overlaps.some_pairs(rng, 20, 2.4, (1500.0, 1000.0))
    frames = overlaps.noisy(rng, overlaps.expected_frames(x, y, light))
    candidates = overlaps.brightest(frames)
    joint = overlaps.resolved(frames, candidates)[2]
    reach = overlaps.RADIUS + 1
    for k, (_, row, column) in enumerate(candidates):
        rows = joint.results[:, joint.owners == k]
        assert rows.shape[1] == 2
        shift = np.array([column, row]) - overlaps.MIDDLE
        emitters = np.column_stack([rows[0] + shift[0], rows[1] + shift[1], rows[2]])
        fitted = np.concatenate([emitters.ravel(), rows[3:5, 0]])
        pixels = np.s_[row - reach : row + reach + 1, column - reach : column + reach + 1]
        bound = numerical_bound(fitted, overlaps.SIZE, pixels)
        # The fit stops within 1e-4 of its optimum.
        np.testing.assert_allclose(rows[5], bound[:6:3], rtol=2e-3)
        np.testing.assert_allclose(rows[6], bound[1:6:3], rtol=2e-3)


def both():
    """A frame of two spots 4 px apart, with a candidate on each."""
    rng = np.random.default_rng(7)
    x, y = np.array([[-2.1, 1.9]]), np.array([[0.2, -0.1]])
    frames = overlaps.noisy(rng, overlaps.expected_frames(x, y, np.array([[900.0, 700.0]])))
    middle = overlaps.MIDDLE
    candidates = np.array([[0, middle, middle - 2], [0, middle, middle + 2]], np.int32)
    return frames, candidates, np.stack([x[0], y[0]], axis=1)


def test_neighbours_keep_one_row_each():
    frames, candidates, truth = both()
    _, _, joint = overlaps.resolved(frames, candidates)
    assert joint.owners.tolist() == [0, 1]
    assert joint.flags.tolist() == [FitFlag.JOINT, FitFlag.JOINT]
    sd = joint.results[5:7].T
    assert (np.abs(overlaps.positions(joint, candidates) - truth) < 4 * sd).all()


def test_an_emitter_belongs_to_the_nearest_candidate():
    frames, candidates, truth = both()
    # Of the second spot's light, the first window sees enough to find it by itself.
    _, _, alone = overlaps.resolved(frames, candidates[:1])
    assert alone.owners.tolist() == [0, 0]
    assert np.abs(overlaps.positions(alone, candidates) - truth).max() < 0.4


def test_two_candidates_on_one_spot_give_one_row():
    rng = np.random.default_rng(8)
    x, y = rng.uniform(-0.3, 0.3, (2, 200, 1))
    frames = overlaps.noisy(rng, overlaps.expected_frames(x, y, np.full((200, 1), 800.0)))
    middle = overlaps.MIDDLE
    candidates = np.array(
        [[k, middle, middle + side] for k in range(200) for side in (-1, 1)], np.int32
    )
    joint = overlaps.resolved(frames, candidates)[2]
    good = joint.flags & FIT_FAILED == 0
    kept = np.bincount(candidates[joint.owners[good], 0], minlength=200)
    assert (kept == 1).mean() >= 0.98
    assert kept.min() == 1
    assert kept.max() <= 2


def test_three_emitters_need_three():
    rng = np.random.default_rng(9)
    x = np.tile([-2.2, 0.5, 2.3], (50, 1))
    y = np.tile([-0.6, 0.7, -1.2], (50, 1))
    frames = overlaps.noisy(rng, overlaps.expected_frames(x, y, np.full((50, 3), 2000.0)))
    candidates = overlaps.brightest(frames)
    rows = {
        most: np.bincount(overlaps.resolved(frames, candidates, most=most)[2].owners, minlength=50)
        for most in (2, 3)
    }
    assert (rows[3] == 3).mean() >= 0.9
    assert rows[2].max() <= 2


def test_a_fixed_width_stays():
    frames, candidates, _ = both()
    joint = overlaps.resolved(frames, candidates, sigma=overlaps.SIGMA_PX, free=False)[2]
    assert (joint.results[4] == overlaps.SIGMA_PX).all()


def some_film(rng, frames=12):
    """Frames of three emitters anywhere, with candidates at two of them."""
    x, y = rng.uniform(-5, 5, (2, frames, 3))
    film = overlaps.noisy(rng, overlaps.expected_frames(x, y, rng.uniform(300, 2000, (frames, 3))))
    found = {
        (k, overlaps.MIDDLE + round(y[k, e]), overlaps.MIDDLE + round(x[k, e]))
        for k in range(frames)
        for e in range(2)
    }
    return film, np.array(sorted(found), np.int32)


@given(st.integers(0, 2**31))
@settings(max_examples=15, deadline=None)
def test_a_frame_does_not_depend_on_the_others(seed):
    film, candidates = some_film(np.random.default_rng(seed))
    together = overlaps.resolved(film, candidates)[2]
    for frame in range(len(film)):
        mine = np.flatnonzero(candidates[:, 0] == frame)
        alone = candidates[mine].copy()
        alone[:, 0] = 0
        joint = overlaps.resolved(film[frame : frame + 1], alone)[2]
        rows = np.isin(together.owners, mine)
        assert (mine[joint.owners] == together.owners[rows]).all()
        assert joint.results.tobytes() == together.results[:, rows].tobytes()
        assert (joint.flags == together.flags[rows]).all()


@given(st.integers(0, 2**31))
@settings(max_examples=15, deadline=None)
def test_no_emitter_is_reported_twice_and_good_rows_are_numbers(seed):
    film, candidates = some_film(np.random.default_rng(seed))
    joint = overlaps.resolved(film, candidates)[2]
    assert (np.diff(joint.owners) >= 0).all()
    assert set(joint.owners) == set(range(len(candidates)))
    good = (joint.flags & FIT_FAILED == 0) & (joint.flags & FitFlag.JOINT != 0)
    assert np.isfinite(joint.results[:, good]).all()
    frame = candidates[joint.owners, 0]
    place = overlaps.positions(joint, candidates)
    for k in np.flatnonzero(joint.flags & FIT_FAILED == 0):
        others = (frame == frame[k]) & (joint.flags & FIT_FAILED == 0)
        others[k] = False
        apart = np.hypot(*(place[others] - place[k]).T)
        assert (apart > 0.5 * joint.results[4, k]).all()


@given(st.integers(0, 2**31))
@settings(max_examples=10, deadline=None)
def test_a_mirrored_film_gives_mirrored_rows(seed):
    film, candidates = some_film(np.random.default_rng(seed))
    joint = overlaps.resolved(film, candidates)[2]
    mirrored = candidates.copy()
    mirrored[:, 2] = overlaps.SIZE - 1 - candidates[:, 2]
    order = np.lexsort(mirrored.T[::-1])
    other = overlaps.resolved(np.ascontiguousarray(film[:, :, ::-1]), mirrored[order])[2]
    assert len(other.owners) == len(joint.owners)
    there = np.column_stack([joint.owners, overlaps.positions(joint, candidates)])
    back = np.column_stack([order[other.owners], overlaps.positions(other, mirrored[order])])
    back[:, 1] *= -1
    there, back = (rows[np.lexsort(np.round(rows, 2).T)] for rows in (there, back))
    close = np.abs(there - back) < 5e-3
    # Ties between equally near candidates go by order, which a mirror turns round.
    assert close.all(axis=1).mean() >= 0.9


def test_a_pair_at_the_border_and_beside_dead_pixels_is_found():
    rng = np.random.default_rng(10)
    n = 100
    x, y, light = overlaps.some_pairs(rng, n, 2.2, (1500.0, 1500.0))
    frames = overlaps.noisy(rng, overlaps.expected_frames(x, y, light))
    candidates = overlaps.brightest(frames)
    # The border runs two pixels from the middle; a few pixels have no number, one is dead.
    cut = overlaps.MIDDLE - 2
    clipped = np.ascontiguousarray(frames[:, :, cut:])
    clipped[:, overlaps.MIDDLE + 2, 4] = np.nan
    candidates[:, 2] -= cut
    noise = np.full(clipped.shape[1:], overlaps.READ_NOISE_E)
    arrays = overlaps.camera(noise)
    arrays.variance_e2[overlaps.MIDDLE - 2, 1] = np.inf
    joint = overlaps.resolved(clipped, candidates, arrays=arrays)[2]
    candidates[:, 2] += cut
    errors, sd = overlaps.pair_errors(joint, candidates, x, y)
    assert len(errors) >= 0.85 * n
    assert 0.85 <= overlaps.rms(errors / sd) <= 1.2
    remarks = FitFlag.CLIPPED | FitFlag.MASKED_PIXELS
    assert (joint.flags & FitFlag.CLIPPED != 0).mean() > 0.9
    assert (joint.flags & ~(remarks | FitFlag.JOINT) == 0).mean() > 0.9


@pytest.mark.parametrize("value", [0.0, -50.0, 1e6, np.nan])
def test_hopeless_windows_keep_their_rows(value):
    frames = np.full((2, 21, 21), value, np.float32)
    frames[1, 10, 10] = 3e4
    candidates = np.array([[0, 10, 10], [1, 0, 0], [1, 10, 10], [1, 10, 12], [1, 20, 20]], np.int32)
    results, _, joint = overlaps.resolved(frames, candidates)
    assert joint.owners.tolist() == [0, 1, 2, 3, 4]
    unchanged = joint.flags & FitFlag.JOINT == 0
    np.testing.assert_array_equal(joint.results[:, unchanged], results[:, unchanged])


def test_saturated_and_failed_single_fits_are_left_alone():
    rng = np.random.default_rng(12)
    x, y, light = overlaps.some_pairs(rng, 2, 2.5, (2000.0, 2000.0))
    frames = overlaps.noisy(rng, overlaps.expected_frames(x, y, light))
    candidates = overlaps.brightest(frames)
    results, flags = overlaps.single_fits(frames, overlaps.camera(), candidates)
    flags[:] = FitFlag.SATURATED, FitFlag.LEFT_WINDOW
    options = {"max_emitters": 3, "sigma_px": 1.6, "free_sigma": True}
    joint = resolve(frames, overlaps.camera(), candidates, results, flags, 3, **options)
    assert joint.tried == 0
    assert (joint.flags == flags).all()
    np.testing.assert_array_equal(joint.results, results)


def test_no_candidates_are_no_rows():
    frames = np.zeros((1, 21, 21), np.float32)
    joint = overlaps.resolved(frames, np.empty((0, 3), np.int32))[2]
    assert joint.results.shape == (10, 0)
    assert len(joint.flags) == len(joint.owners) == 0
