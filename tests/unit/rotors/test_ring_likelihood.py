"""Rings are measured without bias however unevenly they are visited."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.rotors.circle import CircleEnd, fit_circle
from rotortrack.rotors.ellipse import axis_ratio
from rotortrack.rotors.ring import ring_evidence


def visited(rng, n, noise, preference=0.0, ratio=1.0):
    """Positions about a ring of radius 1, one side preferred by von Mises."""
    theta = rng.vonmises(0.7, preference, n) if preference else rng.uniform(-np.pi, np.pi, n)
    x, y = np.cos(theta), ratio * np.sin(theta)
    turn = np.exp(1j * 0.4)
    z = (x + 1j * y) * turn + rng.normal(0.0, noise, n) + 1j * rng.normal(0.0, noise, n)
    return z.real, z.imag


@pytest.mark.parametrize(
    ("noise", "preference", "bar"),
    [(0.05, 0.0, 0.003), (0.2, 0.0, 0.003), (0.2, 0.5, 0.003), (0.3, 0.0, 0.01), (0.3, 0.5, 0.01)],
)
def test_radius_is_unbiased_and_errors_are_honest(noise, preference, bar):
    rng = np.random.default_rng(1)
    fits = [fit_circle(*visited(rng, 2000, noise, preference)) for _ in range(150)]
    assert all(fit.end is CircleEnd.FITTED for fit in fits)
    radius = np.array([fit.radius_nm for fit in fits])
    assert abs(radius.mean() - 1.0) < bar
    pulls = np.array(
        [
            (fit.x_nm / fit.x_sd_nm, fit.y_nm / fit.y_sd_nm, (fit.radius_nm - 1) / fit.radius_sd_nm)
            for fit in fits
        ]
    )
    # Six standard errors of an rms of 150 would be 0.35.
    assert np.all(np.abs(np.sqrt(np.mean(pulls**2, axis=0)) - 1.0) < 0.25)


def test_one_large_sample_shows_the_bias_that_hyper_has_at_wide_noise():
    x, y = visited(np.random.default_rng(2), 400_000, 0.3)
    assert fit_circle(x, y).radius_nm == pytest.approx(1.0, abs=0.002)
    assert fit_circle(x, y, "hyper").radius_nm == pytest.approx(1.013, abs=0.003)


def test_the_covariance_holds_the_variances():
    fit = fit_circle(*visited(np.random.default_rng(3), 1000, 0.2))
    sd = np.sqrt(np.diag(fit.covariance_nm2))
    np.testing.assert_allclose(sd, [fit.x_sd_nm, fit.y_sd_nm, fit.radius_sd_nm])
    np.testing.assert_allclose(fit.covariance_nm2, fit.covariance_nm2.T)


def test_weak_rings_are_found_where_the_noise_is_known_and_spots_are_not():
    rng = np.random.default_rng(4)
    found = []
    for _ in range(200):
        x, y = visited(rng, 500, 1 / 1.6)
        fit = fit_circle(x, y, outlier_sd=4.0)
        found.append(ring_evidence(x, y, fit.x_nm, fit.y_nm, 1 / 1.6) > 6.0)
    assert np.mean(found) >= 0.98
    for n in (500, 2000):
        for _ in range(250):
            x, y = rng.normal(0.0, 1.0, (2, n))
            fit = fit_circle(x, y, outlier_sd=4.0)
            assert not ring_evidence(x, y, fit.x_nm, fit.y_nm, 1.0) > 6.0


def test_a_spot_that_wanders_slowly_is_no_ring():
    rng = np.random.default_rng(5)
    called = 0
    for _ in range(60):
        steps = rng.normal(0.0, 0.1, (2, 4000))
        path = np.empty_like(steps)
        at = np.zeros(2)
        for k in range(4000):
            at = 0.99 * at + steps[:, k]
            path[:, k] = at
        x, y = path + rng.normal(0.0, 1.0, path.shape)
        fit = fit_circle(x, y, outlier_sd=4.0)
        called += ring_evidence(x, y, fit.x_nm, fit.y_nm, 1.0) > 6.0
    assert called <= 1


@pytest.mark.parametrize("ratio", [1.0, 0.9, 0.8])
def test_axis_ratio_is_told_to_one_percent(ratio):
    x, y = visited(np.random.default_rng(6), 200_000, 0.2, ratio=ratio)
    fit = fit_circle(x, y)
    assert fit.axis_ratio == pytest.approx(ratio, abs=0.01)


def test_circles_are_hardly_ever_called_ellipses():
    rng = np.random.default_rng(7)
    called = 0
    for _ in range(400):
        x, y = visited(rng, 1000, 0.2, 0.3)
        ratio, sd = axis_ratio(x, y, (0.0, 0.0, 1.0))
        called += 1.0 - ratio > 3.5 * sd
    assert called <= 4


def test_few_positions_tell_no_axis_ratio():
    assert np.isnan(axis_ratio(np.arange(4.0), np.arange(4.0) ** 2, (0.0, 0.0, 1.0))).all()
