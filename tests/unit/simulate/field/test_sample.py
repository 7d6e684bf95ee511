"""Bicubic sampling: smooth everywhere, symmetric as the fields are, sensible off the table."""

from time import thread_time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.simulate.field.sample import (
    QUANTITIES,
    hermite_nodes,
    sample_field,
    sample_fields,
)

R_NM = np.concatenate(([0.0], np.cumsum(1.3 ** np.arange(12))))
Z_NM = np.concatenate((-R_NM[:0:-1] - 1.0, [-0.4, 0.5], R_NM[1:] + 2.0))
RADIAL = np.array([name.endswith("_r") for name in QUANTITIES])


def sampled(table, points):
    points = np.ascontiguousarray(np.atleast_2d(points), dtype=float)
    out = np.full((len(points), 4, 3), np.nan)
    sample_fields(*table, points, out)
    return out


def tabulated(function):
    """Table of multiples of function(r, z, radial)."""
    r, z = np.meshgrid(R_NM, Z_NM, indexing="ij")
    values = np.empty((R_NM.size, Z_NM.size, 8))
    for k in range(8):
        values[..., k] = (k + 1) * function(r, z, RADIAL[k])
    return R_NM, Z_NM, hermite_nodes(R_NM, Z_NM, values)


@pytest.fixture(scope="module")
def rough():
    """A table of random numbers: nothing but the scheme itself makes it smooth."""
    values = np.random.default_rng(3).normal(size=(R_NM.size, Z_NM.size, 8))
    values[0, :, RADIAL] = 0.0
    return R_NM, Z_NM, hermite_nodes(R_NM, Z_NM, values)


inside_r = st.floats(0.0, R_NM[-1])
inside_z = st.floats(Z_NM[0], Z_NM[-1])
turns = st.floats(0.0, 2 * np.pi)


def test_grid_points_give_their_values_back(rough):
    r_nm, z_nm, nodes = rough
    r, z = np.meshgrid(r_nm, z_nm, indexing="ij")
    points = np.stack((r.ravel(), np.zeros(r.size), z.ravel()), axis=1)
    found = sampled(rough, points)
    wanted = nodes[..., 0].reshape(-1, 4, 2)
    np.testing.assert_allclose(found[:, :, 0], wanted[..., 0], atol=1e-12)
    np.testing.assert_allclose(found[:, :, 2], wanted[..., 1], atol=1e-12)
    assert not found[:, :, 1].any()


