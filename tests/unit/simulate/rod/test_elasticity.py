"""Bending: against differences of its energy, matrices written out, and arcs of circles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.simulate.rod.elasticity import (
    add_bending_force,
    bending_energy,
    joint_stiffness,
)
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import rod_parameters


def bending_force(x, rod):
    force = np.zeros_like(x)
    assert add_bending_force(x, rod, force) == -1
    return force


def cross_matrix(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def written_out(x, stiffness, edge, sign, factor):
    """Sum the paper's Note 2 matrix by matrix, with its sign and its factor as arguments."""
    force = np.zeros_like(x)
    edges = np.diff(x, axis=0)
    for i in range(1, len(x) - 1):
        a, b = edges[i - 1], edges[i]
        weight = edge**2 + a @ b
        kb = 2 * np.cross(a, b) / weight
        below = (2 * cross_matrix(b) + np.outer(kb, b)) / weight
        above = (2 * cross_matrix(a) + sign * np.outer(kb, a)) / weight
        for j, part in ((i - 1, below), (i + 1, above), (i, -below - above)):
            force[j] -= factor * stiffness / edge * part.T @ kb
    return force


def arc(radius_nm, n=51, edge_nm=9.0):
    """Vertices on a circle, so that all edges have the same length."""
    step = 2 * math.asin(edge_nm / (2 * radius_nm))
    angle = step * np.arange(n)
    return np.stack([radius_nm * np.cos(angle), radius_nm * np.sin(angle), np.zeros(n)], axis=1)


def test_bending_force_is_the_gradient_of_the_energy_to_1e_8(wavy, gradient):
    rod = rod_parameters(RodOptions(), None)
    force = bending_force(wavy, rod)
    slope = gradient(bending_energy, wavy, rod)
    assert np.abs(force - slope).max() < 1e-8 * np.abs(force).max()


@given(st.integers(0, 2**32 - 1))
def test_bending_gives_no_net_force_and_no_net_torque(seed):
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal([6.0, 0.0, 0.0], 1.5, (31, 3)), axis=0)
    rod = rod_parameters(RodOptions(n_vertices=31, length_nm=200.0), None)
    force = np.zeros_like(x)
    add_bending_force(x, rod, force)
    scale = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * scale
    assert np.abs(np.cross(x, force).sum(axis=0)).max() < 1e-12 * scale * np.abs(x).max()


@pytest.mark.parametrize(
    ("reading", "sign", "factor"), [("energy", -1, 1), ("doubled", -1, 2), ("printed", 1, 2)]
)
def test_each_reading_is_the_formula_it_names(wavy, reading, sign, factor):
    rod = rod_parameters(RodOptions(bending=reading), None)
    stiffness = 1500.0 * 1.380649e-2 * 300.0
    expected = written_out(wavy, stiffness, 9.0, sign, factor)
    np.testing.assert_allclose(bending_force(wavy, rod), expected, rtol=1e-10, atol=1e-9)


def test_printed_factor_is_exactly_twice_the_gradient(wavy):
    once = bending_force(wavy, rod_parameters(RodOptions(), None))
    twice = bending_force(wavy, rod_parameters(RodOptions(bending="doubled"), None))
    np.testing.assert_allclose(twice, 2.0 * once, rtol=1e-14)


def test_printed_sign_makes_a_torque_out_of_nothing():
    rng = np.random.default_rng(11)
    x = np.cumsum(rng.normal([5.0, 0.0, 0.0], 4.0, (11, 3)), axis=0)
    rod = rod_parameters(RodOptions(n_vertices=11, length_nm=90.0, bending="printed"), None)
    right = rod_parameters(RodOptions(n_vertices=11, length_nm=90.0, bending="doubled"), None)
    printed, doubled = np.zeros_like(x), np.zeros_like(x)
    add_bending_force(x, rod, printed)
    add_bending_force(x, right, doubled)
    # Forces still cancel, as the middle vertex takes what the others get; torques do not.
    assert np.abs(printed.sum(axis=0)).max() < 1e-9 * np.abs(printed).max()
    assert np.linalg.norm(np.cross(x, printed).sum(axis=0)) > 1.0 * np.abs(printed).max()
    assert np.linalg.norm(printed - doubled) > 0.3 * np.linalg.norm(doubled)


@pytest.mark.parametrize(("n", "tolerance"), [(26, 4e-3), (51, 1e-3), (101, 2.5e-4)])
def test_energy_of_a_circular_arc_converges_with_the_square_of_the_edge(n, tolerance):
    edge = 450.0 / (n - 1)
    rod = rod_parameters(RodOptions(n_vertices=n), None)
    x = arc(150.0, n, edge)
    exact = 1500.0 * 1.380649e-2 * 300.0 * edge * (n - 2) / (2 * 150.0**2)
    # 2 tan(theta/2) against l/R with theta = 2 asin(l/2R): the excess is (l/R)^2/4 at first.
    excess = bending_energy(x, rod) / exact - 1.0
    assert excess == pytest.approx((edge / 150.0) ** 2 / 4.0, rel=0.02)
    assert 0.0 < excess < tolerance


def test_a_straight_rod_has_neither_energy_nor_force():
    x = np.zeros((51, 3))
    x[:, 0] = 9.0 * np.arange(51)
    rod = rod_parameters(RodOptions(), None)
    assert bending_energy(x, rod) == 0.0
    assert not bending_force(x, rod).any()


def test_stiffness_is_the_hessian_across_a_straight_rod():
    n = 12
    rod = rod_parameters(RodOptions(n_vertices=n, length_nm=99.0), None)
    x = np.zeros((n, 3))
    x[:, 0] = 9.0 * np.arange(n)
    shares = np.empty(n)
    joint_stiffness(x, rod, shares)
    second = np.zeros((n, n))
    for i in range(1, n - 1):
        second[i, i - 1 : i + 2] = 1.0, -2.0, 1.0
    matrix = second.T @ np.diag(shares) @ second
    hessian = np.zeros((n, n))
    for j in range(n):
        sides = []
        for step in (1e-5, -1e-5):
            moved = x.copy()
            moved[j, 2] += step
            sides.append(bending_force(moved, rod)[:, 2])
        hessian[:, j] = -(sides[0] - sides[1]) / 2e-5
    np.testing.assert_allclose(matrix, hessian, atol=1e-6 * np.abs(hessian).max())


@pytest.mark.parametrize("turn_deg", [10.0, 60.0, 120.0])
def test_stiffness_of_a_joint_follows_its_hessian_to_120_degrees(turn_deg):
    rod = rod_parameters(RodOptions(n_vertices=3, length_nm=18.0), None)

    def hinge(angle):
        x = np.zeros((3, 3))
        x[0, 0] = -9.0
        x[2] = 9.0 * math.cos(angle), 9.0 * math.sin(angle), 0.0
        return x

    angle = math.radians(turn_deg)
    step = 1e-3
    energies = [bending_energy(hinge(angle + shift), rod) for shift in (-step, 0.0, step)]
    exact = (energies[0] - 2 * energies[1] + energies[2]) / step**2 / 81.0
    shares = np.empty(3)
    joint_stiffness(hinge(angle), rod, shares)
    np.testing.assert_allclose(shares, [0.0, exact, 0.0], rtol=1e-4)
