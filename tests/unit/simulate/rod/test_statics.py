"""Loads that a rod bears: what it settles to is known in closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from .steps import bent, free_rod, relax, straight

STIFFNESS = 1.380649e-2 * 300.0 * 1500.0
EDGE = 9.0
FREE_NM = 450.0 - EDGE / 2.0
"""Length of a rod clamped by its first link: the clamp is felt in the middle of that link."""


def clamped(load, dt_us=1e5, steps=40):
    x, _ = relax(straight(), free_rod(), load, held=(0, 1), dt_us=dt_us, steps=steps)
    return x


def test_cantilever_with_a_small_load_at_its_tip():
    load = np.zeros((51, 3))
    load[-1, 2] = 1e-5
    tip = clamped(load)[-1, 2]
    np.testing.assert_allclose(tip, 1e-5 * FREE_NM**3 / (3.0 * STIFFNESS), rtol=3e-4)


def test_cantilever_under_its_own_small_weight():
    weight = 1e-8
    load = np.zeros((51, 3))
    load[:, 2] = weight * EDGE
    load[-1, 2] /= 2.0
    tip = clamped(load)[-1, 2]
    np.testing.assert_allclose(tip, weight * FREE_NM**4 / (8.0 * STIFFNESS), rtol=1e-3)


@pytest.mark.parametrize("loading", [1.0, 4.0, 10.0])
def test_elastica_under_a_large_load(loading):
    """B theta'' = -P cos(theta), theta(0) = 0, theta'(L) = 0."""
    force = loading * STIFFNESS / FREE_NM**2
    s = np.linspace(0.0, 1.0, 200)
    exact = solve_bvp(
        lambda _, y: np.stack([y[1], -loading * np.cos(y[0])]),
        lambda a, b: np.array([a[0], b[1]]),
        s,
        np.stack([s, 1.0 - s]),
        tol=1e-8,
    )
    angle = exact.sol(np.linspace(0.0, 1.0, 20_001))[0]
    tip = FREE_NM * np.array([np.cos(angle).mean(), np.sin(angle).mean()])
    load = np.zeros((51, 3))
    load[-1, 2] = force
    x = clamped(load, dt_us=20.0, steps=700)
    found = x[-1, [0, 2]] - (x[0, [0, 2]] + x[1, [0, 2]]) / 2.0
    np.testing.assert_allclose(found, tip, atol=1e-3 * FREE_NM)


def growth_rate(force, shape, *, held=(), guided=()):
    """Rate at which a small deflection grows under a force along the rod, 1/us."""
    load = np.zeros((51, 3))
    load[0, 0], load[-1, 0] = force, -force
    rod = free_rod()
    dt = 0.25
    first, _ = relax(bent(shape), rod, load, held=held, guided=guided, dt_us=dt, steps=80)
    last, _ = relax(first, rod, load, held=held, guided=guided, dt_us=dt, steps=80)
    return np.log(np.abs(last[:, 2]).max() / np.abs(first[:, 2]).max()) / (80 * dt)


CRITICAL = np.pi**2 * STIFFNESS / 450.0**2
SINE = 1e-3 * np.sin(np.pi * np.linspace(0.0, 1.0, 51))


def test_critical_force_is_0_303_pn():
    np.testing.assert_allclose(CRITICAL, 0.303, rtol=2e-3)


def test_pinned_rod_buckles_at_eulers_force():
    below = growth_rate(0.98 * CRITICAL, SINE, guided=(0, 50))
    above = growth_rate(1.02 * CRITICAL, SINE, guided=(0, 50))
    assert below < 0.0 < above


def test_clamped_rod_buckles_at_a_quarter_of_it():
    critical = CRITICAL / 4.0 * (450.0 / FREE_NM) ** 2
    s = np.clip(np.arange(51) * EDGE - EDGE / 2.0, 0.0, None)
    s[:2] = 0.0
    shape = 1e-3 * (1.0 - np.cos(np.pi * s / (2.0 * FREE_NM)))
    below = growth_rate(0.97 * critical, shape, held=(0, 1))
    above = growth_rate(1.03 * critical, shape, held=(0, 1))
    assert below < 0.0 < above


@pytest.mark.parametrize("overload", [2.0, 4.0])
def test_growth_rate_of_a_buckling_mode(overload):
    wave = np.pi / 450.0
    force = overload * CRITICAL
    exact = (force * wave**2 - STIFFNESS * wave**4) / (np.pi * 1e-3)
    found = growth_rate(force, SINE, guided=(0, 50))
    np.testing.assert_allclose(found, exact, rtol=1e-2)
