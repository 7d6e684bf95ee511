"""Contact: distances and normals against geometry, forces against differences of the energy."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.simulate.rod.contact import (
    add_contact_force,
    add_contact_hessian,
    contact_energy,
    wall_distance,
)
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import rod_parameters


def contact_force(x, rod):
    force = np.zeros_like(x)
    add_contact_force(x, rod, force)
    return force


def on_the_rim(n=51):
    """A rod that sags through the hole and touches faces, rim and lumen, 9 nm between vertices.

    Vertices lie at no symmetric places, so that no two parts of the wall are equally near.
    """
    angle = np.interp(np.arange(n - 1), [0, 21, 25, 29, n], [0.0, -0.1, -0.9, 0.7, 0.05])
    steps = np.stack([np.cos(angle), np.full(n - 1, 0.07), np.sin(angle)], axis=1)
    steps *= 9.0 / np.linalg.norm(steps, axis=1)[:, None]
    x = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    x -= x[25]
    return x + np.array([17.3, 4.1, 8.2])


@pytest.mark.parametrize("rim", [0.0, 2.0])
@pytest.mark.parametrize(
    ("r", "z", "distance", "normal"),
    [
        (60.0, 14.0, 4.0, (0.0, 1.0)),  # above the cis face
        (60.0, -14.0, 4.0, (0.0, -1.0)),  # below the trans face
        (21.0, 0.0, 4.0, (-1.0, 0.0)),  # in the lumen
        (60.0, 9.0, -1.0, (0.0, 1.0)),  # just inside the membrane
        (26.5, 1.0, -1.5, (-1.0, 0.0)),  # just inside the lumen's wall
    ],
)
def test_distance_to_faces_and_lumen(make_pore, rim, r, z, distance, normal):
    rod = rod_parameters(RodOptions(), make_pore(rim_radius_nm=rim))
    assert wall_distance(r, z, rod) == pytest.approx((distance, *normal), abs=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("rim", [0.0, 2.0])
def test_distance_to_the_rim_is_radial_from_its_centre(make_pore, rim, side):
    rod = rod_parameters(RodOptions(), make_pore(rim_radius_nm=rim))
    found = wall_distance(25.0 + rim - 3.0, side * (10.0 - rim + 4.0), rod)
    assert found == pytest.approx((5.0 - rim, -0.6, side * 0.8), abs=1e-12)


@given(st.floats(0.0, 80.0), st.floats(-30.0, 30.0), st.sampled_from([0.0, 1.5, 10.0]))
def test_distance_to_the_membrane_is_that_of_the_nearest_point_of_its_outline(r, z, rim):
    class Pore:
        pore_radius_nm, membrane_nm, rim_radius_nm = 25.0, 20.0, rim

    rod = rod_parameters(RodOptions(), Pore())
    distance, along_r, along_z = wall_distance(r, z, rod)
    angle = np.linspace(0.0, math.pi / 2, 2001)
    upper_r = np.concatenate([np.linspace(25 + rim, 200, 7001), 25 + rim * (1 - np.cos(angle))])
    upper_z = np.concatenate([np.full(7001, 10.0), 10 - rim * (1 - np.sin(angle))])
    lumen_z = np.linspace(-10 + rim, 10 - rim, 2001)
    outline_r = np.concatenate([upper_r, upper_r, np.full(2001, 25.0)])
    outline_z = np.concatenate([upper_z, -upper_z, lumen_z])
    nearest = np.hypot(outline_r - r, outline_z - z).min()
    if distance >= 0.0:
        assert nearest == pytest.approx(distance, abs=2e-2)
    else:
        # Inside, the way out by a face or the lumen is at least as long as the shortest way.
        assert nearest <= -distance + 2e-2
    assert math.hypot(along_r, along_z) == pytest.approx(1.0)


@pytest.mark.parametrize("contact", ["segments", "vertices"])
@pytest.mark.parametrize("rim", [0.0, 2.0])
def test_contact_force_is_the_gradient_of_its_energy_to_1e_8(make_pore, gradient, contact, rim):
    rod = rod_parameters(RodOptions(contact=contact), make_pore(rim_radius_nm=rim))
    x = on_the_rim()
    force = contact_force(x, rod)
    assert np.count_nonzero(np.abs(force).max(axis=1)) >= 3
    # Steps of 1e-5 nm stay within the parts of the wall on which the energy is smooth.
    slope = gradient(contact_energy, x, rod, 1e-5)
    assert np.abs(force - slope).max() < 1e-8 * np.abs(force).max()


@pytest.mark.parametrize("contact", ["segments", "vertices"])
def test_a_flat_rod_sinks_as_deep_in_either_contact(pore, contact):
    rod = rod_parameters(RodOptions(contact=contact), pore)
    x = np.zeros((51, 3))
    x[:, 0] = 9.0 * np.arange(51)
    x[:, 1] = 100.0
    x[:, 2] = 12.5
    force = contact_force(x, rod)
    # k times half a nanometre on each vertex, at the ends half of it for half a segment.
    np.testing.assert_allclose(force[1:-1], np.tile([0.0, 0.0, 2.5], (49, 1)), atol=1e-12)
    ends = 1.25 if contact == "segments" else 2.5
    np.testing.assert_allclose(force[[0, -1], 2], ends)


def test_a_segment_that_cuts_the_rim_is_held_although_its_vertices_are_free(pore):
    # The chord of 9 nm touches the rim's edge in its middle; its ends keep 3 nm and more.
    x = np.array([[28.1, 0.0, 13.1], [21.8, 0.0, 6.7]])
    vertices = rod_parameters(RodOptions(n_vertices=3, contact="vertices"), pore)
    segments = rod_parameters(RodOptions(n_vertices=3), pore)
    assert not contact_force(x, vertices).any()
    force = contact_force(x, segments).sum(axis=0)
    # Two thirds of 3 nm at 5 pN/nm, upwards and into the hole.
    assert np.linalg.norm(force) > 5.0
    assert force[0] < 0.0 < force[2]
    assert force[1] == 0.0


def test_one_point_of_a_segment_holds_with_nearly_half_the_stiffness(pore):
    rod = rod_parameters(RodOptions(n_vertices=3), pore)
    # Only the tip of a rod that stands on the membrane touches.
    x = np.array([[60.0, 0.0, 12.0], [60.0, 0.0, 21.0]])
    assert contact_force(x, rod).sum(axis=0)[2] == pytest.approx(5.0 * 5**-0.5)


@pytest.mark.parametrize("wall", ["signed_distance", "z_only"])
def test_a_rod_clear_of_the_membrane_feels_nothing(pore, wall):
    rod = rod_parameters(RodOptions(wall=wall), pore)
    x = np.zeros((51, 3))
    x[:, 0] = np.linspace(-225.0, 225.0, 51)
    x[:, 2] = 13.0
    assert not contact_force(x, rod).any()
    assert contact_energy(x, rod) == 0.0
    in_the_pore = np.zeros((51, 3))
    in_the_pore[:, 2] = np.linspace(-225.0, 225.0, 51)
    in_the_pore[:, 0] = 15.0
    assert not contact_force(in_the_pore, rod).any()


def test_the_wall_of_the_paper_only_pushes_up_and_only_outside_the_hole(pore):
    rod = rod_parameters(RodOptions(wall="z_only", n_vertices=4), pore)
    x = np.array([[24.0, 0.0, 5.0], [26.0, 0.0, 5.0], [0.0, -60.0, -40.0], [60.0, 0.0, 14.0]])
    force = contact_force(x, rod)
    np.testing.assert_allclose(force[:, 2], [0.0, 5.0 * 8.0, 5.0 * 53.0, 0.0])
    assert not force[:, :2].any()
    # A signed distance lets the vertex below the membrane be, and pushes the second sideways.
    other = contact_force(x, rod_parameters(RodOptions(n_vertices=4, contact="vertices"), pore))
    assert not other[2].any()
    np.testing.assert_allclose(other[1], [-5.0 * 4.0, 0.0, 0.0])


@pytest.mark.parametrize("options", [{"wall": "none"}, {"wall_stiffness_pn_nm": 0.0}])
def test_no_wall_no_push(pore, options):
    assert not contact_force(on_the_rim(), rod_parameters(RodOptions(**options), pore)).any()


def test_without_a_field_there_is_no_membrane():
    assert not contact_force(on_the_rim(), rod_parameters(RodOptions(), None)).any()


@pytest.mark.parametrize("wall", ["signed_distance", "z_only"])
@pytest.mark.parametrize("contact", ["segments", "vertices"])
def test_hessian_bounds_the_true_stiffness_and_pulls_nowhere(make_pore, wall, contact):
    rod = rod_parameters(RodOptions(wall=wall, contact=contact), make_pore(rim_radius_nm=1.0))
    x = on_the_rim()
    blocks = np.zeros((51, 3, 3))
    add_contact_hessian(x, rod, blocks)
    np.testing.assert_allclose(blocks, blocks.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(blocks).min() > -1e-9
    true = np.zeros((153, 153))
    for j in range(153):
        sides = []
        for step in (1e-6, -1e-6):
            moved = x.copy()
            moved.reshape(-1)[j] += step
            sides.append(contact_force(moved, rod).reshape(-1))
        true[:, j] = -(sides[0] - sides[1]) / 2e-6
    lumped = np.zeros((153, 153))
    for i in range(51):
        lumped[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = blocks[i]
    # A linearly implicit step is stable if twice its stiffness is at least the true one.
    worst = np.linalg.eigvalsh(2.0 * lumped - (true + true.T) / 2.0).min()
    assert worst > -1e-3 * np.abs(true).max()


def test_hessian_of_a_vertex_in_the_lumen_is_exact(pore):
    rod = rod_parameters(RodOptions(contact="vertices", n_vertices=3), pore)
    x = np.array([[14.0, 18.0, 1.0], [0.0, 0.0, 5.0], [0.0, 0.0, 20.0]])
    blocks = np.zeros((3, 3, 3))
    add_contact_hessian(x, rod, blocks)
    for j in range(3):
        sides = []
        for step in (1e-5, -1e-5):
            moved = x.copy()
            moved[0, j] += step
            sides.append(contact_force(moved, rod)[0])
        np.testing.assert_allclose(blocks[0, j], -(sides[0] - sides[1]) / 2e-5, atol=1e-6)


def plain_energy(x, rod):
    """Fourth power mean of five penetrations a segment, one segment after another."""
    total = 0.0
    for low, high in itertools.pairwise(x):
        depths = []
        for share in np.linspace(0.0, 1.0, 5):
            px, py, pz = (1 - share) * low + share * high
            depths.append(max(3.0 - wall_distance(math.hypot(px, py), pz, rod)[0], 0.0))
        total += 0.5 * 5.0 * math.sqrt(np.mean(np.array(depths) ** 4))
    return total


@given(st.integers(0, 2**32 - 1), st.sampled_from([-12.0, 12.0]))
def test_contact_is_that_of_the_plain_power_mean_near_faces_and_hole(seed, height_nm):
    class Pore:
        pore_radius_nm, membrane_nm, rim_radius_nm = 25.0, 20.0, 1.0

    rng = np.random.default_rng(seed)
    rod = rod_parameters(RodOptions(n_vertices=11, length_nm=90.0), Pore())
    x = np.cumsum(rng.normal([7.0, 0.0, 0.0], [2.0, 2.0, 1.5], (11, 3)), axis=0)
    x += [rng.uniform(-60.0, 20.0), rng.uniform(-20.0, 20.0), height_nm]
    assert contact_energy(x, rod) == pytest.approx(plain_energy(x, rod), rel=1e-9, abs=1e-12)
    step = rng.normal(size=x.shape)
    slope = (plain_energy(x + 1e-5 * step, rod) - plain_energy(x - 1e-5 * step, rod)) / 2e-5
    size = np.abs(contact_force(x, rod)).sum() + 1.0
    assert -np.sum(contact_force(x, rod) * step) == pytest.approx(slope, abs=1e-4 * size)
