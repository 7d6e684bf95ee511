"""Motions of free rods that are known in closed form, and the order of the methods."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from rotortrack.simulate.rod.elasticity import bending_energy
from rotortrack.simulate.rod.explicit import longest_stable_step_us
from rotortrack.simulate.rod.options import RodOptions, SteppingOptions
from rotortrack.simulate.rod.run import run_rod

from .steps import arc, bent, free_rod

STIFFNESS = 1.380649e-2 * 300.0 * 1500.0
ACROSS = np.pi * 1e-3
BETA = brentq(lambda b: np.cos(b) * np.cosh(b) - 1.0, 4.0, 5.0)


def free_mode(n):
    """First bending mode of a free rod."""
    s = np.linspace(0.0, 1.0, n) * BETA
    ratio = (np.cosh(BETA) - np.cos(BETA)) / (np.sinh(BETA) - np.sin(BETA))
    mode = np.cosh(s) + np.cos(s) - ratio * (np.sinh(s) + np.sin(s))
    return mode / np.abs(mode).max()


def decay_rate(n):
    run = run_rod(
        RodOptions(n_vertices=n),
        SteppingOptions(duration_us=40.0, sample_us=20.0, tolerance_nm=1e-7, max_step_us=2.0),
        bent(1e-2 * free_mode(n)),
    )
    # The continuous mode is nearly the discrete one; what else is in it has died after 20 us.
    weight = np.full(n, 1.0)
    weight[[0, -1]] = 0.5
    middle, last = ((weight * free_mode(n)) @ run.positions_nm[k][:, 2] for k in (1, 2))
    return np.log(middle / last) / 20.0


def test_bending_mode_of_a_free_rod_decays_at_its_rate():
    exact = STIFFNESS * BETA**4 / (ACROSS * 450.0**4)
    np.testing.assert_allclose(1.0 / exact, 41.42, atol=0.01)
    errors = np.array([decay_rate(n) / exact - 1.0 for n in (26, 51, 101)])
    np.testing.assert_allclose(errors, [-1.3e-2, -3.3e-3, -9e-4], rtol=0.15)
    orders = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.15)


def test_bending_mode_decays_at_the_rate_of_its_own_discrete_rod():
    n = 51
    second = np.zeros((n - 2, n))
    for i in range(n - 2):
        second[i, i : i + 3] = [1.0, -2.0, 1.0]
    weight = np.full(n, 9.0 * ACROSS)
    weight[[0, -1]] /= 2.0
    rates, modes = eigh(STIFFNESS / 9.0**3 * second.T @ second, np.diag(weight))
    for mode, until in ((2, 20.0), (3, 4.0), (4, 1.0)):
        run = run_rod(
            RodOptions(),
            SteppingOptions(duration_us=until, sample_us=until, tolerance_nm=3e-9),
            bent(1e-3 * modes[:, mode] / np.abs(modes[:, mode]).max()),
        )
        first, last = ((modes[:, mode] * weight) @ shape[:, 2] for shape in run.positions_nm)
        np.testing.assert_allclose(np.log(first / last) / until, rates[mode], rtol=2e-5)


def test_energy_of_a_free_rod_only_falls():
    run = run_rod(
        RodOptions(), SteppingOptions(duration_us=100.0, sample_us=0.5), arc(radius_nm=90.0)
    )
    energy = [bending_energy(shape, free_rod()) for shape in run.positions_nm]
    assert np.all(np.diff(energy) < 0.0)
    assert energy[-1] < 0.2 * energy[0]


@pytest.mark.parametrize("method", ["explicit", "paper", "implicit"])
def test_links_do_not_drift(method):
    duration = 20.0 if method == "implicit" else 2.0
    run = run_rod(
        RodOptions(), SteppingOptions(method=method, duration_us=duration), arc(radius_nm=90.0)
    )
    lengths = np.linalg.norm(np.diff(run.positions_nm, axis=1), axis=2)
    assert np.abs(lengths / 9.0 - 1.0).max() < 2e-9


def smooth_start():
    """An arc whose ends have already lost their moment."""
    return run_rod(RodOptions(), SteppingOptions(duration_us=1.0), arc()).positions_nm[-1]


def end_of(start, duration_us=2.0, **stepping):
    options = SteppingOptions(duration_us=duration_us, sample_us=duration_us, **stepping)
    return run_rod(RodOptions(), options, start).positions_nm[-1]


def orders(start, exact, steps, **stepping):
    errors = [
        np.abs(end_of(start, step_us=step, max_step_us=step, **stepping) - exact).max()
        for step in steps
    ]
    return np.log2(np.array(errors[:-1]) / errors[1:])


def test_extrapolated_step_is_of_order_2():
    start = smooth_start()
    exact = end_of(start, tolerance_nm=1e-7)
    found = orders(start, exact, (0.1, 0.05, 0.025, 0.0125), tolerance_nm=1e9)
    np.testing.assert_allclose(found, 2.0, atol=0.15)


def test_explicit_euler_is_of_order_1():
    start = smooth_start()
    exact = end_of(start, tolerance_nm=1e-7)
    found = orders(start, exact, (3.2e-4, 1.6e-4, 8e-5), method="explicit")
    np.testing.assert_allclose(found, 1.0, atol=0.1)


def test_error_follows_the_tolerance():
    start = arc(radius_nm=90.0)
    exact = end_of(start, 4.0, tolerance_nm=1e-6)
    errors = [
        np.abs(end_of(start, 4.0, tolerance_nm=tolerance) - exact).max()
        for tolerance in (1e-2, 1e-3, 1e-4)
    ]
    assert errors[0] < 2e-2
    assert np.all(np.array(errors[1:]) < 0.25 * np.array(errors[:-1]))


def test_explicit_steps_are_stable_up_to_the_limit_and_not_beyond():
    limit = longest_stable_step_us(free_rod())
    np.testing.assert_allclose(limit, 0.415e-3, rtol=2e-3)
    zigzag = bent(1e-6 * (-1.0) ** np.arange(51))
    below = end_of(zigzag, 0.2, method="explicit", step_us=0.98 * limit)
    above = end_of(zigzag, 0.2, method="explicit", step_us=1.04 * limit)
    assert np.abs(below[:, 2]).max() < 1e-6 < 1e-3 < np.abs(above[:, 2]).max()


def test_samples_between_steps_are_as_exact_as_the_steps():
    start = smooth_start()
    sampled = {"duration_us": 2.0, "sample_us": 0.025}
    steps = SteppingOptions(**sampled, step_us=0.1, max_step_us=0.1, tolerance_nm=1e9)
    run = run_rod(RodOptions(), steps, start)
    exact = run_rod(RodOptions(), SteppingOptions(**sampled, tolerance_nm=1e-5), start)
    assert run.n_steps == 20
    errors = np.abs(run.positions_nm - exact.positions_nm).max(axis=(1, 2))
    within = errors[:80].reshape(20, 4)[2:, 1:].max(axis=1)
    assert np.all(within < 1.06 * np.maximum(errors[8:80:4], errors[12::4]))
