"""Uncertainty formulas, against values worked out by hand and each other."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.localise.precision import bound_nm, thunderstorm_uncertainty

SPOT = {
    "sigma_nm": np.array([130.0]),
    "photons": np.array([500.0]),
    "background_sd": np.array([4.0]),
    "pixel_size_nm": 108.0,
}
# s^2 + a^2/12 = 16900 + 972 = 17872; / N = 35.744; tau = 2 pi 16 17872 / (500 * 11664)
TAU = 2 * np.pi * 16 * 17872 / (500 * 11664)


def test_2014_formula():
    expected = np.sqrt(35.744 + 8 * np.pi * 130.0**4 * 16 / (11664 * 250000))
    assert thunderstorm_uncertainty("2014", "wlsq", **SPOT)[0] == pytest.approx(expected, rel=1e-12)


def test_2016_formulas():
    lsq = np.sqrt(35.744 * (16 / 9 + 4 * TAU))
    mle = np.sqrt(35.744 * (1 + 4 * TAU + np.sqrt(2 * TAU / (1 + 4 * TAU))))
    assert thunderstorm_uncertainty("2016", "lsq", **SPOT)[0] == pytest.approx(lsq, rel=1e-12)
    assert thunderstorm_uncertainty("2016", "mle", **SPOT)[0] == pytest.approx(mle, rel=1e-12)
    assert thunderstorm_uncertainty("2016", "wlsq", **SPOT)[0] == pytest.approx(mle, rel=1e-12)


def test_read_noise_adds_linearly_in_the_2016_formula():
    quiet = thunderstorm_uncertainty("2016", "mle", **(SPOT | {"background_sd": np.array([5.5])}))
    noisy = thunderstorm_uncertainty("2016", "mle", **SPOT, read_noise_e=1.5)
    assert noisy[0] == pytest.approx(quiet[0], rel=1e-12)


def test_no_photons_give_no_uncertainty():
    dark = SPOT | {"photons": np.array([0.0])}
    assert np.isnan(thunderstorm_uncertainty("2016", "mle", **dark)[0])


@pytest.mark.parametrize("photons", [200.0, 1000.0, 5000.0])
@pytest.mark.parametrize("background", [0.5, 5.0, 30.0])
def test_the_bound_is_near_the_formula_of_rieger_and_stallinga(photons, background):
    expected = thunderstorm_uncertainty(
        "2016", "mle", sigma_nm=np.array([130.0]), photons=np.array([photons]),
        background_sd=np.array([np.sqrt(background)]), pixel_size_nm=108.0,
    )[0]  # fmt: skip
    found = bound_nm(photons, background=background, sigma_nm=130.0, pixel_size_nm=108.0)
    assert found == pytest.approx(expected, rel=0.08)


def test_read_noise_acts_as_background_of_its_variance():
    spot = {"sigma_nm": 130.0, "pixel_size_nm": 108.0}
    noisy = bound_nm(500.0, background=5.0, read_noise_e=2.0, **spot)
    assert noisy == pytest.approx(bound_nm(500.0, background=9.0, **spot), rel=1e-9)
