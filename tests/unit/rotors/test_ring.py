"""Evidence for a ring against a blob."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import rayleigh, rice

from rotortrack.rotors.ring import ring_evidence


@pytest.mark.parametrize("n", [100, 2000])
def test_a_blob_is_never_called_a_ring(n):
    rng = np.random.default_rng(1)
    evidence = [ring_evidence(*rng.normal(0.0, 12.0, (2, n)), 0.0, 0.0) for _ in range(100)]
    assert np.mean(np.array(evidence) > 6.0) <= 0.01


@pytest.mark.parametrize(("n", "ratio"), [(2000, 1.6), (500, 1.8), (100, 3.0)])
def test_rings_are_recognised_from_the_known_sizes_on(ring, n, ratio):
    rng = np.random.default_rng(2)
    evidence = [ring_evidence(*ring(rng, n, 10.0 * ratio, 10.0), 0.0, 0.0) for _ in range(40)]
    assert np.mean(np.array(evidence) > 6.0) >= 0.95


def test_where_on_its_ring_a_rotor_dwells_does_not_matter(ring):
    rng = np.random.default_rng(3)
    dwelling = np.hstack((ring(rng, 900, 100.0, 10.0, 60.0), ring(rng, 100, 100.0, 10.0)))
    assert ring_evidence(*dwelling, 0.0, 0.0) > 1000.0


def test_scale_and_far_background_do_not_matter(ring):
    x, y = ring(np.random.default_rng(4), 400, 50.0, 20.0)
    plain = ring_evidence(x, y, 0.0, 0.0)
    assert ring_evidence(1e6 * x, 1e6 * y, 0.0, 0.0) == pytest.approx(plain, rel=1e-3)
    far = np.append(x, [900.0] * 4), np.append(y, [900.0] * 4)
    assert ring_evidence(*far, 0.0, 0.0) == pytest.approx(plain, rel=1e-3)


def test_evidence_is_the_gain_of_a_two_parameter_rice_fit(ring):
    x, y = ring(np.random.default_rng(5), 600, 25.0, 10.0)
    r = np.hypot(x, y)

    def cost(parameters):
        radius, noise = np.exp(parameters)
        return -rice.logpdf(r, radius / noise, scale=noise).sum()

    best = minimize(cost, np.log([20.0, 15.0]), method="Nelder-Mead").fun
    blob = -rayleigh.logpdf(r, scale=np.sqrt(np.mean(r * r) / 2.0)).sum()
    expected = 2.0 * (blob - best) - math.log(600)
    assert ring_evidence(x, y, 0.0, 0.0) == pytest.approx(expected, abs=1e-3)


def test_too_few_or_identical_positions_say_nothing():
    assert math.isnan(ring_evidence(np.arange(9.0), np.arange(9.0), 0.0, 0.0))
    assert math.isnan(ring_evidence(np.ones(50), np.ones(50), 1.0, 1.0))
