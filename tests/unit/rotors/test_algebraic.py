"""Circle fits against their definitions, solved by slower and plainer means."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import eig
from scipy.optimize import least_squares

from rotortrack.rotors.algebraic import algebraic_circle, geometric_circle
from rotortrack.rotors.circle import CircleEnd, fit_circle
from rotortrack.tradeoff.questions.circle import Rotor, positions


def constraint(method, z, x, y):
    taubin = np.array([[4 * z, 2 * x, 2 * y, 0], [2 * x, 1, 0, 0], [2 * y, 0, 1, 0], [0, 0, 0, 0]])
    pratt = np.array([[0, 0, 0, -2.0], [0, 1, 0, 0], [0, 0, 1, 0], [-2, 0, 0, 0]])
    return {"taubin": taubin, "pratt": pratt, "hyper": 2 * taubin - pratt}[method]


def by_moments(x, y, weights, method):
    """Solve M a = eta N a for the smallest positive eta, with the moment matrix itself."""
    z = x * x + y * y
    data = np.column_stack((z, x, y, np.ones_like(x)))
    weights = weights / weights.sum()
    eta, vectors = eig(
        data.T @ (weights[:, None] * data),
        constraint(method, weights @ z, weights @ x, weights @ y),
    )
    usable = np.isfinite(eta) & (eta.real > 0.0)
    a, b, c, d = vectors[:, np.flatnonzero(usable)[np.argmin(eta.real[usable])]].real
    centre = -b / (2 * a), -c / (2 * a)
    return *centre, math.sqrt(centre[0] ** 2 + centre[1] ** 2 - d / a)


def scaled(ring, seed, arc_deg):
    x, y = ring(np.random.default_rng(seed), 300, 1.0, 0.1, arc_deg)
    x, y = x - x.mean(), y - y.mean()
    scale = math.sqrt(np.mean(x * x + y * y))
    return x / scale, y / scale


@pytest.mark.parametrize("method", ["hyper", "pratt", "taubin"])
@pytest.mark.parametrize("arc_deg", [90.0, 200.0, 360.0])
def test_fits_solve_their_generalised_eigenvalue_problem(ring, method, arc_deg):
    x, y = scaled(ring, 1, arc_deg)
    weights = np.random.default_rng(2).uniform(0.2, 1.0, x.size)
    expected = by_moments(x, y, weights, method)
    assert algebraic_circle(x, y, weights, method) == pytest.approx(expected, rel=1e-8, abs=1e-8)


def test_kasa_minimises_the_plain_algebraic_distance(ring):
    x, y = scaled(ring, 3, 200.0)
    weights = np.random.default_rng(4).uniform(0.2, 1.0, x.size)
    a, b, radius = algebraic_circle(x, y, weights, "kasa")

    def distance(circle):
        return np.sqrt(weights) * ((x - circle[0]) ** 2 + (y - circle[1]) ** 2 - circle[2] ** 2)

    best = least_squares(distance, [0.0, 0.0, 1.0], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    assert (a, b, radius) == pytest.approx(tuple(best), abs=1e-6)


@pytest.mark.parametrize("arc_deg", [90.0, 200.0, 360.0])
def test_geometric_fit_reaches_the_least_squares_optimum(ring, arc_deg):
    x, y = scaled(ring, 5, arc_deg)
    weights = np.random.default_rng(6).uniform(0.2, 1.0, x.size)

    def distance(circle):
        return np.sqrt(weights) * (np.hypot(x - circle[0], y - circle[1]) - circle[2])

    start = algebraic_circle(x, y, weights, "taubin")
    best = least_squares(distance, start, xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    assert geometric_circle(x, y, weights, start) == pytest.approx(tuple(best), abs=1e-6)


def test_weight_zero_means_absent(ring):
    x, y = scaled(ring, 7, 360.0)
    weights = np.ones_like(x)
    weights[:20] = 0.0
    far = x.copy()
    far[:20] += 50.0
    for method in ("hyper", "kasa", "pratt", "taubin"):
        alone = algebraic_circle(x[20:], y[20:], np.ones(x.size - 20), method)
        assert algebraic_circle(far, y, weights, method) == pytest.approx(alone, rel=1e-6, abs=1e-9)


def test_a_geometric_fit_that_strays_to_infinity_ends():
    # Spots elsewhere pull the centre so far away that the normal matrix has no inverse.
    rng = np.random.default_rng((360, 125, 1))
    rotor = Rotor(1000, 360.0, 0.125, 0.03)
    for _ in range(2):
        x, y = positions(rotor, rng)
    fit = fit_circle(x, y, "geometric")
    assert fit.end is not CircleEnd.FITTED
    assert math.isfinite(fit.x_nm)
    assert math.isfinite(fit.y_nm)
