import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.simulate.rod.forces import NO_NODES
from rotortrack.simulate.rod.implicit import look, new_shape
from rotortrack.simulate.rod.projection import constrained_velocity, project_lengths

from .steps import arc, free_rod, straight


def room(n):
    return np.zeros((n - 1, 3)), np.zeros((3, n - 1))


def constraint_matrix(x):
    """J: row i gives the rate at which link i grows."""
    n = len(x)
    links = np.diff(x, axis=0)
    links /= np.linalg.norm(links, axis=1, keepdims=True)
    matrix = np.zeros((n - 1, 3 * n))
    for i in range(n - 1):
        matrix[i, 3 * i : 3 * i + 3] = -links[i]
        matrix[i, 3 * i + 3 : 3 * i + 6] = links[i]
    return matrix


def drag_matrix(shape):
    blocks = [
        across * np.eye(3) + (along - across) * np.outer(t, t)
        for t, (across, along) in zip(shape.tangent, shape.drag, strict=True)
    ]
    n = len(blocks)
    matrix = np.zeros((3 * n, 3 * n))
    for i, block in enumerate(blocks):
        matrix[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    return matrix


@given(st.integers(3, 40), st.integers(0, 10_000))
def test_velocity_is_that_of_the_dense_constrained_system(n, seed):
    rng = np.random.default_rng(seed)
    rod = free_rod(n)
    x = arc(n, 450.0 / (n - 1))
    shape = new_shape(n)
    look(x, rod, *NO_NODES, shape)
    shape.force[:] = rng.normal(size=(n, 3))
    velocity = np.empty((n, 3))
    directions, tri = room(n)
    constrained_velocity(x, shape.force, shape.tangent, shape.drag, directions, tri, velocity)

    jacobian, drag = constraint_matrix(x), drag_matrix(shape)
    matrix = np.block([[drag, jacobian.T], [jacobian, np.zeros((n - 1, n - 1))]])
    exact = np.linalg.solve(matrix, np.concatenate([shape.force.ravel(), np.zeros(n - 1)]))
    np.testing.assert_allclose(velocity.ravel(), exact[: 3 * n], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(tri[2], exact[3 * n :], rtol=1e-8, atol=1e-10)
    # The tensions do no work: what the forces put in is what friction takes out.
    power = np.sum(shape.force * velocity)
    np.testing.assert_allclose(power, velocity.ravel() @ drag @ velocity.ravel(), rtol=1e-9)


def test_tension_of_a_rod_pulled_at_its_end_falls_linearly_to_the_other():
    n, pull = 51, 2.0
    rod = free_rod(n)
    x = straight(n, direction=(0.3, -0.5, 0.8))
    axis = (x[-1] - x[0]) / 450.0
    shape = new_shape(n)
    look(x, rod, *NO_NODES, shape)
    shape.force[:] = 0.0
    shape.force[-1] = pull * axis
    velocity = np.empty((n, 3))
    directions, tri = room(n)
    constrained_velocity(x, shape.force, shape.tangent, shape.drag, directions, tri, velocity)
    middles = (np.arange(n - 1) + 0.5) / (n - 1)
    np.testing.assert_allclose(tri[2], pull * middles, rtol=1e-10)
    along = np.pi * 1e-3 / 2.0
    np.testing.assert_allclose(velocity, np.tile(pull * axis / (along * 450.0), (n, 1)), rtol=1e-9)


@pytest.mark.parametrize(("strain", "most"), [(1e-5, 1), (1e-4, 2), (1e-3, 3)])
def test_links_are_brought_back_in_few_solves(strain, most):
    n = 51
    rod = free_rod(n)
    x = arc(n)
    shape = new_shape(n)
    look(x, rod, *NO_NODES, shape)
    x += 9.0 * strain * np.random.default_rng(1).normal(size=x.shape) / 3.0
    solves = project_lengths(x, 9.0, shape.tangent, shape.drag, *room(n))
    lengths = np.linalg.norm(np.diff(x, axis=0), axis=1)
    assert 1 <= solves <= most
    np.testing.assert_allclose(lengths, 9.0, rtol=1e-9)


def test_projection_moves_neither_the_friction_centre_nor_turns_a_rod():
    """Corrections of length are internal forces."""
    n = 51
    x = arc(n)
    shape = new_shape(n)
    look(x, free_rod(n), *NO_NODES, shape)
    shape.drag[:, 1] = shape.drag[:, 0]
    moved = x + np.random.default_rng(2).normal(0.0, 0.003, size=x.shape)
    before = moved.copy()
    project_lengths(moved, 9.0, shape.tangent, shape.drag, *room(n))
    push = shape.drag[:, :1] * (moved - before)
    assert np.abs(push).max() > 1e-6
    np.testing.assert_allclose(push.sum(axis=0), 0.0, atol=1e-13)
    # The pushes act along the links of each pass, which the corrections themselves turn a little.
    torque = np.cross(before, push).sum(axis=0)
    assert np.abs(torque).max() < 1e-4 * np.abs(np.cross(before, push)).sum()


def test_links_twice_too_long_are_refused():
    n = 11
    rod = free_rod(n)
    x = straight(n)
    shape = new_shape(n)
    look(x, rod, *NO_NODES, shape)
    assert project_lengths(2.0 * x, 45.0, shape.tangent, shape.drag, *room(n)) == -1
