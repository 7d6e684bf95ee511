"""Hard shapes of the rod: the forces stay finite, and what is no rod is refused by name."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from rotortrack.errors import RodError
from rotortrack.simulate.rod.contact import add_contact_force, add_contact_hessian
from rotortrack.simulate.rod.elasticity import add_bending_force, bending_energy, check_shape
from rotortrack.simulate.rod.forces import NO_NODES, total_force
from rotortrack.simulate.rod.friction import drag_frames
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import rod_parameters


@dataclass(frozen=True)
class Pore:
    """The paper's pore."""

    pore_radius_nm: float = 25.0
    membrane_nm: float = 20.0
    rim_radius_nm: float = 0.0


def rod_numbers(**options):
    return rod_parameters(RodOptions(n_vertices=5, length_nm=36.0, **options), Pore())


def uniform_table():
    """Constant fields: E and flow along z, and radial parts that grow with r from zero."""
    r_nm, z_nm = np.linspace(0.0, 600.0, 7), np.linspace(-600.0, 600.0, 9)
    nodes = np.zeros((7, 9, 8, 4))
    nodes[:, :, 1, 0] = 1e6
    nodes[:, :, 5, 0] = 1.0
    for radial in (0, 4):
        nodes[:, :, radial, 0] = 10.0 * r_nm[:, None]
        nodes[:, :, radial, 1] = 10.0
    return r_nm, z_nm, nodes


def hinge(turn_deg):
    """Two arms of 18 nm that meet at vertex 2."""
    angle = math.radians(turn_deg)
    arm = 9.0 * np.arange(3)[:, None]
    first = arm[::-1] * np.array([-1.0, 0.0, 0.0])
    second = arm * np.array([math.cos(angle), math.sin(angle), 0.0])
    return np.concatenate([first, second[1:]])


@pytest.mark.parametrize("turn_deg", [149.0, 151.0, 175.0, 179.999, 180.0])
def test_a_folding_joint_is_reported_and_its_force_is_finite(turn_deg):
    rod = rod_numbers()
    force = np.empty((5, 3))
    folded = total_force(hinge(turn_deg), rod, *NO_NODES, force)
    assert folded == (-1 if turn_deg < 150.0 else 2)
    assert np.isfinite(force).all()
    assert math.isfinite(bending_energy(hinge(turn_deg), rod))


@pytest.mark.parametrize("turn_deg", [151.0, 180.0])
def test_a_folded_rod_is_refused_by_its_joint(turn_deg):
    with pytest.raises(RodError, match=rf"turns by {turn_deg:.0f} degrees at vertex 2"):
        check_shape(hinge(turn_deg))
    check_shape(hinge(149.0))


def test_the_force_of_a_folding_joint_opens_it():
    force = np.zeros((5, 3))
    x = hinge(170.0)
    add_bending_force(x, rod_numbers(), force)
    # Across the arms, as what acts along them is the links' business.
    assert force[1, 1] < 0.0
    assert force[3] @ np.cross([0.0, 0.0, 1.0], x[3] - x[2]) < 0.0


def test_coincident_vertices_give_finite_forces_frames_and_a_named_refusal():
    x = hinge(30.0)
    x[3] = x[2]
    rod = rod_numbers()
    force = np.empty((5, 3))
    total_force(x, rod, *uniform_table(), force)
    assert np.isfinite(force).all()
    tangent, zeta = np.empty((5, 3)), np.empty((5, 2))
    drag_frames(x, rod, tangent, zeta)
    np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), 1.0)
    with pytest.raises(RodError, match="vertices 2 and 3 of the rod coincide"):
        check_shape(x)


def test_the_tangent_of_a_hairpin_is_its_next_edge():
    x = hinge(180.0)
    tangent, zeta = np.empty((5, 3)), np.empty((5, 2))
    drag_frames(x, rod_numbers(), tangent, zeta)
    np.testing.assert_allclose(tangent[2], [-1.0, 0.0, 0.0], atol=1e-12)


def test_a_rod_shrunk_to_a_point_gives_finite_numbers():
    x = np.zeros((5, 3))
    rod = rod_numbers()
    force, tangent, zeta = np.empty((5, 3)), np.empty((5, 3)), np.empty((5, 2))
    total_force(x, rod, *uniform_table(), force)
    drag_frames(x, rod, tangent, zeta)
    assert np.isfinite(force).all()
    assert not tangent.any()
    assert (zeta > 0.0).all()


@pytest.mark.parametrize("wall", ["signed_distance", "z_only"])
@pytest.mark.parametrize("contact", ["segments", "vertices"])
def test_vertices_on_the_axis_feel_no_radial_force(wall, contact):
    x = np.zeros((5, 3))
    x[:, 2] = 9.0 * np.arange(5) - 18.0
    rod = rod_numbers(wall=wall, contact=contact)
    force = np.empty((5, 3))
    total_force(x, rod, *uniform_table(), force)
    assert np.isfinite(force).all()
    assert not force[:, :2].any()
    assert (force[:, 2] != 0.0).all()


def test_a_straight_rod_through_the_axis_stays_straight_by_symmetry():
    x = np.zeros((5, 3))
    x[:, 0] = 9.0 * np.arange(-2, 3)
    x[:, 2] = 20.0
    rod = rod_numbers()
    force = np.empty((5, 3))
    total_force(x, rod, *uniform_table(), force)
    # Not a sign of round-off breaks the symmetry.
    np.testing.assert_array_equal(force[:, 1], 0.0)
    np.testing.assert_array_equal(force[:, 0], -force[::-1, 0])
    np.testing.assert_array_equal(force[:, 2], force[::-1, 2])


@pytest.mark.parametrize("rim", [0.0, 2.0, 10.0])
@pytest.mark.parametrize("contact", ["segments", "vertices"])
def test_contact_is_finite_all_over_the_membrane(rim, contact):
    rod = rod_parameters(RodOptions(n_vertices=5, contact=contact), Pore(rim_radius_nm=rim))
    for r in (0.0, 1e-300, 22.0, 25.0, 25.0 + rim, 30.0, 1e9):
        for z in (-1e9, -13.0, -10.0, -10.0 + rim, 0.0, 10.0 - rim, 10.0, 13.0):
            x = np.zeros((5, 3))
            x[:, 0] = r
            x[:, 2] = z
            force, blocks = np.zeros((5, 3)), np.zeros((5, 3, 3))
            add_contact_force(x, rod, force)
            add_contact_hessian(x, rod, blocks)
            assert np.isfinite(force).all()
            assert np.isfinite(blocks).all()


def test_no_rod_slips_through_the_membrane_between_two_vertices():
    # One segment, vertices clear of both faces, passes 3 nm outside the hole's edge.
    x = np.array([[28.0, 0.0, 13.5], [28.0, 0.0, -13.5]])
    held = np.zeros_like(x)
    add_contact_force(x, rod_parameters(RodOptions(n_vertices=3), Pore()), held)
    assert held.sum(axis=0)[0] < -1.0
    missed = np.zeros_like(x)
    add_contact_force(
        x, rod_parameters(RodOptions(n_vertices=3, contact="vertices"), Pore()), missed
    )
    assert not missed.any()


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_vertex_that_is_nowhere_is_named(bad):
    x = hinge(30.0)
    x[3, 1] = bad
    with pytest.raises(RodError, match="vertex 3 of the rod is not at a finite place"):
        check_shape(x)


def test_nan_in_is_nan_out():
    x = hinge(30.0)
    x[3, 1] = math.nan
    force = np.empty((5, 3))
    total_force(x, rod_numbers(), *NO_NODES, force)
    assert not np.isfinite(force).all()
