import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.simulate.rod.banded import (
    HALF_BAND,
    WIDTH,
    factor,
    factor_general,
    solve,
    solve_general,
)


def saddle(n, seed):
    """A random matrix of the rod's kind: a stiff band bordered by the directions of links."""
    rng = np.random.default_rng(seed)
    stiff = np.zeros((3 * n, 3 * n))
    for i in range(n - 2):
        d = rng.normal(size=(3, 3)) @ np.kron([1.0, -2.0, 1.0], np.eye(3))
        stiff[3 * i : 3 * i + 9, 3 * i : 3 * i + 9] += d.T @ d * 100.0
    stiff += np.kron(np.diag(rng.uniform(0.01, 1.0, n)), np.eye(3))
    size = 4 * n - 1
    place = np.array([4 * i + c for i in range(n) for c in range(3)])
    matrix = np.zeros((size, size))
    matrix[np.ix_(place, place)] = stiff
    for i in range(n - 1):
        t = rng.normal(size=3)
        t /= np.linalg.norm(t)
        for row, sign in ((4 * i, -1.0), (4 * i + 4, 1.0)):
            matrix[row : row + 3, 4 * i + 3] = sign * t
            matrix[4 * i + 3, row : row + 3] = sign * t
    # Coupling of the components of second neighbours is outside the band.
    for k in range(HALF_BAND + 1, size):
        matrix -= np.diag(np.diag(matrix, k), k) + np.diag(np.diag(matrix, -k), -k)
    return matrix


def to_band(matrix):
    size = len(matrix)
    band = np.zeros((size + HALF_BAND, WIDTH))
    for k in range(HALF_BAND + 1):
        band[: size - k, k] = np.diag(matrix, k)
    return band


def solved(matrix, right):
    size = len(matrix)
    band = to_band(matrix)
    negative = factor(band, size)
    values = np.concatenate([right, np.zeros(HALF_BAND)])
    solve(band, size, values)
    return negative, values[:size]


@given(st.integers(3, 30), st.integers(0, 10_000))
def test_solution_of_a_banded_system_is_numpys(n, seed):
    rng = np.random.default_rng(seed)
    size = 4 * n - 1
    matrix = rng.normal(size=(size, size))
    matrix = np.triu(np.tril(matrix + matrix.T, HALF_BAND), -HALF_BAND) + 60.0 * np.eye(size)
    right = rng.normal(size=size)
    negative, found = solved(matrix, right)
    assert negative == 0
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-9, atol=1e-12)


def test_saddle_point_matrix_of_links_needs_no_pivoting():
    matrix = saddle(51, 3)
    # Cutting the corners of the stiffness must not have cost its definiteness.
    place = np.array([4 * i + c for i in range(51) for c in range(3)])
    matrix[place, place] += 400.0
    assert np.linalg.eigvalsh(matrix[np.ix_(place, place)]).min() > 0.0
    right = np.random.default_rng(4).normal(size=len(matrix))
    negative, found = solved(matrix, right)
    assert negative == 50
    np.testing.assert_allclose(matrix @ found, right, atol=1e-9)


@given(st.integers(3, 30), st.integers(0, 10_000))
def test_solution_of_an_unsymmetric_banded_system_is_numpys(n, seed):
    rng = np.random.default_rng(seed)
    size = 4 * n - 1
    matrix = np.triu(np.tril(rng.normal(size=(size, size)), HALF_BAND), -HALF_BAND)
    matrix += 40.0 * np.diag(np.where(np.arange(size) % 4 == 3, -1.0, 1.0))
    right = rng.normal(size=size)
    band, low = to_band(matrix), to_band(matrix.T)
    assert factor_general(band, low, size) == n - 1
    values = np.concatenate([right, np.zeros(HALF_BAND)])
    solve_general(band, low, size, values)
    np.testing.assert_allclose(values[:size], np.linalg.solve(matrix, right), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_a_pivot_that_is_zero_or_not_finite_is_reported(bad):
    matrix = np.eye(11)
    matrix[5, 5] = bad
    assert factor(to_band(matrix), 11) == -1
    assert factor_general(to_band(matrix), to_band(matrix.T), 11) == -1
