"""Random paths: the law of all means together, and one path whatever the segments."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.rotor import Rotor
from rotortrack.simulate.film.wander import Breathing, Brownian, Streams, Wobble

D, SD = 0.7, 0.8
RATE = D / SD**2


class Given:
    """A generator that hands out prepared numbers."""

    def __init__(self, values):
        self.values = list(values)

    def standard_normal(self, shape=None):
        count = 1 if shape is None else math.prod(np.atleast_1d(shape))
        taken, self.values = self.values[:count], self.values[count:]
        return taken[0] if shape is None else np.array(taken).reshape(shape)


def linear_map(process, lengths_s, n):
    """How the means of n periods depend on every number that is drawn."""
    periods = n + (process is Wobble)
    within = 2 * n * len(lengths_s)
    columns = []
    for unit in np.eye(periods + within):
        streams = Streams(Given(unit[:periods]), Given(unit[periods:]))
        if process is Wobble:
            walk = Wobble(SD, D, np.array(lengths_s), streams)
        else:
            walk = Brownian(D, np.array(lengths_s), streams)
        columns.append(walk.advance(n).ravel())
    return np.array(columns).T


def brownian_double_integral(s, t):
    """Integral of 2 D min(u, v) over 0 < u < s and 0 < v < t."""
    low, high = min(s, t), max(s, t)
    return 2.0 * D * (low**2 * high / 2.0 - low**3 / 6.0)


def wobble_double_integral(s, t):
    """The same of SD^2 exp(-RATE |u - v|)."""

    def g(x):
        return (RATE * abs(x) + math.exp(-RATE * abs(x)) - 1.0) / RATE**2

    return SD**2 * (g(s) + g(t) - g(s - t))


@pytest.mark.parametrize("process", [Brownian, Wobble])
@pytest.mark.parametrize("lengths_s", [(0.3,), (0.5, 0.2), (0.1, 0.4, 0.05, 0.9), (1e-5, 0.3)])
def test_all_means_together_have_the_covariances_of_the_process(process, lengths_s):
    n = 3
    mapped = linear_map(process, lengths_s, n)
    area = brownian_double_integral if process is Brownian else wobble_double_integral
    ends = np.concatenate([[0.0], np.cumsum(np.tile(lengths_s, n))])
    spans = list(itertools.pairwise(ends.tolist()))
    expected = [
        [
            (area(b, d) - area(a, d) - area(b, c) + area(a, c)) / ((b - a) * (d - c))
            for c, d in spans
        ]
        for a, b in spans
    ]
    np.testing.assert_allclose(mapped @ mapped.T, expected, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("process", [Brownian, Wobble])
def test_instants_have_the_covariances_of_the_process(process):
    mapped = linear_map(process, (0.0, 0.2, 0.0, 0.3), 3)[[0, 2, 4, 6, 8, 10]]
    times = np.array([0.0, 0.2, 0.5, 0.7, 1.0, 1.2])
    if process is Brownian:
        expected = 2.0 * D * np.minimum.outer(times, times)
    else:
        expected = SD**2 * np.exp(-RATE * np.abs(np.subtract.outer(times, times)))
    np.testing.assert_allclose(mapped @ mapped.T, expected, atol=1e-12)


@pytest.mark.parametrize("process", [Brownian, Wobble])
def test_the_path_from_period_to_period_does_not_depend_on_the_segments(process):
    def at_beginnings(inside_s):
        streams = Streams(np.random.default_rng(3), np.random.default_rng(4))
        lengths_s = np.array([0.0, *inside_s])
        walk = process(*((D,) if process is Brownian else (SD, D)), lengths_s, streams)
        return walk.advance(50)[:, 0]

    np.testing.assert_allclose(
        at_beginnings([0.5]), at_beginnings([0.1, 0.15, 0.05, 0.2]), rtol=1e-9, atol=1e-12
    )


def rotor(breathing_time_s):
    return Rotor(
        **{"number": 0, "pore": 0, "group": 0, "motion": "stuck", "x_nm": 0.0, "y_nm": 0.0},
        **{"ends": (), "breathing_sd_nm": 4.0, "breathing_time_s": breathing_time_s},
    )


@pytest.mark.parametrize("exposure_s", [0.0, 0.01])
def test_breathing_keeps_its_spread_and_is_averaged_over_the_exposure(exposure_s):
    n, time_s = 40_000, 0.01
    out_nm = Breathing(rotor(time_s), Clock(n, 0.01, exposure_s), 8).advance(n)
    a = exposure_s / time_s
    expected = 16.0 * (2.0 * (a - 1.0 + math.exp(-a)) / a**2 if a else 1.0)
    # Frames as far apart as the correlation time count half.
    assert out_nm.var() == pytest.approx(expected, rel=5.0 * math.sqrt(2.0 / (n / 2)))
    assert out_nm.mean() == pytest.approx(0.0, abs=5.0 * math.sqrt(16.0 / (n / 2.2)))


def test_breathing_goes_on_from_block_to_block():
    clock = Clock(50, 0.01, 0.004)
    whole = Breathing(rotor(0.05), clock, 8).advance(50)
    piecewise = Breathing(rotor(0.05), clock, 8)
    pieces = [piecewise.advance(n) for n in (1, 30, 2, 17)]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)
