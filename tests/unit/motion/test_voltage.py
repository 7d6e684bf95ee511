import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.motion.trigger import FrameClock
from rotortrack.motion.voltage import VoltageSteps, frame_voltages, voltage_steps

NO_STEPS = VoltageSteps(*(np.empty(0),) * 4)


def clock(starts_s):
    return FrameClock(np.asarray(starts_s, float), 0.002, 0, 0, 0, starts_high=False)


def per_frame(time_s, volts, starts_s, *, steps=NO_STEPS, exposure_s=0.002, **options):
    options = {"n_frames": len(starts_s), **options}
    return frame_voltages(time_s, volts, clock(starts_s), steps, exposure_s=exposure_s, **options)


@settings(deadline=None)
@given(seed=st.integers(0, 1000))
def test_means_and_extremes_are_those_of_the_polygon_through_the_samples(seed):
    rng = np.random.default_rng(seed)
    time_s = np.cumsum(rng.uniform(0.0001, 0.003, 60))
    volts = rng.normal(0.1, 1.0, 60)
    starts = rng.uniform(time_s[0], time_s[-1] - 0.004, 5)
    found = per_frame(time_s, volts, starts, exposure_s=0.004)
    for k, start in enumerate(starts):
        inside = time_s[(time_s > start) & (time_s < start + 0.004)]
        corners = np.concatenate([[start], inside, [start + 0.004]])
        values = np.interp(corners, time_s, volts)
        assert found.mean_v[k] == pytest.approx(np.trapezoid(values, corners) / 0.004, abs=1e-9)
        assert found.min_v[k] == pytest.approx(values.min())
        assert found.max_v[k] == pytest.approx(values.max())


def test_a_change_within_the_exposure_is_a_transition_and_one_in_the_dead_time_is_not():
    time_s = np.arange(10_000) / 1e5
    volts = np.where(time_s < 0.0207, 0.1, 0.2)
    starts = np.arange(40) * 0.002
    steps = VoltageSteps(
        np.array([0.0, 0.0207]), np.array([0.0207, 0.1]), np.array([0.1, 0.2]), np.zeros(2)
    )
    full = per_frame(time_s, volts, starts, steps=steps)
    assert np.flatnonzero(full.transition).tolist() == [10]
    assert full.mean_v[10] == pytest.approx(0.1 * 0.35 + 0.2 * 0.65, abs=1e-3)
    assert (full.min_v[10], full.max_v[10]) == (0.1, 0.2)
    short = per_frame(time_s, volts, starts, steps=steps, exposure_s=0.0006)
    assert not short.transition.any()
    assert short.step.tolist() == [0] * 11 + [1] * 29


def test_frames_beyond_the_trace_or_the_edges_have_no_voltage():
    time_s = np.arange(1000) / 1e4
    found = per_frame(time_s, np.ones(1000), np.arange(60) * 0.002, n_frames=70)
    assert np.isnan(found.mean_v[49:]).all()
    assert np.isfinite(found.mean_v[:49]).all()
    assert found.transition[49:].all()


def test_edges_before_the_movie_are_skipped():
    time_s = np.arange(1000) / 1e4
    found = per_frame(time_s, time_s, np.arange(40) * 0.002, n_frames=30, first_edge=5)
    assert found.mean_v[0] == pytest.approx(0.011, abs=1e-9)


def trace(volts, seed=0, noise_v=0.003, hum_v=0.0, seconds=20.0):
    time_s = np.arange(round(seconds * 1e4)) / 1e4
    noise = np.random.default_rng(seed).normal(0, noise_v, time_s.size)
    return time_s, volts(time_s) + noise + hum_v * np.sin(2 * np.pi * 50 * time_s)


def test_steps_are_found_within_a_millisecond_under_noise_and_hum():
    levels = [0.1, 0.2, 0.1, -0.1]
    for hum_v in (0.0, 0.02):
        found = voltage_steps(
            *trace(lambda t: np.choose((t / 5.0).astype(int), levels), hum_v=hum_v), min_step_s=0.2
        )
        assert found.voltage_v == pytest.approx(levels, abs=1e-3)
        assert found.start_s == pytest.approx([0, 5, 10, 15], abs=1e-3)
        assert found.stop_s == pytest.approx([5, 10, 15, 20], abs=1e-3)


def test_a_slow_change_is_left_out_until_it_has_settled():
    found = voltage_steps(
        *trace(
            lambda t: 0.1 + 0.1 * np.where(t > 8, 1 - np.exp(-(t - 8) / 0.03), 0), noise_v=0.001
        ),
        min_step_s=0.2,
    )
    assert len(found) == 2
    assert found.stop_s[0] == pytest.approx(8.0, abs=0.003)
    # Settled within 5 % after three time constants.
    assert found.start_s[1] == pytest.approx(8.09, abs=0.02)


@pytest.mark.parametrize("noise_v", [0.0, 0.01])
def test_a_constant_voltage_is_one_step(noise_v):
    found = voltage_steps(*trace(lambda t: np.full(t.size, 0.1), noise_v=noise_v), min_step_s=0.2)
    assert len(found) == 1
    assert found.voltage_v[0] == pytest.approx(0.1, abs=1e-3)


def test_a_ramp_is_no_step():
    found = voltage_steps(*trace(lambda t: 0.1 + 0.01 * t), min_step_s=0.2)
    assert len(found) == 0


def test_a_pulse_shorter_than_the_least_step_is_none():
    found = voltage_steps(
        *trace(lambda t: np.where((t > 8) & (t < 8.05), 1.0, 0.1)), min_step_s=0.5
    )
    assert found.voltage_v == pytest.approx([0.1, 0.1], abs=0.01)
    assert found.stop_s[0] <= 8.001
    assert found.start_s[1] >= 8.049
