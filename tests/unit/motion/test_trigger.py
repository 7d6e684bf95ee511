import numpy as np
import pytest

from rotortrack.errors import InputError
from rotortrack.motion.trigger import frame_clock, rising_edges

FRAME_S = 0.002
RATE = 20_000.0


def trigger(starts_s, *, high_s=0.001, noise_v=0.05, extra_s=(), ringing_v=0.0, seed=0):
    """A TTL signal with a pulse at each start, sampled at RATE from 0 on."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(round((max(starts_s) + 0.02) * RATE)) / RATE
    volts = np.zeros(time_s.size)
    for start in starts_s:
        pulse = slice(*np.searchsorted(time_s, [start, start + high_s]))
        volts[pulse] = 5.0
        volts[pulse][1:2] -= ringing_v
    for start in extra_s:
        volts[slice(*np.searchsorted(time_s, [start, start + 2.5 / RATE]))] = 5.0
    return time_s, volts + rng.normal(0.0, noise_v, time_s.size)


def starts(n=2000, lead_s=0.0103, ppm=0.0):
    return lead_s + np.arange(n) * FRAME_S * (1 + 1e-6 * ppm)


def clock_of(*args, **kwargs):
    return frame_clock(rising_edges(*trigger(*args, **kwargs)))


def within_a_sample(clock, expected):
    assert clock.time_s.size == expected.size
    assert np.abs(clock.time_s - expected).max() < 1.1 / RATE


@pytest.mark.parametrize("high_s", [0.00015, 0.001, 0.00185])
def test_edges_are_timed_within_a_sample_whatever_the_duty(high_s):
    within_a_sample(clock_of(starts(), high_s=high_s), starts())


def test_ringing_and_noise_make_no_edges():
    clock = clock_of(starts(), ringing_v=2.4, noise_v=0.2)
    within_a_sample(clock, starts())
    assert (clock.missed, clock.extra, clock.pauses) == (0, 0, 0)


def test_a_spike_does_not_move_the_levels():
    time_s, volts = trigger(starts())
    volts[1234] = 60.0
    volts[5678] = -40.0
    assert frame_clock(rising_edges(time_s, volts)).missed == 0


@pytest.mark.parametrize("ppm", [-100.0, 100.0, 900.0])
def test_drift_of_the_clocks_is_followed_and_measured(ppm):
    expected = starts(8000, ppm=ppm)
    clock = clock_of(expected)
    within_a_sample(clock, expected)
    assert clock.ppm_off(FRAME_S) == pytest.approx(ppm, abs=3.0)


def test_missed_edges_are_counted_and_filled_in_place():
    expected = starts()
    clock = clock_of(np.delete(expected, [5, 700, 701, 702, 1500]))
    assert (clock.missed, clock.extra) == (5, 0)
    within_a_sample(clock, expected)


def test_extra_edges_between_frames_are_left_out():
    expected = starts()
    clock = clock_of(expected, extra_s=expected[[3, 900]] + [0.0013, 0.0015])
    assert (clock.missed, clock.extra) == (0, 2)
    within_a_sample(clock, expected)


def test_an_extra_edge_before_the_first_frame_is_no_frame():
    clock = clock_of(starts(), extra_s=[0.0095])
    assert clock.extra == 1
    within_a_sample(clock, starts())


def test_a_cut_off_first_edge_is_frame_0_one_period_before_the_next():
    expected = starts(lead_s=-0.0004)
    clock = clock_of(expected)
    assert clock.starts_high
    within_a_sample(clock, expected)


def test_a_pause_of_no_whole_number_of_frames_does_not_shift_the_frames_after_it():
    expected = starts()
    expected[1200:] += 0.00731
    clock = clock_of(expected)
    assert (clock.pauses, clock.missed) == (1, 0)
    within_a_sample(clock, expected)
    assert abs(clock.ppm_off(FRAME_S)) < 5.0


def test_frames_at_times_count_on_beyond_both_ends():
    clock = clock_of(starts(100))
    at = clock.frame_at(starts(100)[[0, 10, 99]] + [-0.004, 0.001, 0.006])
    assert at == pytest.approx([-2.0, 10.5, 102.0], abs=0.05)


@pytest.mark.parametrize(
    "volts",
    [
        np.full(1000, 5.0),
        np.random.default_rng(0).normal(0, 1, 1000),
        np.where(np.arange(1000) < 500, 0.0, 5.0),
    ],
    ids=["constant", "noise", "one edge"],
)
def test_what_is_no_trigger_is_refused(volts):
    with pytest.raises(InputError, match="exposure output"):
        frame_clock(rising_edges(np.arange(1000) / RATE, volts))


def test_edges_at_random_are_refused():
    random = np.cumsum(np.random.default_rng(1).exponential(0.004, 300)) + 0.01
    with pytest.raises(InputError, match="common pace"):
        clock_of(random, high_s=0.0002)
