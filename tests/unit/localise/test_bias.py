"""The bias that fits subtract is that of Cox and Snell, computed here by finite differences."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from rotortrack.localise.fit import RESULT_COLUMNS

_spec = importlib.util.spec_from_file_location("spots", Path(__file__).with_name("spots.py"))
spots = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(spots)

VARIANCE = 2.5
PARAMETERS = RESULT_COLUMNS[:5]


def bias(truth, fitted):
    """Minus half C sum J tr(H C) / V over the parameters in `fitted`, numbers of columns."""

    def model(p):
        return spots.expected_windows([p[0]], [p[1]], [p[2]], p[3], p[4])[0].ravel()

    steps = np.diag(1e-3 * np.maximum(np.abs(truth), 1.0))[fitted]
    sizes = steps.sum(axis=1)
    jacobian = np.array(
        [(model(truth + s) - model(truth - s)) / (2 * h) for s, h in zip(steps, sizes, strict=True)]
    )
    hessian = np.array(
        [
            [
                (
                    model(truth + s + t)
                    - model(truth + s - t)
                    - model(truth - s + t)
                    + model(truth - s - t)
                )
                / (4 * h * k)
                for t, k in zip(steps, sizes, strict=True)
            ]
            for s, h in zip(steps, sizes, strict=True)
        ]
    )
    weights = 1.0 / (model(truth) + VARIANCE)
    covariance = np.linalg.inv((jacobian * weights) @ jacobian.T)
    traces = np.einsum("abp,ab->p", hessian, covariance)
    return -0.5 * covariance @ (jacobian @ (weights * traces))


@pytest.mark.parametrize("scalar", [False, True])
@pytest.mark.parametrize("free_sigma", [False, True])
def test_the_correction_of_a_window_without_noise_is_minus_its_bias(scalar, free_sigma):
    truth = np.array([3.2, 3.9, 400.0, 6.0, 1.2])
    window = spots.expected_windows(*truth[:3, None], *truth[3:])
    options = {"variance": VARIANCE, "scalar": scalar, "sigma_px": 1.2, "free_sigma": free_sigma}
    fitted, _ = spots.fit(window, "mle", correct_bias=True, **options)
    columns = list(range(5 if free_sigma else 4))
    expected = bias(truth, columns)
    for column, value in zip(columns, expected, strict=True):
        moved = fitted[PARAMETERS[column]][0] - truth[column]
        assert moved == pytest.approx(-value, rel=5e-3, abs=2e-5)


def test_where_the_background_rests_on_its_bound_it_stays_there():
    truth = np.array([3.2, 3.9, 400.0, 0.0, 1.2])
    window = spots.expected_windows(*truth[:3, None], *truth[3:]) - 0.5
    for scalar in (False, True):
        fitted, _ = spots.fit(window, "mle", variance=VARIANCE, scalar=scalar, correct_bias=True)
        assert fitted["background"][0] == 0.0


def test_a_correction_as_large_as_the_error_is_shortened():
    truth = np.array([3.5, 3.5, 60.0, 20.0, 1.3])
    window = spots.expected_windows(*truth[:3, None], *truth[3:])
    full = bias(truth, list(range(5)))
    for scalar in (False, True):
        fitted, _ = spots.fit(window, "mle", variance=VARIANCE, scalar=scalar, correct_bias=True)
        moved = fitted["photons"][0] - truth[2]
        assert 0.0 > moved > -0.9 * abs(full[2])
        assert fitted["photons"][0] > 0.5 * truth[2]
