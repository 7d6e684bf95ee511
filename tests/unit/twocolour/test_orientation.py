"""Axes have no sense; slow turning is no preference; rotors, not frames, tell of pores."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.twocolour.orientation import alignment, preferred_axis, rayleigh_p


def walk(rng, n, diffusion, dt=0.002):
    return rng.uniform(0, 2 * math.pi) + np.cumsum(rng.normal(0, math.sqrt(2 * diffusion * dt), n))


@given(st.floats(0, math.pi), st.integers(0, 2**32 - 1))
def test_an_axis_is_found_whichever_way_the_vector_points(axis, seed):
    rng = np.random.default_rng(seed)
    angles = axis + rng.normal(0, 0.1, 400) + math.pi * rng.integers(0, 2, 400)
    found = preferred_axis(angles)
    off = (found.axis_deg - math.degrees(axis) + 90) % 180 - 90
    assert abs(off) < 2.0
    assert found.order == pytest.approx(math.exp(-2 * 0.1**2), abs=0.02)
    assert found.order_p < 1e-6


def test_turning_the_image_turns_the_axis():
    rng = np.random.default_rng(1)
    angles = rng.normal(0.4, 0.3, 500)
    one, other = preferred_axis(angles), preferred_axis(angles + 1.0)
    assert other.axis_deg == pytest.approx((one.axis_deg + math.degrees(1.0)) % 180)
    assert other.order == pytest.approx(one.order)


@pytest.mark.parametrize("diffusion", [0.5, 2.0, 20.0, 200.0])
def test_a_rotor_that_turns_freely_has_no_axis_however_slowly(diffusion):
    rng = np.random.default_rng(int(10 * diffusion))
    p = np.array([preferred_axis(walk(rng, 4000, diffusion)).order_p for _ in range(300)])
    # Of 300, 5 % are 15 +- 4; the effective number is itself an estimate.
    assert np.mean(p < 0.05) < 0.10
    assert np.mean(p < 0.5) > 0.3


def test_rayleigh_agrees_with_chance():
    rng = np.random.default_rng(2)
    lengths = np.abs(np.exp(2j * math.pi * rng.random((20000, 25))).mean(axis=1))
    for resultant in (0.2, 0.3, 0.4):
        assert rayleigh_p(resultant, 25) == pytest.approx(np.mean(lengths > resultant), abs=0.008)


def test_too_few_directions_have_no_axis():
    assert math.isnan(preferred_axis(np.array([1.0])).axis_deg)
    assert preferred_axis(np.array([1.0])).n_independent == 1


def test_rods_along_their_pores_are_told_from_rods_that_lie_anyhow():
    rng = np.random.default_rng(3)
    along = alignment(30.0 + rng.normal(0, 20, 40), np.full(40, 0.8), 30.0)
    assert along.alignment > 0.6
    assert along.alignment_p < 1e-6
    across = alignment(120.0 + rng.normal(0, 20, 40), np.full(40, 0.8), 30.0)
    assert across.alignment == pytest.approx(-along.alignment, abs=0.25)
    p = [
        alignment(rng.uniform(0, 180, 40), rng.uniform(0, 1, 40), 30.0).alignment_p
        for _ in range(2000)
    ]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.015)


def test_rotors_without_an_axis_do_not_count():
    found = alignment(np.array([10.0, np.nan]), np.array([0.5, 0.5]), 10.0)
    assert (found.alignment, found.n_rotors) == (1.0, 1)
    assert math.isnan(alignment(np.array([np.nan]), np.array([np.nan]), 0.0).alignment)
