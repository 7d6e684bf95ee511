"""Fits reach the optimum of what they claim to minimise."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import scipy.optimize

from rotortrack.flags import FitFlag
from rotortrack.localise.fit import METHODS, RESULT_COLUMNS

_spec = importlib.util.spec_from_file_location("spots", Path(__file__).with_name("spots.py"))
spots = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(spots)

READ_NOISE_E = 1.6


@pytest.fixture(params=["lanes", "scalar"])
def fit(request):
    """Both tiers, told apart by name in the test's identity."""

    def run(windows, method, *, variance=READ_NOISE_E**2, **options):
        scalar = request.param == "scalar"
        return spots.fit(windows, method, variance=variance, scalar=scalar, **options)

    return run


def some_windows(rng, n, photons, background=8.0):
    x, y = 3.5 + rng.uniform(-0.5, 0.5, (2, n))
    expected = spots.expected_windows(x, y, np.full(n, photons), background, 1.25)
    return x, y, spots.noisy_windows(rng, expected, READ_NOISE_E)


def weights_of(window):
    return 1.0 / np.maximum(window, window.max() * 1e-3)


def residuals(parameters, window, method):
    x, y, photons, background, sigma = parameters
    model = spots.expected_windows([x], [y], [photons], background, sigma)[0]
    if method == "lsq":
        return (window - model).ravel()
    if method == "wlsq":
        return (np.sqrt(weights_of(window)) * (window - model)).ravel()
    expected = np.maximum(model + READ_NOISE_E**2, 1e-9)
    observed = np.maximum(window + READ_NOISE_E**2, 0.0)
    logarithm = np.where(
        observed > 0, observed * np.log(np.maximum(observed, 1e-300) / expected), 0
    )
    return np.sqrt(2 * np.maximum(expected - observed + logarithm, 0)).ravel()


@pytest.mark.parametrize("method", ["lsq", "wlsq", "mle"])
@pytest.mark.parametrize("photons", [200.0, 1000.0])
def test_fit_reaches_the_optimum_that_scipy_finds(fit, method, photons):
    x, y, windows = some_windows(np.random.default_rng(4), 40, photons)
    fitted, flags = fit(windows, method)
    for k, window in enumerate(windows.astype(float)):
        best = scipy.optimize.least_squares(
            residuals,
            [x[k], y[k], photons, 8.0, 1.25],
            bounds=([-1, -1, 0, 0, 0.1], [8, 8, np.inf, np.inf, 50]),
            args=(window, method),
            x_scale=[1, 1, photons, 8, 1],
            xtol=1e-13,
            ftol=1e-13,
            gtol=1e-13,
        )
        ours = np.array([fitted[name][k] for name in RESULT_COLUMNS[:5]])
        # What a thousandth of a standard deviation costs.
        assert (residuals(ours, window, method) ** 2).sum() <= 2 * best.cost * (1 + 1e-6) + 1e-5
        np.testing.assert_allclose(ours[:2], best.x[:2], atol=3e-4)
    assert not (flags & FitFlag.ITERATION_LIMIT).any()


def test_noise_free_windows_give_the_truth_exactly(fit):
    rng = np.random.default_rng(5)
    x, y = 3.5 + rng.uniform(-0.9, 0.9, (2, 50))
    photons = rng.uniform(100, 5000, 50)
    windows = spots.expected_windows(x, y, photons, 12.0, 1.4)
    for method in METHODS:
        fitted, flags = fit(windows.astype(np.float32), method, variance=0.0)
        np.testing.assert_allclose(fitted["x_px"], x, atol=1e-5)
        np.testing.assert_allclose(fitted["y_px"], y, atol=1e-5)
        np.testing.assert_allclose(fitted["photons"], photons, rtol=1e-4)
        np.testing.assert_allclose(fitted["sigma_px"], 1.4, rtol=1e-4)
        assert not flags.any()


def test_reported_errors_of_the_likelihood_are_the_cramer_rao_bound(fit):
    window = spots.expected_windows([3.3], [3.8], [700.0], 9.0, 1.25).astype(np.float32)
    fitted, _ = fit(window, "mle")
    expected = spots.bound(3.3, 3.8, 700.0, 9.0, 1.25, READ_NOISE_E)
    assert fitted["x_sd_px"][0] == pytest.approx(expected[0], rel=1e-4)
    assert fitted["y_sd_px"][0] == pytest.approx(expected[1], rel=1e-4)


def test_least_squares_report_more_than_the_bound(fit):
    window = spots.expected_windows([3.3], [3.8], [700.0], 9.0, 1.25).astype(np.float32)
    expected = spots.bound(3.3, 3.8, 700.0, 9.0, 1.25, READ_NOISE_E)
    fitted, _ = fit(window, "lsq")
    assert 1.02 * expected[0] < fitted["x_sd_px"][0] < 1.3 * expected[0]


def test_a_noisy_pixel_counts_less_when_its_read_noise_is_known(fit):
    rng = np.random.default_rng(6)
    x, _, windows = some_windows(rng, 600, 800.0)
    noise = np.full((7, 7), READ_NOISE_E)
    noise[2, 2] = 40.0
    windows[:, 2, 2] += rng.normal(0, 40.0, 600)
    ignorant, _ = fit(windows, "mle")
    informed, _ = fit(windows, "mle", variance=noise**2)
    assert np.std(informed["x_px"] - x) < 0.8 * np.std(ignorant["x_px"] - x)


def test_masked_pixels_carry_no_weight(fit):
    x, _, windows = some_windows(np.random.default_rng(7), 200, 2000.0)
    windows[:, 1, 1] = np.nan
    fitted, flags = fit(windows, "mle")
    assert not flags.any()
    assert np.std(fitted["x_px"] - x) < 0.06
    assert np.isfinite(fitted["log_likelihood_ratio"]).all()


def test_hopeless_windows_end_with_a_reason_instead_of_a_number(fit):
    windows = np.zeros((3, 7, 7), np.float32)
    windows[1] = np.nan
    windows[2] = 5.0
    for method in METHODS:
        fitted, flags = fit(windows, method, variance=0.0)
        bad = FitFlag.SINGULAR | FitFlag.LEFT_WINDOW | FitFlag.NOT_FINITE
        assert (flags & bad != 0)[[0, 1]].all(), method
        # A flat window holds no spot: whatever the fit says must not look certain.
        assert flags[2] & bad or not fitted["x_sd_px"][2] < 0.5


def test_negative_pixels_do_not_break_a_fit(fit):
    x, _, windows = some_windows(np.random.default_rng(8), 300, 400.0, background=0.2)
    assert (windows < 0).any()
    for method in METHODS:
        fitted, flags = fit(windows, method)
        assert (flags & 15 == 0).mean() > 0.99
        # Weights from the data give a near-zero pixel far too much say; that is the method's own.
        assert np.median(np.abs(fitted["x_px"] - x)) < (0.15 if method == "wlsq" else 0.08)
