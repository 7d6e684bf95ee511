"""The tether: slack, spring and worm-like chain."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.simulate.rod.contact import add_contact_hessian
from rotortrack.simulate.rod.leash import add_leash_force, leash_pull
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import LEASH_AT, rod_parameters


def straight(height_nm):
    x = np.zeros((51, 3))
    x[:, 0] = np.linspace(-225.0, 225.0, 51)
    x[:, 2] = height_nm
    return x


def leash_force(x, rod):
    force = np.zeros_like(x)
    add_leash_force(x, rod, force)
    return force


def test_a_harmonic_tether_is_slack_up_to_its_length(pore):
    rod = rod_parameters(RodOptions(leash="harmonic"), pore)
    assert not leash_force(straight(49.0), rod).any()
    force = leash_force(straight(60.0), rod)
    np.testing.assert_allclose(force[25], [0.0, 0.0, -10.0])
    assert not np.delete(force, 25, axis=0).any()


@pytest.mark.parametrize("reach", [0.01, 0.3, 0.6, 0.9])
def test_a_worm_like_tether_pulls_as_marko_and_siggia_say(pore, reach):
    rod = rod_parameters(RodOptions(leash="worm_like"), pore)
    exact = 4.141947 / 50.0 * (0.25 / (1 - reach) ** 2 - 0.25 + reach)
    assert leash_pull(50.0 * reach, rod)[0] == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("leash", ["harmonic", "worm_like"])
@pytest.mark.parametrize("distance", [20.0, 47.4, 47.6, 70.0])
def test_the_stiffness_is_the_slope_of_the_pull(pore, leash, distance):
    rod = rod_parameters(RodOptions(leash=leash), pore)
    slope = (leash_pull(distance + 1e-4, rod)[0] - leash_pull(distance - 1e-4, rod)[0]) / 2e-4
    assert leash_pull(distance, rod)[1] == pytest.approx(slope, rel=1e-5)


def test_the_worm_like_law_stays_finite_beyond_its_length(pore):
    rod = rod_parameters(RodOptions(leash="worm_like"), pore)
    pulls = [leash_pull(d, rod)[0] for d in np.linspace(0.0, 500.0, 2001)]
    assert np.isfinite(pulls).all()
    assert (np.diff(pulls) > 0.0).all()


@pytest.mark.parametrize(("at", "vertex"), [("first", 0), ("middle", 25), ("last", 50)])
def test_the_tether_starts_where_it_is_told(pore, at, vertex):
    rod = rod_parameters(RodOptions(leash="harmonic", leash_at=at), pore)
    assert rod[LEASH_AT] == vertex
    assert leash_force(straight(100.0), rod)[vertex].any()


@pytest.mark.parametrize("leash", ["harmonic", "worm_like"])
def test_an_implicit_step_is_given_the_tethers_stiffness(pore, leash):
    rod = rod_parameters(RodOptions(leash=leash), pore)
    x = straight(60.0)
    x[25, :2] = 12.0, -7.0
    blocks = np.zeros((51, 3, 3))
    add_contact_hessian(x, rod, blocks)
    for j in range(3):
        sides = []
        for step in (1e-5, -1e-5):
            moved = x.copy()
            moved[25, j] += step
            sides.append(leash_force(moved, rod)[25])
        np.testing.assert_allclose(blocks[25, j], -(sides[0] - sides[1]) / 2e-5, atol=1e-6)


def test_no_tether_unless_it_is_named(pore):
    assert not leash_force(straight(300.0), rod_parameters(RodOptions(), pore)).any()


def test_a_rod_whose_middle_is_at_the_anchor_is_not_pulled(pore):
    rod = rod_parameters(RodOptions(leash="worm_like"), pore)
    assert not leash_force(straight(0.0), rod).any()
