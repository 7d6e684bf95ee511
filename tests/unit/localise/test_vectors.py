"""Vectors compute what numpy computes in float32, lane by lane."""

from __future__ import annotations

import numba
import numpy as np
import pytest
import scipy.special

from rotortrack.localise.lane_math import deviance, exp_minus, profile
from rotortrack.localise.vectors import (
    LANES,
    all_lanes,
    bits,
    exp2_parts,
    larger,
    load,
    log2_parts,
    select,
    smaller,
    sqrt,
    store,
)

compiled = numba.njit(error_model="numpy")


@compiled
def arithmetic(a, b, results):
    x = load(a, 0)
    y = load(b, 0)
    store(results, 0, x + y)
    store(results, 1, x - 2.0)
    store(results, 2, 3 * x)
    store(results, 3, x / y)
    store(results, 4, -abs(x))
    store(results, 5, smaller(x, y))
    store(results, 6, larger(x, y))
    store(results, 7, select((x < y) & ~(x <= -0.5), x, 7.0))
    store(results, 8, sqrt(abs(x)))
    z = all_lanes(1.0)
    z += x
    z *= y
    z -= 0.5
    store(results, 9, z)
    return bits((x > y) | (x >= 1.0))


def test_arithmetic_is_that_of_numpy():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(2, LANES)).astype(np.float32)
    results = np.zeros(10 * LANES, np.float32)
    packed = arithmetic(x, y, results)
    one = np.float32(1)
    expected = [
        x + y,
        x - 2,
        3 * x,
        x / y,
        -np.abs(x),
        np.minimum(x, y),
        np.maximum(x, y),
        np.where((x < y) & ~(x <= -0.5), x, 7),
        np.sqrt(np.abs(x)),
        (one + x) * y - np.float32(0.5),
    ]
    np.testing.assert_allclose(results.reshape(10, LANES), expected, rtol=2e-7, atol=1e-7)
    assert packed == sum(1 << lane for lane in range(LANES) if x[lane] > y[lane] or x[lane] >= 1)


@compiled
def extremes(a, results):
    x = load(a, 0)
    store(results, 0, smaller(x, 1.0))
    store(results, 1, larger(x, 1.0))
    store(results, 2, select(x < 1.0, 1.0, 0.0))


def test_a_lane_without_a_number_takes_the_second_of_both_and_compares_as_false():
    results = np.zeros(3 * LANES)
    extremes(np.full(LANES, np.nan, np.float32), results)
    np.testing.assert_array_equal(results.reshape(3, LANES)[:, 0], [1.0, 1.0, 0.0])


@compiled
def parts(a, results):
    power, rest = exp2_parts(load(a, 0))
    store(results, 0, power)
    store(results, 1, rest)
    exponent, mantissa = log2_parts(abs(load(a, 0)))
    store(results, 2, exponent)
    store(results, 3, mantissa)


def test_parts_put_together_are_the_number():
    x = np.random.default_rng(2).uniform(-120, 120, LANES).astype(np.float32)
    results = np.zeros(4 * LANES)
    parts(x, results)
    power, rest, exponent, mantissa = results.reshape(4, LANES)
    np.testing.assert_allclose(np.log2(power) + rest, x, rtol=1e-6)
    assert (np.abs(rest) <= 0.5).all()
    np.testing.assert_array_equal(2.0**exponent * mantissa, np.abs(x))
    assert ((mantissa >= 0.70710) & (mantissa < 1.41422)).all()


@compiled
def apply(a, b, results):
    for k in range(a.size // LANES):
        x = load(a, k)
        store(results, k, exp_minus(x))
        u = load(b, k)
        store(results, a.size // LANES + k, deviance(u, 10.0 * u * u, all_lanes(10.0)))


def test_functions_of_lanes_are_exact_to_float32():
    x = np.linspace(0, 80, 64 * LANES).astype(np.float32)
    u = np.concatenate([[-1.0], np.geomspace(1e-6, 100, 64 * LANES - 1)]).astype(np.float32)
    u[1::2] = np.maximum(-u[1::2], -1.0)
    results = np.zeros(128 * LANES)
    apply(x, u, results)
    np.testing.assert_allclose(results[: x.size], np.exp(-x.astype(float)), rtol=3e-7 * 40)
    exact = 20.0 * (scipy.special.xlog1py(1.0 + u.astype(float), u.astype(float)) - u)
    np.testing.assert_allclose(results[x.size :], exact, rtol=3e-5)


@compiled
def along_axis(a, size, values):
    profile(load(a, 0), 1.0 / load(a, 1), size, values)


@pytest.mark.parametrize("sigma", [0.4, 1.2, 5.0])
def test_profiles_are_integrals_of_gaussians_and_their_derivatives(sigma):
    size = 9
    rng = np.random.default_rng(3)
    x = rng.uniform(-2, 2, LANES)
    values = np.zeros(5 * size * LANES, np.float32)
    along_axis(np.concatenate([x, np.full(LANES, sigma)]).astype(np.float32), size, values)
    g, d, s, ds, ss = values.reshape(5, size, LANES)

    def integral(x, sigma):
        edges = np.arange(size + 1)[:, None] - size / 2
        return np.diff(scipy.special.ndtr((edges - x) / sigma), axis=0)

    h = 1e-4
    np.testing.assert_allclose(g, integral(x, sigma), atol=3e-7)
    for values_of, x_step, sigma_step in ((d, h, 0.0), (s, 0.0, h)):
        numeric = integral(x + x_step, sigma + sigma_step) - integral(
            x - x_step, sigma - sigma_step
        )
        np.testing.assert_allclose(values_of, numeric / (2 * h), atol=3e-6 / sigma)
    h = 1e-3
    mixed = [
        sign * integral(x + a * h, sigma + b * h)
        for a, b, sign in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
    ]
    np.testing.assert_allclose(ds, sum(mixed) / (4 * h * h), atol=3e-5 / sigma**2)
    twice = integral(x, sigma + h) - 2 * integral(x, sigma) + integral(x, sigma - h)
    np.testing.assert_allclose(ss, twice / h**2, atol=3e-5 / sigma**2)
