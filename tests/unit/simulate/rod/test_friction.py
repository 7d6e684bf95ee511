"""Friction: tangents against circles, sums against the whole rod's drag."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.errors import RodError
from rotortrack.simulate.rod.forces import total_force
from rotortrack.simulate.rod.friction import drag_frames
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import rod_parameters


def frames(x, pore=None, **options):
    tangent, zeta = np.empty((len(x), 3)), np.empty((len(x), 2))
    drag_frames(x, rod_parameters(RodOptions(n_vertices=len(x), **options), pore), tangent, zeta)
    return tangent, zeta


def test_half_ends_make_the_drag_of_the_whole_rod_exact(wavy):
    zeta = frames(wavy)[1]
    # pi eta L, with 1 mPa s = 1e-3 pN us/nm^2
    np.testing.assert_allclose(zeta.sum(axis=0), math.pi * 1e-3 * 450.0 * np.array([1.0, 0.5]))


def test_full_ends_carry_one_more_segment(wavy):
    zeta = frames(wavy, end_weight="full")[1]
    np.testing.assert_allclose(zeta[:, 0], math.pi * 1e-3 * 9.0)


def test_secants_of_a_circle_are_its_tangents():
    angle = 0.1 * np.arange(30)
    x = 90.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros(30)], axis=1)
    tangent = frames(x)[0]
    exact = np.stack([-np.sin(angle), np.cos(angle), np.zeros(30)], axis=1)
    np.testing.assert_allclose(tangent[1:-1], exact[1:-1], atol=1e-14)
    for end, neighbour in ((0, 1), (29, 28)):
        edge = x[max(end, neighbour)] - x[min(end, neighbour)]
        np.testing.assert_allclose(tangent[end], edge / np.linalg.norm(edge), atol=1e-14)


def test_friction_grows_with_viscosity_prefactor_and_printed_length(wavy):
    plain = frames(wavy)[1]
    np.testing.assert_allclose(frames(wavy, viscosity_mpa_s=0.85)[1], 0.85 * plain)
    np.testing.assert_allclose(frames(wavy, friction_prefactor=3 * math.pi)[1], 3 * plain)
    np.testing.assert_allclose(frames(wavy, friction_length_nm=30.0)[1], plain * 30.0 / 9.0)


def test_slender_body_friction_of_an_8_nm_bundle_is_four_fifths_of_pi(wavy):
    ratio = frames(wavy, friction="slender_body")[1] / frames(wavy)[1]
    np.testing.assert_allclose(ratio, 4 / (math.log(450.0 / 8.0) + 0.84))
    assert ratio[0, 0] == pytest.approx(0.82, abs=0.005)


def test_a_stubby_rod_is_no_slender_body():
    with pytest.raises(RodError, match="friction = 'resistive'"):
        rod_parameters(RodOptions(length_nm=15.0, friction="slender_body"), None)


def beside(height_nm):
    """A rod parallel to the membrane, far from the pore, its axis this far above the face."""
    x = np.zeros((51, 3))
    x[:, 0] = 9.0 * np.arange(51)
    x[:, 1] = 200.0
    x[:, 2] = 10.0 + height_nm
    return x


@pytest.mark.parametrize("height_nm", [3.0, 6.0, 20.0, 100.0])
def test_beside_the_membrane_friction_is_that_of_a_cylinder_near_a_wall(pore, height_nm):
    zeta = frames(beside(height_nm), pore, wall_drag="cylinder", friction="slender_body")[1]
    # 4 pi eta L / arcosh(h/b): b = 4 nm, half a nanometre of water in contact at 3 nm
    axis_nm = 4.0 + 0.5 + height_nm - 3.0
    exact = 4 * math.pi * 1e-3 * 450.0 / math.acosh(axis_nm / 4.0)
    np.testing.assert_allclose(zeta.sum(axis=0), [exact, exact / 2], rtol=1e-12)


@pytest.mark.parametrize("friction", ["resistive", "slender_body"])
def test_far_from_the_membrane_the_wall_does_not_matter(pore, friction):
    x = beside(1000.0)
    far = frames(x, pore, wall_drag="cylinder", friction=friction)[1]
    np.testing.assert_array_equal(far, frames(x, pore, friction=friction)[1])


def test_friction_falls_with_the_distance_and_never_below_the_free_rods(pore):
    sums = [
        frames(beside(height), pore, wall_drag="cylinder")[1][:, 0].sum()
        for height in (-2.0, 0.0, 3.0, 3.5, 5.0, 10.0, 50.0, 200.0, 250.0, 400.0)
    ]
    assert np.all(np.diff(sums) <= 0.0)
    assert sums[0] == sums[2]  # pressed into the wall it is held by the layer of water
    assert sums[-1] == pytest.approx(math.pi * 1e-3 * 450.0)


def test_the_walls_friction_leaves_the_forces_alone(pore, linear_table, wavy):
    table = linear_table(u_z=(1.0, 0.0, 0.0), e_applied_z=(1e6, 0.0, 0.0))
    x = wavy + np.array([0.0, 3.0, 13.0])
    forces = []
    for wall_drag in ("none", "cylinder"):
        forces.append(np.empty_like(x))
        rod = rod_parameters(RodOptions(wall_drag=wall_drag), pore)
        total_force(x, rod, *table, forces[-1])
    np.testing.assert_array_equal(*forces)


def test_without_a_membrane_there_is_no_wall_to_slow_the_rod(wavy):
    np.testing.assert_array_equal(
        frames(wavy, wall_drag="cylinder")[1], frames(wavy, wall_drag="none")[1]
    )
