"""Steadily rotating shapes by Newton's method, against time stepping and against symmetry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.errors import RodError
from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.relative_equilibrium import find_equilibrium
from rotortrack.simulate.rod.run import run_rod

ROD = RodOptions(lambda_eff=0.26, flow_ratio=130.0)
FIELD = embedded_table()


@pytest.fixture(scope="module")
def run():
    start = place_rod(ROD, StartOptions(offset_x_nm=40.0, offset_y_nm=8.0), membrane_nm=20.0)
    return run_rod(ROD, SteppingOptions(duration_us=300.0), start, FIELD)


@pytest.fixture(scope="module")
def found(run):
    return find_equilibrium(ROD, FIELD, run.positions_nm[-1])


def test_newton_meets_time_stepping(run, found):
    assert found.residual_pn < 1e-8
    assert found.omega_rad_us == pytest.approx(run.numbers.rate_rad_us, rel=1e-5)
    assert np.abs(found.positions_nm - run.positions_nm[-1]).max() < 1e-3
    links = np.linalg.norm(np.diff(found.positions_nm, axis=0), axis=1)
    np.testing.assert_allclose(links, 9.0, rtol=1e-9)


def test_what_turns_steadily_in_time_is_stable(found):
    assert found.is_stable
    assert found.rates_per_us.shape == (2 * 51,)
    assert (np.diff(found.rates_per_us.real) <= 1e-12).all()


def test_its_slowest_change_dies_out_as_its_rate_says(found):
    # A small push must decay no slower than the slowest rate, and leave the shape where it was.
    rng = np.random.default_rng(3)
    pushed = found.positions_nm + rng.normal(0.0, 0.02, found.positions_nm.shape)
    links = np.diff(pushed, axis=0)
    links *= 9.0 / np.linalg.norm(links, axis=1, keepdims=True)
    pushed = pushed[:1] + np.concatenate((np.zeros((1, 3)), np.cumsum(links, axis=0)))
    slowest = -found.rates_per_us.real.max()
    duration = 8.0 / slowest
    after = run_rod(ROD, SteppingOptions(duration_us=duration, sample_us=1.0), pushed, FIELD)
    again = find_equilibrium(ROD, FIELD, after.positions_nm[-1])
    assert again.omega_rad_us == pytest.approx(found.omega_rad_us, rel=1e-7)
    assert after.numbers.rate_rad_us == pytest.approx(found.omega_rad_us, rel=1e-4)


@pytest.mark.parametrize("angle", [0.0, 2.0])
def test_a_mirror_image_turns_the_other_way_and_a_turned_one_the_same(found, angle):
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    mirror = find_equilibrium(ROD, FIELD, found.positions_nm @ turn * [1.0, -1.0, 1.0])
    assert mirror.omega_rad_us == pytest.approx(-found.omega_rad_us, rel=1e-7)
    same = find_equilibrium(ROD, FIELD, found.positions_nm @ turn)
    assert same.omega_rad_us == pytest.approx(found.omega_rad_us, rel=1e-7)


def test_a_shape_far_from_any_is_refused():
    start = place_rod(ROD, StartOptions(offset_x_nm=400.0, height_nm=400.0), membrane_nm=20.0)
    with pytest.raises(RodError, match="no steadily rotating shape"):
        find_equilibrium(ROD, FIELD, start)
