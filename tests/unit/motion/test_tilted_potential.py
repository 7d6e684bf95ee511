import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from rotortrack.motion.tilted_potential import NO_POTENTIAL, fit_potential

from .planted import FRAME_S, PARTS, washboard

FRAMES = 2500
NOISE = 0.2


def angles(rng, diffusion, tilt, cosines, count):
    path = washboard(rng, FRAMES * PARTS, diffusion, tilt, cosines, count)[::PARTS]
    return path.T, np.random.default_rng(1).normal(path.T, NOISE)


def fitted(path, theta, diffusion):
    duration = FRAMES * FRAME_S
    return fit_potential(
        theta,
        omega_rad_s=(path[-1] - path[0]) / duration,
        diffusion_rad2_s=diffusion,
        noise_variance_rad2=NOISE**2,
        duration_s=duration,
    )


@pytest.mark.parametrize(
    ("tilt", "cosines"), [(0.0, (0.0, 0.0)), (2.0, (0.6, 0.6)), (1.0, (0.0, 1.5))]
)
def test_barriers_lie_within_their_intervals(tilt, cosines):
    rng = np.random.default_rng(3)
    around = np.linspace(0, 2 * np.pi, 721)
    barrier = np.ptp(cosines[0] * np.cos(around) + cosines[1] * np.cos(2 * around))
    n, diffusion = 120, 15.0
    held, pulls, tilts = [], [], []
    for path, theta in zip(*angles(rng, diffusion, tilt, cosines, n), strict=True):
        found = fitted(path, theta, diffusion)
        low, high = found.barrier_interval_kt
        held.append(low <= barrier <= high)
        truth = np.array([cosines[0], 0.0, cosines[1], 0.0])
        pulls.append((found.coefficients_kt - truth) / np.sqrt(np.diag(found.covariance_kt2)))
        tilts.append((found.tilt_kt_rad - tilt) / found.tilt_sd_kt_rad)
    # Two and a half standard errors about 95 %.
    assert 0.90 <= np.mean(held) <= 1.0
    np.testing.assert_allclose(np.std(pulls, axis=0), 1.0, atol=0.2)
    assert np.std(tilts) == pytest.approx(1.0, abs=0.2)


def test_a_free_rotor_has_no_barrier():
    rng = np.random.default_rng(4)
    seen = [
        fitted(path, theta, 15.0)
        for path, theta in zip(*angles(rng, 15.0, 3.0, (), 100), strict=True)
    ]
    assert np.mean([found.barrier_interval_kt[0] == 0.0 for found in seen]) >= 0.88
    assert np.mean([found.p < 0.05 for found in seen]) <= 0.12


def test_the_preferred_direction_is_found():
    rng = np.random.default_rng(5)
    path, theta = (rows[0] for rows in angles(rng, 20.0, 0.0, (-1.5,), 1))
    found = fitted(path + 1.0, theta + 1.0, 20.0)
    assert found.preferred_rad == pytest.approx(1.0, abs=3 * found.preferred_sd_rad)
    assert found.preferred_sd_rad < 0.5
    assert found.p < 1e-3


def test_density_is_that_of_boltzmann_without_tilt_and_solves_fokker_planck_with_it():
    rng = np.random.default_rng(6)
    path, theta = (rows[0] for rows in angles(rng, 20.0, 1.5, (0.5, 1.0), 1))
    found = fitted(path, theta, 20.0)
    around = np.linspace(0, 2 * np.pi, 2001)
    density = found.density(around)
    assert np.trapezoid(density, around) == pytest.approx(1.0, abs=1e-6)
    # Probability flows at one rate everywhere: J = (f - u') p - p'.
    slope = np.gradient(found.potential_kt(around), around)
    flow = (found.tilt_kt_rad - slope) * density - np.gradient(density, around)
    np.testing.assert_allclose(flow[2:-2], flow[2:-2].mean(), rtol=1e-3)
    # The closed form of Risken, p = exp(-w) integral of exp(w) over the turn ahead.
    height = found.potential_kt(around) - found.tilt_kt_rad * around
    ahead = np.concatenate([height, height[1:] - 2 * np.pi * found.tilt_kt_rad])
    total = cumulative_trapezoid(np.exp(ahead), dx=around[1], initial=0.0)
    closed = np.exp(-height) * (total[2000:] - total[:2001])
    np.testing.assert_allclose(density, closed / np.trapezoid(closed, around), rtol=1e-5)


@pytest.mark.parametrize(
    "unknown",
    [
        {"omega_rad_s": np.nan},
        {"diffusion_rad2_s": 0.0},
        {"duration_s": 0.0},
        {"noise_variance_rad2": np.nan},
    ],
)
def test_nothing_is_told_where_nothing_is_known(unknown):
    known = {"omega_rad_s": 0.0, "diffusion_rad2_s": 5.0, "noise_variance_rad2": 0.01}
    rows = known | {"duration_s": 2.0} | unknown
    assert fit_potential(np.linspace(0, 6, 1000), **rows) is NO_POTENTIAL


def test_a_stuck_rotor_has_no_potential_that_could_be_measured():
    theta = np.random.default_rng(7).normal(1.0, 0.01, 1000)
    found = fit_potential(
        theta, omega_rad_s=0.0, diffusion_rad2_s=1.0, noise_variance_rad2=0.0, duration_s=2.0
    )
    assert found is NO_POTENTIAL
