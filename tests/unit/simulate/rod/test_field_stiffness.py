import numpy as np
import pytest

from rotortrack.simulate.rod.banded import HALF_BAND, WIDTH
from rotortrack.simulate.rod.field_stiffness import add_to_halves, write_field_stiffness
from rotortrack.simulate.rod.forces import add_field_force
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import rod_parameters

from .steps import arc, at, toy_field

FIELD = toy_field()
TABLE = FIELD.r_nm, FIELD.z_nm, FIELD.nodes


def force_on_segment(x, i, shift, rod):
    force = np.zeros((2, 3))
    add_field_force(np.ascontiguousarray(x[i : i + 2] + shift), rod, *TABLE, force)
    return force.sum(axis=0)


@pytest.mark.parametrize("place", [(3.0, 2.0, 18.0), (30.0, -60.0, 30.0), (150.0, 0.0, 40.0)])
def test_stiffness_is_minus_the_slope_of_the_force(place):
    rod = rod_parameters(RodOptions(), FIELD)
    x = at(arc(), *place)
    stiffness = np.empty((50, 3, 3))
    write_field_stiffness(x, rod, *TABLE, stiffness)
    for i in (0, 17, 25, 49):
        slopes = np.empty((3, 3))
        for d, axis in enumerate(np.eye(3)):
            further = force_on_segment(x, i, 1e-2 * axis, rod)
            nearer = force_on_segment(x, i, -1e-2 * axis, rod)
            slopes[:, d] = (further - nearer) / 2e-2
        np.testing.assert_allclose(stiffness[i], -slopes, atol=6e-3 * np.abs(slopes).max())


def test_stiffness_on_the_axis_is_the_limit_of_that_beside_it():
    rod = rod_parameters(RodOptions(), FIELD)
    x = np.zeros((3, 3))
    x[:, 2] = [20.0, 29.0, 38.0]
    on_axis, beside = np.empty((2, 3, 3)), np.empty((2, 3, 3))
    write_field_stiffness(x, rod, *TABLE, on_axis)
    write_field_stiffness(at(x, 0.06, 0.08, 0.0), rod, *TABLE, beside)
    assert np.isfinite(on_axis).all()
    np.testing.assert_allclose(on_axis, beside, atol=2e-2 * np.abs(beside).max())


def test_halves_hold_a_quarter_for_each_pair_of_vertices():
    stiffness = np.random.default_rng(0).normal(size=(2, 3, 3))
    size = 11
    band, low = np.zeros((size + HALF_BAND, WIDTH)), np.zeros((size + HALF_BAND, WIDTH))
    add_to_halves(stiffness, 0.5, band, low)
    matrix = np.zeros((size, size))
    for k in range(HALF_BAND + 1):
        matrix += np.diag(band[: size - k, k], k)
        if k:
            matrix += np.diag(low[: size - k, k], -k)
    exact = np.zeros((size, size))
    for i in range(2):
        mean = np.zeros((3, size))
        mean[:, 4 * i : 4 * i + 3] = mean[:, 4 * i + 4 : 4 * i + 7] = 0.5 * np.eye(3)
        exact += 0.5 * mean.T @ stiffness[i] @ mean
    np.testing.assert_allclose(matrix, exact, atol=1e-14)
