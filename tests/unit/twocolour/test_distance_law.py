"""The law of measured lengths is exact, from a distance of nothing to ten thousand noises."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, special

from rotortrack.twocolour.distance_law import log_density, log_density_slopes

BREATHING = (0.0, 0.1, 0.8, 10.0, 1000.0)


def by_quadrature(r, m, b):
    """Take the density for noise 1 by adaptive quadrature over the direction."""
    along = 1.0 + b * b

    def exponent(u):
        return -((r * math.cos(u) - m) ** 2) / (2 * along) - (r * math.sin(u)) ** 2 / 2

    # The peaks: towards either end of the range, or where the derivative vanishes between.
    inside = [0.0, math.pi]
    cosine = m / (r * (1 - along)) if b > 0 else math.inf
    if abs(cosine) < 1:
        inside.append(math.acos(cosine))
    top = max(exponent(u) for u in inside)
    width = 1.0 / math.sqrt(max(m * r / along + r * r * b * b / along, 1.0))
    breaks = sorted({min(k * width, math.pi) for k in (0, 1, 3, 6, 12, 1e9)})
    breaks = sorted({*breaks, *(math.pi - u for u in breaks)})
    total = sum(
        integrate.quad(
            lambda u: math.exp(exponent(u) - top), low, high, epsabs=1e-10 * width, epsrel=1e-9
        )[0]
        for low, high in itertools.pairwise(breaks)
    )
    return math.log(r / (math.pi * math.sqrt(along))) + top + math.log(total)


@pytest.mark.parametrize("breathing", BREATHING)
@pytest.mark.parametrize("mean", [0.0, 0.3, 1.0, 4.0, 30.0, 1e4])
def test_it_is_the_integral_over_directions(mean, breathing):
    wide = math.hypot(1.0, breathing)
    lengths = np.abs(mean + wide * np.array([-3.1, -1.3, 0.01, 0.7, 5.0]))
    expected = [by_quadrature(r, mean, breathing) for r in lengths]
    found = log_density(lengths, np.ones(5), mean, breathing)
    # A density's exponent of thousands is not known better than its rounding.
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-7)


@given(st.floats(1e-3, 1e4), st.floats(0.0, 1e4), st.floats(0.1, 100.0), st.floats(-4.0, 4.0))
def test_without_breathing_it_is_rices_law(r, mean, noise, off):
    r = abs(mean + off * noise) + 1e-3 * r
    k = r * mean / noise**2
    rice = np.log(r / noise**2) - (r - mean) ** 2 / (2 * noise**2) + np.log(special.i0e(k))
    found = log_density(np.array([r]), np.array([noise]), mean, 0.0)[0]
    assert found == pytest.approx(rice, rel=1e-9, abs=1e-7)


@pytest.mark.parametrize(
    ("mean", "breathing"), [(0.0, 0.0), (25.0, 0.0), (60.0, 25.0), (5.0, 200.0), (0.0, 30.0)]
)
def test_it_is_a_density(mean, breathing):
    top = mean + 12 * math.hypot(30.0, breathing)
    total, _ = integrate.quad(
        lambda r: math.exp(log_density(np.array([r]), np.array([30.0]), mean, breathing)[0]),
        0.0, top, limit=200, epsabs=1e-10,
    )  # fmt: skip
    assert total == pytest.approx(1.0, abs=1e-8)


def test_breathing_beyond_the_mean_gives_lengths_as_drawn():
    rng = np.random.default_rng(4)
    true = 10.0 + 40.0 * rng.normal(size=200_000)
    drawn = np.hypot(true + 15.0 * rng.normal(size=true.size), 15.0 * rng.normal(size=true.size))
    edges = np.linspace(0.0, 150.0, 16)
    grid = np.linspace(0.0, 150.0, 15 * 200 + 1)
    density = np.exp(log_density(grid, np.full(grid.size, 15.0), 10.0, 40.0))
    shares = np.diff(integrate.cumulative_trapezoid(density, grid, initial=0.0)[::200])
    counts, _ = np.histogram(drawn, edges)
    pull = (counts - shares * true.size) / np.sqrt(shares * true.size)
    assert np.sqrt(np.mean(pull**2)) < 1.6


@given(
    st.floats(0.0, 300.0),
    st.floats(0.0, 100.0),
    st.floats(1.0, 60.0),
    st.floats(0.5, 500.0),
    st.floats(1e-3, 1e3),
)
def test_a_change_of_unit_changes_nothing(mean, breathing, noise, length, unit):
    one = log_density(np.array([length]), np.array([noise]), mean, breathing)
    other = log_density(
        np.array([unit * length]), np.array([unit * noise]), unit * mean, unit * breathing
    )
    np.testing.assert_allclose(other + math.log(unit), one, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("breathing", BREATHING[:4])
@pytest.mark.parametrize("mean", [0.0, 0.5, 2.0, 50.0, 3000.0])
def test_slopes_are_those_of_the_logarithm(mean, breathing):
    wide = math.hypot(1.0, breathing)
    lengths, noise = mean + wide * np.array([0.2, 1.0, 3.0]), np.ones(3)
    step = 1e-4

    def at(by_mean=0.0, by_breathing=0.0, by_noise=0.0):
        # The law is even in mean and breathing.
        return log_density(
            lengths, noise * math.exp(by_noise), abs(mean + by_mean), abs(breathing + by_breathing)
        )

    slopes = log_density_slopes(lengths, noise, mean, breathing)
    np.testing.assert_array_equal(slopes[:, 0], at())
    for column, name in enumerate(("by_mean", "by_breathing", "by_noise"), start=1):
        plain = (at(**{name: step}) - at(**{name: -step})) / (2 * step)
        np.testing.assert_allclose(slopes[:, column], plain, rtol=1e-5, atol=1e-5)


def test_frames_have_their_own_noise():
    lengths, noise = np.array([20.0, 40.0, 60.0]), np.array([5.0, 20.0, 80.0])
    together = log_density(lengths, noise, 30.0, 10.0)
    apart = [log_density(lengths[i : i + 1], noise[i : i + 1], 30.0, 10.0)[0] for i in range(3)]
    np.testing.assert_array_equal(together, apart)


def test_no_length_has_no_logarithm():
    assert log_density(np.zeros(1), np.ones(1), 5.0, 1.0)[0] == -math.inf
