"""A rotor that turns steadily: power, torque and friction agree, growth rates and time stepping."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.rod.balance import force_balance
from rotortrack.simulate.rod.observe import (
    observe_run,
    rotational_friction_pn_nm_s,
    torque_pn_nm,
)
from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.relative_equilibrium import find_equilibrium
from rotortrack.simulate.rod.run import run_rod

FIELD = embedded_table()
STEADY = RodOptions(lambda_eff=0.2, flow_ratio=130.0)
RATTLING = RodOptions(lambda_eff=0.1, flow_ratio=130.0)


def rotor(rod, **stepping):
    start = place_rod(rod, StartOptions(offset_x_nm=40.0, offset_y_nm=8.0), membrane_nm=20.0)
    return run_rod(rod, SteppingOptions(**stepping), start, FIELD)


@pytest.fixture(scope="module")
def steady():
    run = rotor(STEADY, duration_us=400.0)
    return run, find_equilibrium(STEADY, FIELD, run.positions_nm[-1])


def pushed(x, size_nm, seed):
    """The shape with its vertices moved at random and its links as long as before."""
    links = np.diff(x + np.random.default_rng(seed).normal(0.0, size_nm, x.shape), axis=0)
    links *= 9.0 / np.linalg.norm(links, axis=1, keepdims=True)
    return x[:1] + np.concatenate((np.zeros((1, 3)), np.cumsum(links, axis=0)))


def apart_nm(x, y):
    """Root mean square distance of two shapes, one turned about z to lie nearest the other."""
    a = math.atan2(np.sum(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]), np.sum(x[:, :2] * y[:, :2]))
    turn = np.array([[math.cos(a), math.sin(a), 0], [-math.sin(a), math.cos(a), 0], [0, 0, 1]])
    return math.sqrt(np.mean(np.sum((x @ turn - y) ** 2, axis=1)))


def rate_of_change(run, found, begin_us, end_us):
    """Exponential rate at which the shapes of a run leave the found one or come near it."""
    apart = np.array([apart_nm(x, found.positions_nm) for x in run.positions_nm])
    late = (run.time_us >= begin_us) & (run.time_us <= end_us)
    return np.polyfit(run.time_us[late], np.log(apart[late]), 1)[0]


def test_the_field_puts_in_what_the_drag_takes(steady):
    run, found = steady
    for x in (run.positions_nm[2], run.positions_nm[40], found.positions_nm):
        balance = force_balance(x, STEADY, FIELD)
        parts = ("electric", "flow", "salt", "bending", "contact", "leash")
        put_in = sum(balance.power_pn_nm_us(part) for part in parts)
        assert balance.power_pn_nm_us("net") > 0.0
        assert balance.power_pn_nm_us("net") == pytest.approx(put_in, rel=1e-8)
    # A shape that does not change stores no energy in bending or in the wall.
    for part in ("bending", "contact", "tension"):
        assert abs(balance.power_pn_nm_us(part)) < 1e-7 * put_in
    assert balance.power_pn_nm_us("electric") + balance.power_pn_nm_us("flow") == pytest.approx(
        put_in, rel=1e-7
    )


def test_torque_is_friction_times_rate_and_power_is_torque_times_rate(steady):
    _, found = steady
    balance = force_balance(found.positions_nm, STEADY, FIELD)
    torque = torque_pn_nm(found.positions_nm, balance.driving)
    # The formula's integral over segments differs from the sum over vertices by O(1 / n^2).
    friction = 1e6 * rotational_friction_pn_nm_s(found.positions_nm)
    assert torque == pytest.approx(friction * found.omega_rad_us, rel=2e-3)
    assert balance.power_pn_nm_us("net") == pytest.approx(torque * found.omega_rad_us, rel=1e-7)
    # Neither wall nor bending turns a rod about the axis.
    for part in (balance.contact, balance.bending):
        assert abs(torque_pn_nm(found.positions_nm, part)) < 1e-7 * abs(torque)


def test_a_run_is_observed_as_its_steady_shape_says(steady):
    run, found = steady
    seen = observe_run(run, STEADY, FIELD)
    for rate in (seen.rate_rev_s, seen.rate_tip_rev_s, seen.rate_last_tip_rev_s):
        assert rate == pytest.approx(found.rate_rev_s, rel=1e-4)
    ends = found.positions_nm[-1] - found.positions_nm[0]
    assert seen.end_to_end_nm == pytest.approx(np.linalg.norm(ends), rel=1e-4)
    assert seen.end_to_end_xy_nm == pytest.approx(np.linalg.norm(ends[:2]), rel=1e-4)
    assert seen.end_to_end_dyes_nm < seen.end_to_end_nm
    assert seen.handedness == np.sign(found.omega_rad_us)
    expected = seen.torque_pn_nm * 1e6 * found.omega_rad_us
    assert seen.power_pn_nm_s == pytest.approx(expected, rel=2e-3)


def test_a_docking_rod_settles_at_the_slowest_rate(steady):
    _, found = steady
    slowest = found.rates_per_us[0]
    assert slowest.imag == 0.0
    # The next rates are four times as fast, hence gone long before the fit begins.
    assert found.rates_per_us[1].real < 4.0 * slowest.real
    run = rotor(STEADY, duration_us=220.0, sample_us=1.0, tolerance_nm=1e-3)
    measured = rate_of_change(run, found, 150.0, 220.0)
    assert measured == pytest.approx(slowest.real, rel=0.01)


def test_an_unstable_rotor_leaves_at_the_rate_of_its_growth():
    """A rod that slides to and fro as it turns goes round an equilibrium that it never meets."""
    before = rotor(RATTLING, duration_us=300.0)
    found = find_equilibrium(RATTLING, FIELD, before.positions_nm[-1])
    assert not found.is_stable
    assert (found.rates_per_us.real > 0.0).sum() == 1
    assert not before.numbers.settled
    stepping = SteppingOptions(duration_us=90.0, sample_us=1.0, tolerance_nm=1e-5)
    run = run_rod(RATTLING, stepping, pushed(found.positions_nm, 1e-4, 1), FIELD)
    measured = rate_of_change(run, found, 60.0, 85.0)
    assert measured == pytest.approx(found.rates_per_us[0].real, rel=0.02)