def test_parabolas_that_are_odd_or_even_in_r_are_exact():
    def parabola(r, z, radial):
        along_z = 1.0 - 0.3 * z + 0.02 * z**2
        return (0.7 * r if radial else 1.0 + 0.05 * r**2) * along_z

    table = tabulated(parabola)
    rng = np.random.default_rng(1)
    # The outermost cells lead over to the fields beyond the table.
    r = rng.uniform(0.0, R_NM[-2], 500)
    z = rng.uniform(Z_NM[1], Z_NM[-2], 500)
    found = sampled(table, np.stack((r, 0 * r, z), axis=1))
    for k, radial in enumerate(RADIAL):
        part = found[:, k // 2, 0 if radial else 2]
        np.testing.assert_allclose(part, (k + 1) * parabola(r, z, radial), rtol=1e-10, atol=1e-10)


def test_error_falls_with_the_third_power_of_the_spacing_or_faster():
    def wave(r, z):
        return np.sin(r / 3.0) * np.cos(z / 4.0)

    errors = []
    for count in (20, 40, 80):
        r_nm, z_nm = np.linspace(0.0, 10.0, count + 1), np.linspace(-10.0, 10.0, 2 * count + 1)
        r, z = np.meshgrid(r_nm, z_nm, indexing="ij")
        values = np.repeat(wave(r, z)[..., None], 8, axis=2)
        points = np.random.default_rng(2).uniform(-5.0, 5.0, (2000, 3))
        points[:, 1] = 0.0
        found = sampled((r_nm, z_nm, hermite_nodes(r_nm, z_nm, values)), points)
        errors.append(np.abs(found[:, 2, 0] - wave(points[:, 0], points[:, 2])).max())
    assert errors[0] / errors[1] > 7.0
    assert errors[1] / errors[2] > 7.0


def jump_of_slope(table, point, direction):
    """Difference of the slopes on either side of a point, along a direction; largest slope."""
    step = 1e-5
    here = sampled(table, point)
    ahead = (sampled(table, point + step * direction) - here) / step
    behind = (here - sampled(table, point - step * direction)) / step
    return np.abs(ahead - behind).max(), np.abs(ahead).max()


@settings(deadline=None, max_examples=60)
@given(line=st.integers(1, R_NM.size - 2), z=inside_z, turn=turns, along_z=st.floats(-1, 1))
def test_slopes_are_continuous_across_cylinders(rough, line, z, turn, along_z):
    out = np.array([np.cos(turn), np.sin(turn), 0.0])
    point = R_NM[line] * out + np.array([0.0, 0.0, z])
    jump, _ = jump_of_slope(rough, point, out + np.array([0.0, 0.0, along_z]))
    assert jump < 1e-3


@settings(deadline=None, max_examples=60)
@given(line=st.integers(1, Z_NM.size - 2), r=inside_r, turn=turns, along_r=st.floats(-1, 1))
def test_slopes_are_continuous_across_planes(rough, line, r, turn, along_r):
    point = np.array([r, 0.0, Z_NM[line]])
    direction = np.array([along_r * np.cos(turn), along_r * np.sin(turn), 1.0])
    jump, _ = jump_of_slope(rough, point, direction)
    assert jump < 1e-3


@settings(deadline=None, max_examples=60)
@given(z=inside_z, turn=turns, along_z=st.floats(-1, 1))
def test_slopes_are_continuous_across_the_axis(rough, z, turn, along_z):
    direction = np.array([np.cos(turn), np.sin(turn), along_z])
    jump, _ = jump_of_slope(rough, np.array([0.0, 0.0, z]), direction)
    assert jump < 1e-3


@settings(deadline=None, max_examples=60)
@given(r=inside_r, z=inside_z, beyond=st.floats(1.0, 3.0), turn=turns)
def test_turning_a_point_turns_its_fields(rough, r, z, beyond, turn):
    turned = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    point = beyond * np.array([r, 0.0, z])
    found = sampled(rough, turned @ point)[0]
    np.testing.assert_allclose(found, sampled(rough, point)[0] @ turned.T, rtol=1e-9, atol=1e-9)


@settings(deadline=None, max_examples=60)
@given(x=st.floats(-60, 60), y=st.floats(-60, 60), z=st.floats(-80, 80))
def test_radial_parts_are_odd_across_the_axis(rough, x, y, z):
    here, there = sampled(rough, [[x, y, z], [-x, -y, z]])
    np.testing.assert_array_equal(here[:, :2], -there[:, :2])
    np.testing.assert_array_equal(here[:, 2], there[:, 2])


@pytest.mark.parametrize("r", [0.0, 5e-324, 1e-200, 1e-9])
def test_radial_parts_vanish_on_the_axis(rough, r):
    found = sampled(rough, [r, -r, 3.0])[0]
    assert np.isfinite(found).all()
    assert np.abs(found[:, :2]).max() <= 10.0 * r


@settings(deadline=None, max_examples=60)
@given(r=st.floats(0.0, 1.0), turn=turns, up=st.booleans(), beyond=st.floats(1.0, 1e6))
def test_fields_beyond_the_table_fall_with_the_square_of_the_distance(rough, r, turn, up, beyond):
    edge = Z_NM[-1] if up else Z_NM[0]
    for rim in ([r * R_NM[-1], edge], [R_NM[-1], r * edge]):
        point = np.array([rim[0] * np.cos(turn), rim[0] * np.sin(turn), rim[1]])
        near, far = sampled(rough, [point, beyond * point])
        np.testing.assert_allclose(far * beyond**2, near, rtol=1e-6, atol=1e-6)


def test_slopes_are_continuous_across_the_tables_edge():
    def steep(r, z, radial):
        # Within, it falls much faster than the fields beyond: both must be led over.
        return (r if radial else 1.0) * np.exp(-((r**2 + z**2) / 40.0**2))

    table = tabulated(steep)
    shares = np.random.default_rng(5).uniform(-1.0, 1.0, 100)
    side = np.stack((np.full(100, R_NM[-1]), 0 * shares, shares * Z_NM[-1]), axis=1)
    top = np.stack((np.abs(shares) * R_NM[-1], 0 * shares, np.copysign(Z_NM[-1], shares)), axis=1)
    at_nodes = np.stack((np.full(Z_NM.size, R_NM[-1]), 0 * Z_NM, Z_NM), axis=1)
    # Between grid points the two sides are cubics of slightly different slopes; with the table's
    # own slopes at its edge the jump would be 2.6 times the slope beyond.
    assert np.median(jumps_over_slope(table, np.concatenate((side, top)))) < 0.02
    assert np.max(jumps_over_slope(table, at_nodes)) < 2e-3


def jumps_over_slope(table, points):
    """Jump of the slope along the ray through points on the edge, over that just beyond."""
    jumps = []
    for point in points:
        distance = np.linalg.norm(point)
        jump, _ = jump_of_slope(table, point, point / distance)
        jumps.append(jump * distance / (2.0 * np.abs(sampled(table, point)).max()))
    return jumps


def test_one_point_is_as_many_points(rough):
    out = np.empty((4, 3))
    sample_field(*rough, 3.0, -4.0, 5.0, out)
    np.testing.assert_array_equal(out, sampled(rough, [3.0, -4.0, 5.0])[0])


def test_cost_does_not_grow_with_the_tables_size():
    def seconds(count):
        r_nm, z_nm = np.linspace(0.0, 500.0, count), np.linspace(-500.0, 500.0, count)
        nodes = np.zeros((count, count, 8, 4))
        # A rod's neighbours stay in a few cells: the memory of a table is not what is measured.
        points = np.random.default_rng(0).uniform(10.0, 11.0, (20_000, 3))
        out = np.empty((len(points), 4, 3))
        best = np.inf
        for _ in range(6):
            begun = thread_time()
            sample_fields(r_nm, z_nm, nodes, points, out)
            best = min(best, thread_time() - begun)
        return best

    assert seconds(400) < 4.0 * seconds(20)
