"""Two rotors in one pore trace two rings; nothing else that a rotor does looks so."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.rotors.circle import fit_circle
from rotortrack.rotors.two_rings import two_rings

REPEATS = 20


def ring(rng, n, radius, noise, *, away=0.0, preference=0.0, ratio=1.0, tails=0.0):
    theta = rng.vonmises(0.0, preference, n) if preference else rng.uniform(-np.pi, np.pi, n)
    sd = noise * np.exp(tails * rng.normal(size=n))
    x = away + radius * np.cos(theta) + sd * rng.normal(size=n)
    return np.stack([x, ratio * radius * np.sin(theta) + sd * rng.normal(size=n)])


def evidence(positions):
    fit = fit_circle(*positions, outlier_sd=4.0)
    return two_rings(*positions, (fit.x_nm, fit.y_nm, fit.radius_nm))


@pytest.mark.parametrize("n", [500, 5000])
@pytest.mark.parametrize(
    "kind",
    [{"noise": 10.0}, {"noise": 40.0}, {"noise": 20.0, "preference": 1.0},
     {"noise": 12.0, "ratio": 0.8}, {"noise": 15.0, "tails": 0.4}],
)  # fmt: skip
def test_one_ring_is_never_two(n, kind):
    rng = np.random.default_rng(1)
    found = [evidence(ring(rng, n, 100.0, **kind)) for _ in range(REPEATS)]
    assert max(found) <= 6.0


def test_background_is_no_second_ring():
    rng = np.random.default_rng(2)
    for _ in range(REPEATS):
        spots = rng.uniform(-250.0, 250.0, (2, 100))
        assert evidence(np.hstack([ring(rng, 2000, 100.0, 20.0), spots])) <= 6.0


@pytest.mark.parametrize(
    ("share", "second"),
    [(0.5, {"radius": 140.0, "noise": 20.0}), (0.25, {"radius": 140.0, "noise": 15.0}),
     (0.5, {"radius": 80.0, "noise": 12.0, "away": 60.0})],
)  # fmt: skip
def test_two_rings_are_found(share, second):
    rng = np.random.default_rng(3)
    found = []
    for _ in range(REPEATS):
        first = ring(rng, round(600 * (1.0 - share)), 80.0, second["noise"])
        found.append(evidence(np.hstack([first, ring(rng, round(600 * share), **second)])))
    assert np.mean(np.array(found) > 6.0) >= 0.95


def test_few_positions_say_nothing():
    assert np.isnan(two_rings(np.arange(9.0), np.arange(9.0), (0.0, 0.0, 1.0)))
