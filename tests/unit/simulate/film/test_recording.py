"""What is recorded of a film is read back by the readers of real recordings."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rotortrack.motion.trigger import frame_clock, rising_edges
from rotortrack.motion.voltage import voltage_steps
from rotortrack.movies.tiff import open_movie
from rotortrack.movies.write import write_movie
from rotortrack.pipeline.voltage_run import read_trace
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.options import DroppedOptions, TimestampsOptions, VoltageOptions
from rotortrack.simulate.film.recording import LEAD_S, noted_times, recorded_frames, write_daq

CLOCK = Clock(n_frames=1000, frame_interval_s=0.002, exposure_s=0.0018)


def trace(path, options=None, clock=CLOCK, recorded=None, seed=5):
    write_daq(path, options or VoltageOptions(), clock, recorded, seed)
    return read_trace(path)


def test_frames_are_lost_as_often_as_said_or_those_that_are_named():
    clock = dataclasses.replace(CLOCK, n_frames=40_000)
    kept = recorded_frames(DroppedOptions(fraction=0.1), clock, 3)
    assert kept.shape == (40_000,)
    assert np.mean(~kept) == pytest.approx(0.1, abs=4.0 * np.sqrt(0.09 / 40_000))
    assert kept[0]
    named = recorded_frames(DroppedOptions(frames=(3, 999)), CLOCK, 3)
    np.testing.assert_array_equal(np.flatnonzero(~named), [3, 999])
    both = recorded_frames(DroppedOptions(fraction=0.1, frames=(7,)), clock, 3)
    np.testing.assert_array_equal(np.flatnonzero(both != kept), [7] if kept[7] else [])


def test_times_are_late_never_early():
    exact = noted_times(None, CLOCK, 1)
    np.testing.assert_allclose(exact, 0.002 * np.arange(1000))
    late_s = noted_times(TimestampsOptions(jitter_s=1e-4), CLOCK, 1) - exact
    assert late_s.min() >= 0.0
    assert np.sqrt(np.mean(late_s**2)) == pytest.approx(1e-4, rel=4.0 / np.sqrt(2000))


@pytest.mark.parametrize("timestamps", [None, TimestampsOptions(jitter_s=3e-4)])
def test_a_film_that_lost_frames_tells_which(tmp_path, timestamps):
    recorded = recorded_frames(DroppedOptions(fraction=0.05, frames=(400, 401, 402)), CLOCK, 2)
    frames = np.arange(1000, dtype=np.uint16)[recorded, None, None] * np.ones((4, 5), np.uint16)
    path = tmp_path / "film.ome.tif"
    times_s = noted_times(timestamps, CLOCK, 2)[recorded]
    write_movie(
        path,
        [frames[:100], frames[100:]],
        shape=frames.shape,
        pixel_size_nm=108.3,
        frame_interval_s=CLOCK.frame_interval_s,
        exposure_s=CLOCK.exposure_s,
        times_s=times_s,
    )
    with open_movie(path) as movie:
        np.testing.assert_array_equal(movie.times_s, times_s)
        np.testing.assert_array_equal(movie.numbers, np.flatnonzero(recorded))
        np.testing.assert_array_equal(movie.frames(0, len(frames))[:, 0, 0], movie.numbers)
        # The interval is measured from the times.
        assert movie.metadata["frame_interval_s"].value == pytest.approx(0.002, rel=1e-4)


def test_the_trigger_tells_each_frame_and_which_are_lost(tmp_path):
    recorded = recorded_frames(DroppedOptions(fraction=0.05), CLOCK, 4)
    recorded[-1] = True
    time_s, trigger_v, _ = trace(tmp_path / "daq.csv", recorded=recorded)
    edges = rising_edges(time_s, trigger_v)
    assert not edges.starts_high
    assert edges.time_s.size == recorded.sum()
    clock = frame_clock(edges)
    assert (clock.missed, clock.extra, clock.pauses) == ((~recorded).sum(), 0, 0)
    starts_s = LEAD_S + 0.002 * np.arange(1000)
    # An edge lies between the last low and the first high sample, in the middle but for noise.
    np.testing.assert_allclose(clock.time_s, starts_s - 5e-5, rtol=0, atol=3e-6)
    assert abs(clock.ppm_off(0.002)) < 0.5


def test_the_trace_begins_before_the_film_and_ends_after_it(tmp_path):
    time_s, trigger_v, voltage_v = trace(tmp_path / "daq.csv")
    assert time_s[0] == 0.0
    np.testing.assert_allclose(np.diff(time_s), 1e-4, rtol=1e-3)
    assert time_s[-1] == pytest.approx(2.0 + 2.0 * LEAD_S, abs=2e-4)
    outside = (time_s < LEAD_S - 2e-4) | (time_s > LEAD_S + 2.0 + 2e-4)
    assert np.abs(trigger_v[outside]).max() < 0.2
    assert voltage_v.mean() == pytest.approx(0.1, abs=4.0 * 2e-4 / np.sqrt(time_s.size))
    assert voltage_v.std() == pytest.approx(2e-4, rel=0.02)


def test_voltage_changes_at_the_time_of_the_film(tmp_path):
    options = VoltageOptions(times_s=(0.0, 0.8), voltages_mv=(50.0, 100.0))
    time_s, _, voltage_v = trace(tmp_path / "daq.csv", options)
    steps = voltage_steps(time_s, voltage_v, min_step_s=0.1)
    np.testing.assert_allclose(steps.voltage_v, [0.05, 0.1], atol=1e-4)
    assert steps.stop_s[0] - 1e-9 <= LEAD_S + 0.8 <= steps.start_s[1] + 1e-9
    assert steps.start_s[1] - steps.stop_s[0] < 0.1


def test_samples_of_a_long_fast_trace_keep_their_times(tmp_path):
    clock = Clock(n_frames=2, frame_interval_s=1.0, exposure_s=0.0)
    time_s, *_ = trace(tmp_path / "daq.csv", VoltageOptions(sample_hz=123_456.0), clock)
    # Seven digits would not do.
    np.testing.assert_allclose(np.diff(time_s), 1.0 / 123_456.0, rtol=2e-3)


def test_lost_frames_change_no_voltage(tmp_path):
    recorded = np.arange(1000) % 7 != 3
    plain = trace(tmp_path / "a.csv")
    lost = trace(tmp_path / "b.csv", recorded=recorded)
    np.testing.assert_array_equal(plain[2], lost[2])
    differs = np.abs(plain[1] - lost[1]) > 1e-3
    frame = np.floor((plain[0][differs] - LEAD_S) / 0.002 + 1e-6).astype(int)
    assert not recorded[frame].any()
