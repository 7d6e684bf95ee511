"""What the published fit of v^2 tau^2 + 2 D tau does to rotors that are known."""

import numpy as np
import pytest

from rotortrack.motion.msd import fit_msd, msd

FRAME_S = 0.002


def angles(rng, n, deg_s, diffusion, sigma):
    """Angles at instants: drift, diffusion and reading noise."""
    steps = np.deg2rad(deg_s) * FRAME_S + rng.normal(0, np.sqrt(2 * diffusion * FRAME_S), n)
    return np.cumsum(steps) + rng.normal(0, sigma, n)


def speeds(lags, *, deg_s, diffusion, sigma=0.2, n=8000, repeats=100, noise=False):
    """Speeds (deg/s) and diffusion coefficients of many rotors alike."""
    rng = np.random.default_rng(20)
    fits = []
    for _ in range(repeats):
        curve = msd(angles(rng, n, deg_s, diffusion, sigma), lags)
        fits.append(fit_msd(curve, FRAME_S, lags=lags, noise=noise))
    return (
        np.rad2deg([fit.speed_rad_s for fit in fits]),
        np.array([fit.diffusion_rad2_s for fit in fits]),
    )


@pytest.mark.parametrize(("lags", "mean", "sd"), [(10, 0, 0), (100, 699, 34), (2000, 711, 33)])
def test_the_range_of_lags_decides_the_speed(lags, mean, sd):
    found, _ = speeds(lags, deg_s=720, diffusion=2)
    assert found.mean() == pytest.approx(mean, abs=12)
    assert found.std() == pytest.approx(sd, abs=9)


def test_localisation_noise_hides_a_slow_speed():
    found, _ = speeds(100, deg_s=100, diffusion=2)
    assert np.mean(found == 0) == pytest.approx(0.85, abs=0.12)


def test_localisation_noise_passes_for_diffusion_until_it_is_fitted():
    _, without = speeds(10, deg_s=100, diffusion=2)
    _, fitted = speeds(10, deg_s=100, diffusion=2, noise=True)
    assert without.mean() > 4
    assert fitted.mean() == pytest.approx(2, rel=0.05)


@pytest.mark.parametrize(("lags", "zeros", "others"), [(100, 0.47, 410), (2000, 0.63, 240)])
def test_brownian_rotors_are_a_spike_at_zero_and_a_false_tail(lags, zeros, others):
    found, _ = speeds(lags, deg_s=0, diffusion=60)
    assert np.mean(found == 0) == pytest.approx(zeros, abs=0.15)
    assert found[found > 0].mean() == pytest.approx(others, rel=0.25)
    # The class "100-720 deg/s" of the published table fills with rotors that are not driven.
    assert np.mean((found > 100) & (found < 720)) > 0.25


def test_the_sign_is_lost():
    there, _ = speeds(2000, deg_s=720, diffusion=2, repeats=5)
    back, _ = speeds(2000, deg_s=-720, diffusion=2, repeats=5)
    assert (there > 0).all()
    assert (back > 0).all()
