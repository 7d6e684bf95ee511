"""The stage: drift by its three parts and a file, and vibration."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.film import stage as module
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.options import DriftOptions, VibrationOptions
from rotortrack.simulate.film.stage import Stage

T = 0.002


def drift_of(n_frames, seed=5, **options):
    clock = Clock(n_frames, T, T)
    return Stage(DriftOptions(**options), None, clock, seed).advance(n_frames)


@pytest.fixture
def no_draws(monkeypatch):
    def refuse(*_):
        raise AssertionError("a stream was asked for")

    monkeypatch.setattr(module, "stream", refuse)


@pytest.mark.usefixtures("no_draws")
def test_a_stage_that_only_vibrates_does_not_drift():
    stage = Stage(None, VibrationOptions(), Clock(9, T, T), 1)
    assert stage.advance(9) is None


@pytest.mark.usefixtures("no_draws")
def test_a_stage_that_only_drifts_does_not_vibrate():
    assert Stage(DriftOptions(), None, Clock(9, T, T), 1).vibration_nm(np.zeros((9, 2))) is None


@pytest.mark.usefixtures("no_draws")
def test_even_drift_goes_from_nothing_to_all_of_it():
    moved = drift_of(101, total_nm=(50.0, -20.0))
    np.testing.assert_allclose(moved, np.linspace([0.0, 0.0], [50.0, -20.0], 101), atol=1e-12)


@pytest.mark.usefixtures("no_draws")
def test_a_film_of_one_frame_does_not_drift():
    np.testing.assert_array_equal(drift_of(1, total_nm=(50.0, -20.0)), [[0.0, 0.0]])


@pytest.mark.usefixtures("no_draws")
@pytest.mark.parametrize("interval_s", [0.002, 0.1, 1.0 / 30.0])
def test_a_step_comes_with_the_frame_that_begins_then(interval_s):
    for frame in range(300):
        for step_s in (frame * interval_s, float(f"{frame * interval_s:.12g}")):
            options = DriftOptions(step_nm=(30.0, -7.0), step_s=step_s)
            moved = Stage(options, None, Clock(301, interval_s, 0.0), 1).advance(301)
            np.testing.assert_array_equal(moved[:frame], 0.0)
            np.testing.assert_array_equal(moved[frame:] - [30.0, -7.0], 0.0)


def test_the_walk_has_the_variance_of_its_steps():
    seeds, frames, step_nm = 600, 64, 1.5
    walks = np.array([drift_of(frames, seed, walk_nm=step_nm) for seed in range(seeds)])
    np.testing.assert_array_equal(walks[:, 0], 0.0)
    steps = np.diff(walks, axis=1)
    error = 5.0 * math.sqrt(2.0 / steps[..., 0].size)
    np.testing.assert_allclose(steps.var(axis=(0, 1)), step_nm**2, rtol=error)
    for frame in (1, 7, 63):
        spread = walks[:, frame].var(axis=0)
        np.testing.assert_allclose(spread, frame * step_nm**2, rtol=5.0 * math.sqrt(2.0 / seeds))
    across = (steps[..., 0] * steps[..., 1]).mean() / step_nm**2
    assert across == pytest.approx(0.0, abs=5.0 / math.sqrt(steps[..., 0].size))


def test_parts_of_a_drift_add_up_and_change_no_other():
    walk = drift_of(200, walk_nm=2.0)
    even = drift_of(200, total_nm=(9.0, 4.0))
    step = drift_of(200, step_nm=(5.0, -5.0), step_s=0.1)
    both = drift_of(200, walk_nm=2.0, total_nm=(9.0, 4.0), step_nm=(5.0, -5.0), step_s=0.1)
    np.testing.assert_allclose(both, walk + even + step, atol=1e-12)


@settings(max_examples=40)
@given(cuts=st.lists(st.integers(1, 199), max_size=12, unique=True))
def test_blocks_do_not_change_a_bit(cuts):
    options = DriftOptions(walk_nm=2.0, total_nm=(9.0, 4.0), step_nm=(5.0, -5.0), step_s=0.1)
    clock = Clock(200, T, T)
    stage = Stage(options, None, clock, 5)
    pieces = [stage.advance(after - before) for before, after in pairwise([0, *sorted(cuts), 200])]
    whole = Stage(options, None, clock, 5).advance(200)
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


def test_a_file_of_drift_is_added(tmp_path):
    path = tmp_path / "drift.csv"
    # Not in order, and longer than the film.
    path.write_text("frame,dx_nm,dy_nm\n2,5,6\n0,1,2\n1,3,4\n3,7,8\n")
    moved = drift_of(3, table=str(path), total_nm=(2.0, 0.0))
    np.testing.assert_array_equal(moved, [[1.0, 2.0], [4.0, 4.0], [7.0, 6.0]])


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        ("0,1,2\n2,1,2\n", r"does not tell frame 1 \(1 of 3 frames are missing\)"),
        ("0,1,2\n1,1,2\n1,3,4\n2,5,6\n", "tells frame 1 twice"),
        ("0,1,2\n1,nan,2\n2,5,6\n", "no finite dx_nm and dy_nm in frame 1"),
        ("0,1,2\n1,1,2\n2,5,inf\n", "no finite dx_nm and dy_nm in frame 2"),
    ],
)
def test_files_that_do_not_tell_every_frame_once_are_refused(tmp_path, rows, complaint):
    path = tmp_path / "drift.csv"
    path.write_text("frame,dx_nm,dy_nm\n" + rows)
    with pytest.raises(ConfigurationError, match=complaint):
        drift_of(3, table=str(path))


def vibration_of(times_s, lasts_s=0.0, **options):
    return Stage(None, VibrationOptions(**options), Clock(9, T, T), 1).vibration_nm(
        times_s, lasts_s
    )


@pytest.mark.usefixtures("no_draws")
def test_vibration_is_a_sine_along_its_direction():
    times_s = np.linspace(0.0, 0.04, 81)[np.newaxis]
    x_nm, y_nm = vibration_of(times_s, amplitude_nm=8.0, frequency_hz=50.0, direction_deg=30.0)
    assert x_nm.shape == y_nm.shape == times_s.shape
    swing = 8.0 * np.sin(2.0 * math.pi * 50.0 * times_s)
    np.testing.assert_allclose(x_nm, swing * math.sqrt(0.75), atol=1e-12)
    # Counter-clockwise on the image, on which y points down.
    np.testing.assert_allclose(y_nm, -0.5 * swing, atol=1e-12)


@pytest.mark.usefixtures("no_draws")
@pytest.mark.parametrize("parts", [1, 3, 40])
def test_an_exposure_sees_the_mean_vibration_whatever_its_parts(parts):
    begin_s, exposure_s, w = 0.0123, 0.017, 2.0 * math.pi * 73.0
    part_s = exposure_s / parts
    middles_s = begin_s + part_s * (np.arange(parts) + 0.5)
    x_nm, _ = vibration_of(middles_s, part_s, amplitude_nm=10.0, frequency_hz=73.0)
    end_s = begin_s + exposure_s
    mean = 10.0 * (math.cos(w * begin_s) - math.cos(w * end_s)) / (w * exposure_s)
    assert x_nm.mean() == pytest.approx(mean, rel=1e-10)
