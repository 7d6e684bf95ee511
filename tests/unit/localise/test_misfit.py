"""The deviance's moments are those of simulated pixels, and its tail that of a normal score."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import xlogy

from rotortrack.localise.misfit import deviance_moments, misfit_score, pixel_moments

PIXELS = 400_000


def simulated(rng, light, variance, shape):
    observed = rng.poisson(light, shape) + rng.normal(0.0, np.sqrt(variance), shape) + variance
    observed = np.maximum(observed, 0.0)
    mean = light + variance
    return 2.0 * (mean - observed + xlogy(observed, observed / mean))


@pytest.mark.parametrize("light", [0.1, 0.7, 2.0, 8.0, 50.0, 1000.0])
@pytest.mark.parametrize("variance", [0.0, 0.5, 2.56, 60.0])
def test_moments_of_a_pixel_are_those_of_simulated_ones(light, variance):
    values = simulated(np.random.default_rng(1), light, variance, PIXELS)
    mean, spread = pixel_moments(light + variance, variance, deviance_moments())
    # Three deviations of the simulation, and the table's interpolation.
    assert mean == pytest.approx(values.mean(), abs=3 * values.std() / np.sqrt(PIXELS), rel=0.005)
    assert spread == pytest.approx(values.var(), rel=0.03)


@pytest.mark.parametrize("light", [0.5, 2.0, 50.0])
def test_one_window_in_ten_scores_above_1_28(light):
    windows = simulated(np.random.default_rng(2), light, 2.56, (20_000, 49)).sum(axis=1)
    mean, spread = pixel_moments(light + 2.56, 2.56, deviance_moments())
    scores = np.array([misfit_score(value, 49 * mean, 49 * spread) for value in windows])
    assert np.mean(scores > 1.28) == pytest.approx(0.10, abs=0.01)
    assert np.mean(scores > 2.33) == pytest.approx(0.01, abs=0.004)
