"""What is measured on a rod, against shapes whose answers are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.simulate.rod.balance import force_balance
from rotortrack.simulate.rod.observe import (
    dye_centres_nm,
    rotational_friction_pn_nm_s,
    tip_rate_rev_s,
    torque_pn_nm,
)
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.shape import chirality, crosses_itself, shape_class, turns_rad

MIRROR = np.array([1.0, -1.0, 1.0])


def turned(x, angle):
    c, s = math.cos(angle), math.sin(angle)
    return x @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def along(headings_rad, edge=9.0):
    """A planar chain of links with these headings, its middle on the axis."""
    steps = edge * np.stack([np.cos(headings_rad), np.sin(headings_rad), 0 * headings_rad], axis=1)
    x = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return x - x[len(x) // 2]


PART = np.linspace(0.0, 1.0, 50)
S = along(2.5 * np.sin(math.pi * PART))
U = along(3.0 * PART)
LOOP = along(2.2 * math.pi * PART)
STRAIGHT = along(0.0 * PART)
SHAPES = {"S": S, "mirrored_S": S * MIRROR, "U": U, "loop": LOOP, "straight": STRAIGHT}

chains = st.builds(
    lambda seed: (
        along(np.cumsum(np.random.default_rng(seed).normal(0, 0.3, 50)))
        + np.random.default_rng(seed).normal(0, 30, 3)
    ),
    st.integers(0, 2**32 - 1),
)
angles = st.floats(-math.pi, math.pi)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("angle", [0.0, 1.0, 3.0])
def test_shapes_have_their_names_from_either_end(name, angle):
    x = turned(SHAPES[name], angle)
    assert shape_class(x) == name
    assert shape_class(x[::-1]) == name


def test_a_crossing_makes_a_loop_though_the_turns_cancel():
    corners = [(0, 0), (100, 0), (100, 50), (50, 50), (50, -60), (0, -60), (0, -20)]
    x = np.array([(*corner, 0.0) for corner in corners])
    assert abs(sum(turns_rad(x))) < 2.0
    assert crosses_itself(x)
    assert shape_class(x) == "loop"
    assert not crosses_itself(S)


@given(chains, angles)
def test_a_mirror_turns_hand_and_turns_and_nothing_else_does(x, angle):
    hand = chirality(x)
    assert chirality(x * MIRROR) == pytest.approx(-hand, abs=1e-12)
    assert chirality(turned(x, angle)) == pytest.approx(hand, abs=1e-9)
    assert chirality(x[::-1]) == pytest.approx(hand, abs=1e-12)
    first, second = turns_rad(x)
    assert turns_rad(x * MIRROR) == pytest.approx((-first, -second), abs=1e-9)
    assert turns_rad(x[::-1]) == pytest.approx((-second, -first), abs=1e-9)


def test_a_spiral_that_a_flow_turns_counter_clockwise_is_right_handed():
    # A segment that runs outward and clockwise is pushed counter-clockwise by a flow outward.
    x = np.array([[10.0, 0.0, 0.0], [20.0, -5.0, 0.0], [28.0, -12.0, 0.0]])
    assert chirality(x) > 0.0


@given(chains, st.floats(0.2, 0.4), st.floats(-1, 1))
def test_a_shape_that_only_turns_has_the_rate_of_its_tips(x, step_us, rate):
    time_us = step_us * np.arange(20)
    positions = np.stack([turned(x, rate * t) for t in time_us])
    for end in (0, -1):
        if np.hypot(*x[end, :2]) > 1e-3:
            seen = tip_rate_rev_s(time_us, positions[:, end])
            assert seen == pytest.approx(rate * 1e6 / (2 * math.pi), rel=1e-9, abs=1e-6)


def test_a_tip_that_goes_too_far_between_samples_has_no_rate():
    time_us = np.arange(10.0)
    tip = np.stack([turned(np.array([[50.0, 0.0, 0.0]]), 2.0 * t)[0] for t in time_us])
    assert math.isnan(tip_rate_rev_s(time_us, tip))
    assert math.isnan(tip_rate_rev_s(time_us[:1], tip[:1]))


@pytest.mark.parametrize("prefactor", [math.pi, 3 * math.pi])
def test_a_straight_rod_has_the_friction_of_the_formula(prefactor):
    expected = prefactor * 1e-3 * 450.0**3 / 12.0 * 1e-6
    found = rotational_friction_pn_nm_s(STRAIGHT * [1, 1, 1], 1.0, prefactor)
    assert found == pytest.approx(expected, rel=1e-12)
    # physics.md, section 4: 0.0239 with pi, 0.0716 with 3 pi
    assert found == pytest.approx({math.pi: 0.02386, 3 * math.pi: 0.07157}[prefactor], rel=1e-3)


def test_a_ring_about_the_axis_slides_along_itself():
    angle = np.linspace(0, 2 * math.pi, 2001)
    ring = 100.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    expected = math.pi * 1e-3 * 100.0**2 * (2 * math.pi * 100.0) / 2.0 * 1e-6
    assert rotational_friction_pn_nm_s(ring) == pytest.approx(expected, rel=1e-5)


@given(chains, angles)
def test_friction_knows_neither_angle_nor_mirror(x, angle):
    friction = rotational_friction_pn_nm_s(x)
    assert rotational_friction_pn_nm_s(turned(x, angle)) == pytest.approx(friction, rel=1e-9)
    assert rotational_friction_pn_nm_s(x * MIRROR) == pytest.approx(friction, rel=1e-9)


@pytest.mark.parametrize("dyes", [(20.0, 40.0), (9.0, 4.5), (450.0, 450.0)])
def test_dyes_of_a_straight_rod_have_their_centres_in_the_middle(dyes):
    centres = dye_centres_nm(STRAIGHT[np.newaxis], 450.0, dyes)[0]
    np.testing.assert_allclose(centres[0] - STRAIGHT[0], [dyes[0] / 2, 0, 0], atol=1e-9)
    np.testing.assert_allclose(STRAIGHT[-1] - centres[1], [dyes[1] / 2, 0, 0], atol=1e-9)


def test_torque_of_a_pair_of_forces():
    x = np.array([[10.0, 0.0, 3.0], [-10.0, 0.0, 8.0]])
    force = np.array([[0.0, 2.0, 9.0], [0.0, -2.0, 1.0]])
    assert torque_pn_nm(x, force) == pytest.approx(40.0)


@given(chains)
def test_what_a_free_rod_gives_up_in_bending_its_drag_takes(x):
    balance = force_balance(x, RodOptions())
    assert balance.power_pn_nm_us("bending") > 0.0
    assert balance.power_pn_nm_us("net") == pytest.approx(
        balance.power_pn_nm_us("bending"), rel=1e-8
    )
    scale = np.abs(balance.tension).max() * np.abs(balance.velocity_nm_us).max()
    assert balance.power_pn_nm_us("tension") == pytest.approx(0.0, abs=1e-8 * scale * len(x))
    links = np.diff(x, axis=0)
    stretch = np.sum(np.diff(balance.velocity_nm_us, axis=0) * links, axis=1)
    np.testing.assert_allclose(stretch, 0.0, atol=1e-7 * np.abs(balance.velocity_nm_us).max() * 9)
    # No force from outside: none on the whole.
    np.testing.assert_allclose(balance.net.sum(axis=0), 0.0, atol=1e-9 * np.abs(balance.net).max())
