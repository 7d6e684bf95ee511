"""Circle fits: bias, equivariance, degenerate input, hopeless arcs, outliers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.rotors.circle import CircleEnd, fit_circle, occupied_arc_deg

METHODS = ("hyper", "kasa", "pratt", "taubin", "geometric")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("arc_deg", [40.0, 180.0, 360.0])
def test_exact_circle_is_found_exactly(ring, method, arc_deg):
    x, y = ring(np.random.default_rng(1), 50, 120.0, 0.0, arc_deg)
    fit = fit_circle(x + 300.0, y - 40.0, method)
    assert fit.end is CircleEnd.FITTED
    assert (fit.x_nm, fit.y_nm, fit.radius_nm) == pytest.approx((300.0, -40.0, 120.0), rel=1e-9)


def noisy_circle_without_chance(radius, noise):
    """Every direction with every noise direction and every quantile of its length: no scatter."""
    theta, phi = np.arange(9) * 2.0 * np.pi / 9, np.arange(11) * 2.0 * np.pi / 11
    length = noise * np.sqrt(-2.0 * np.log((np.arange(2000) + 0.5) / 2000))
    z = radius * np.exp(1j * theta)[:, None, None] + (
        length[None, :, None] * np.exp(1j * phi)[None, None, :]
    )
    return z.real.ravel(), z.imag.ravel()


@pytest.mark.parametrize(
    ("method", "relative"),
    [("kasa", 0.04), ("taubin", 0.04), ("pratt", 0.08), ("geometric", 0.02)],
)
def test_biased_methods_have_their_known_bias(method, relative):
    # s^2 / R^2 = 0.04 times 1, 1, 2, 1/2, to first order.
    fit = fit_circle(*noisy_circle_without_chance(100.0, 20.0), method)
    assert fit.radius_nm / 100.0 - 1.0 == pytest.approx(relative, abs=0.0065)


def test_hyper_fit_is_unbiased_at_noise_over_radius_0_2():
    fit = fit_circle(*noisy_circle_without_chance(100.0, 20.0))
    assert abs(fit.radius_nm - 100.0) < 0.3


def test_hyper_fit_is_unbiased_on_half_a_circle(ring):
    x, y = ring(np.random.default_rng(3), 400_000, 100.0, 10.0, 180.0)
    assert fit_circle(x, y).radius_nm == pytest.approx(100.0, rel=0.003)


@pytest.mark.parametrize(("arc_deg", "noise"), [(360.0, 10.0), (180.0, 8.0), (120.0, 5.0)])
def test_standard_deviations_are_those_of_the_scatter(ring, arc_deg, noise):
    rng = np.random.default_rng(4)
    pulls = []
    for _ in range(300):
        fit = fit_circle(*ring(rng, 300, 100.0, noise, arc_deg))
        assert fit.end is CircleEnd.FITTED
        pulls.append(
            (
                (fit.radius_nm - 100.0) / fit.radius_sd_nm,
                fit.x_nm / fit.x_sd_nm,
                fit.y_nm / fit.y_sd_nm,
                fit.residual_sd_nm / noise,
            )
        )
    rms = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert np.all(np.abs(rms - 1.0) < 0.15)


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=20, deadline=None)
@given(angle=st.floats(0.0, 6.3), scale=st.sampled_from([1e-9, 1e-3, 1.0, 1e9]))
def test_rotation_and_scale_carry_over(method, angle, scale):
    rng = np.random.default_rng(5)
    theta = rng.uniform(0.0, 4.0, 200)
    z = 100.0 * np.exp(1j * theta) + rng.normal(0, 8, 200) + 1j * rng.normal(0, 8, 200) + 30.0
    plain = fit_circle(z.real, z.imag, method)
    turned = scale * np.exp(1j * angle) * z
    fit = fit_circle(turned.real, turned.imag, method)
    expected = scale * np.exp(1j * angle) * complex(plain.x_nm, plain.y_nm)
    size = 1e-9 * scale * 100.0
    assert abs(complex(fit.x_nm, fit.y_nm) - expected) < size
    assert abs(fit.radius_nm - scale * plain.radius_nm) < size
    assert fit.radius_sd_nm == pytest.approx(scale * plain.radius_sd_nm, rel=1e-6)


@pytest.mark.parametrize(("offset", "tolerance"), [(1e5, 1e-9), (1e8, 1e-6), (1e11, 1e-3)])
@pytest.mark.parametrize("method", METHODS)
def test_offsets_cost_no_more_than_the_rounding_of_the_input(ring, method, offset, tolerance):
    x, y = ring(np.random.default_rng(6), 2000, 100.0, 15.0)
    plain = fit_circle(x, y, method)
    fit = fit_circle(x + offset, y - offset, method)
    assert fit.radius_nm == pytest.approx(plain.radius_nm, abs=tolerance)
    assert fit.x_nm - offset == pytest.approx(plain.x_nm, abs=10.0 * tolerance + offset * 4e-16)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_fewer_than_three_points_are_no_circle(n):
    fit = fit_circle(np.arange(n), np.arange(n) ** 2)
    assert fit.end is CircleEnd.TOO_FEW_POINTS
    assert math.isnan(fit.radius_nm)
    assert math.isnan(fit.x_nm) == (n == 0)


def test_three_points_are_a_circle_without_an_error():
    fit = fit_circle([0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    assert (fit.x_nm, fit.y_nm, fit.radius_nm) == pytest.approx((0.5, 0.5, 0.5**0.5))
    assert math.isnan(fit.radius_sd_nm)
    assert fit.end is CircleEnd.FITTED


@pytest.mark.parametrize("offset", [0.0, 1e8])
def test_identical_points_are_too_few(offset):
    x = np.full(100, 1.0 / 3.0 + offset)
    assert fit_circle(x, x).end is CircleEnd.TOO_FEW_POINTS


@pytest.mark.parametrize("offset", [0.0, 1e8])
@pytest.mark.parametrize("method", METHODS)
def test_collinear_points_are_named_and_keep_their_mean(method, offset):
    t = np.linspace(0.0, 300.0, 40)
    fit = fit_circle(0.6 * t + offset, 0.8 * t, method)
    assert fit.end is CircleEnd.COLLINEAR
    assert math.isnan(fit.radius_nm)
    assert fit.x_nm == pytest.approx(90.0 + offset)


def test_duplicated_points_change_nothing_but_the_error(ring):
    x, y = ring(np.random.default_rng(7), 100, 100.0, 10.0)
    once, twice = fit_circle(x, y), fit_circle(np.tile(x, 2), np.tile(y, 2))
    assert twice.radius_nm == pytest.approx(once.radius_nm, rel=1e-9)


def test_float32_is_promoted_and_missing_positions_ignored(ring):
    x, y = (v.astype(np.float32) for v in ring(np.random.default_rng(8), 500, 100.0, 10.0))
    plain = fit_circle(x.astype(float), y.astype(float))
    assert fit_circle(x, y) == plain
    assert fit_circle(np.append(x, np.nan), np.append(y, 5.0)) == plain


@pytest.mark.parametrize("n", [100, 2000])
def test_a_stuck_spot_gets_no_radius(n):
    # A plain fit gives R = 1.25 s with an error of a few per cent.
    rng = np.random.default_rng(9)
    ends = [fit_circle(*rng.normal(0.0, 15.0, (2, n)), outlier_sd=4.0).end for _ in range(50)]
    assert sum(end is CircleEnd.FITTED for end in ends) <= (3 if n == 100 else 0)


@pytest.mark.parametrize(
    ("arc_deg", "relative_noise"),
    [(20, 0.02), (20, 0.05), (30, 0.05), (30, 0.1), (45, 0.1), (60, 0.1)],
)
def test_hopeless_arcs_get_no_radius_however_many_points(ring, arc_deg, relative_noise):
    rng = np.random.default_rng(10)
    fits = [fit_circle(*ring(rng, 2000, 1.0, relative_noise, arc_deg)) for _ in range(40)]
    wrong = [fit for fit in fits if fit.end is CircleEnd.FITTED]
    assert len(wrong) <= 2
    assert all(math.isnan(fit.radius_sd_nm) for fit in fits if fit not in wrong)


@pytest.mark.parametrize(
    ("arc_deg", "relative_noise"), [(45, 0.02), (90, 0.05), (120, 0.1), (180, 0.2)]
)
def test_deep_enough_arcs_keep_their_radius(ring, arc_deg, relative_noise):
    rng = np.random.default_rng(11)
    radii = [
        fit_circle(*ring(rng, 2000, 1.0, relative_noise, arc_deg)).radius_nm for _ in range(20)
    ]
    assert np.all(np.isfinite(radii))
    assert np.median(radii) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(("arc_deg", "radius"), [(360.0, 60.0), (360.0, 170.0), (180.0, 100.0)])
def test_a_few_gross_outliers_do_not_move_the_circle(ring, arc_deg, radius):
    rng = np.random.default_rng(12)
    kept = []
    for _ in range(30):
        x, y = ring(rng, 500, radius, 12.0, arc_deg)
        away, to = (radius + 200.0) * np.sqrt(rng.random(10)), rng.uniform(0.0, 6.3, 10)
        x, y = np.append(x, away * np.cos(to)), np.append(y, away * np.sin(to))
        kept.append(fit_circle(x, y, outlier_sd=4.0).radius_nm / radius)
    assert np.median(kept) == pytest.approx(1.0, abs=0.01)
    assert np.max(np.abs(np.array(kept) - 1.0)) < 0.08


def test_leaving_out_outliers_costs_a_clean_ring_no_bias(ring):
    x, y = ring(np.random.default_rng(13), 100_000, 100.0, 20.0)
    assert fit_circle(x, y, outlier_sd=4.0).radius_nm == pytest.approx(100.0, rel=0.004)


@pytest.mark.parametrize("arc_deg", [60.0, 150.0, 270.0])
def test_occupied_arc_is_measured_despite_single_false_spots(arc_deg):
    rng = np.random.default_rng(14)
    theta = np.append(np.radians(rng.uniform(-200.0, arc_deg - 200.0, 3000)), [3.0, 4.0, 5.0])
    assert occupied_arc_deg(theta) == pytest.approx(arc_deg, abs=6.0)


def test_occupied_arc_of_a_full_circle_is_360_whatever_the_number_of_points():
    rng = np.random.default_rng(15)
    for n in (100, 300, 10_000):
        assert occupied_arc_deg(rng.uniform(-np.pi, np.pi, n)) > 330.0
    assert occupied_arc_deg(np.empty(0)) == 0.0


def test_every_end_has_a_sentence():
    assert all(end.sentence.endswith(".") for end in CircleEnd)
