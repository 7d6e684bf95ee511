"""Quick estimators find what was put in, say how sure they are and where there is nothing."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.flags import FitFlag
from rotortrack.localise.fit import RESULT_COLUMNS
from rotortrack.localise.quick import QUICK_METHODS, estimate
from rotortrack.localise.windows import LANES, Windows

_spec = importlib.util.spec_from_file_location("spots", Path(__file__).with_name("spots.py"))
spots = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(spots)

READ_NOISE_E = 1.6
SIGMA_PX = 1.25
START_PX = 1.6
X, Y, PHOTONS, BACKGROUND, SIGMA, X_SD, Y_SD, BACKGROUND_SD, CHI2, DEVIANCE = range(10)
FAILED = FitFlag.ITERATION_LIMIT | FitFlag.SINGULAR | FitFlag.LEFT_WINDOW | FitFlag.NOT_FINITE

every_method = pytest.mark.parametrize("method", QUICK_METHODS)


def as_windows(images, masked=None):
    """Windows of (n, size, size) photons; what is masked as the cutting of windows leaves it."""
    n = len(images)
    pixels = images[0].size
    shape = (-(-n // LANES), LANES, pixels)
    photons = np.zeros(shape, np.float32)
    variance = np.full(shape, np.inf, np.float32)
    masked = np.zeros(images.shape, bool) if masked is None else masked
    photons.reshape(-1, pixels)[:n] = np.where(masked, 0.0, images).reshape(n, -1)
    variance.reshape(-1, pixels)[:n] = np.where(masked, np.inf, READ_NOISE_E**2).reshape(n, -1)
    return Windows(
        np.ascontiguousarray(photons.swapaxes(1, 2)),
        np.ascontiguousarray(variance.swapaxes(1, 2)),
        np.zeros(n, np.int32),
    )


def run(images, method, masked=None, sigma_px=START_PX, **options):
    radius = images.shape[1] // 2
    return estimate(as_windows(images, masked), radius, method=method, sigma_px=sigma_px, **options)


def noise_free(x, y, photons=1000.0, sigma=SIGMA_PX, size=7):
    """Expected windows; x and y from the centre."""
    half = size / 2
    x, y = np.atleast_1d(x), np.atleast_1d(y)
    return spots.expected_windows(x + half, y + half, np.full(len(x), photons), 8.0, sigma, size)


def grid(reach=0.5):
    places = np.linspace(-reach, reach, 11)
    x, y = np.meshgrid(places, places)
    return x.ravel(), y.ravel()


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("method", ["centroid", "phasor"])
@pytest.mark.parametrize("sigma", [1.0, 1.25, 1.6])
@pytest.mark.parametrize("size", [5, 7, 11])
def test_moments_without_noise_are_the_truth(method, sigma, size):
    x, y = grid()
    results, flags = run(noise_free(x, y, sigma=sigma, size=size), method)
    assert np.abs(results[X] - x).max() < 0.001
    assert np.abs(results[Y] - y).max() < 0.001
    np.testing.assert_allclose(results[PHOTONS], 1000.0, rtol=0.01)
    np.testing.assert_allclose(results[BACKGROUND], 8.0, atol=0.15)
    np.testing.assert_allclose(results[SIGMA], sigma, atol=0.01)
    assert results[CHI2].max() < 0.02
    assert not flags.any()


@pytest.mark.parametrize(("sigma", "bias_px"), [(1.0, 0.003), (1.25, 0.007), (1.6, 0.015)])
def test_radial_symmetry_without_noise_is_off_by_little(sigma, bias_px):
    x, y = grid()
    results, flags = run(noise_free(x, y, sigma=sigma), "radial-symmetry")
    assert np.abs(results[X] - x).max() < bias_px
    assert np.abs(results[Y] - y).max() < bias_px
    np.testing.assert_allclose(results[PHOTONS], 1000.0, rtol=0.01)
    assert not flags.any()


@pytest.mark.parametrize(
    ("method", "photons", "over_bound"),
    [
        ("centroid", 250.0, 1.50),
        ("centroid", 500.0, 1.38),
        ("centroid", 5000.0, 1.10),
        ("phasor", 250.0, 1.18),
        ("phasor", 500.0, 1.12),
        ("phasor", 5000.0, 1.09),
        ("radial-symmetry", 250.0, 1.07),
        ("radial-symmetry", 500.0, 1.07),
        ("radial-symmetry", 5000.0, 1.18),
    ],
)
def test_scatter_is_as_reported_and_as_far_over_the_bound_as_documented(
    method, photons, over_bound
):
    rng = np.random.default_rng(30)
    x, y = rng.uniform(-0.5, 0.5, (2, 10_000))
    images = spots.noisy_windows(rng, noise_free(x, y, photons), READ_NOISE_E)
    results, flags = run(images, method)
    good = flags & FAILED == 0
    assert good.mean() > 0.96
    error = np.array([results[X] - x, results[Y] - y])[:, good]
    assert 0.9 < rms(error / results[X_SD : Y_SD + 1, good]) < 1.15
    bound = spots.bound(3.5, 3.5, photons, 8.0, SIGMA_PX, READ_NOISE_E)[0]
    assert rms(error) / bound < over_bound
    assert np.abs(error.mean(axis=1)).max() < 0.004
    assert np.median(results[CHI2]) == pytest.approx(46, abs=4)


@pytest.mark.parametrize("free_sigma", [True, False])
@pytest.mark.parametrize("holes", [(), ((3, 3),), ((0, 0), (2, 4), (6, 1))])
@every_method
def test_errors_are_those_of_numerical_differentiation(method, holes, free_sigma):
    expected = noise_free(0.3, -0.2, photons=4000.0)[0]
    masked = np.zeros((7, 7), bool)
    for hole in holes:
        masked[hole] = True
    step = 4.0
    nudges = np.eye(49).reshape(49, 7, 7) * step
    images = np.concatenate([[expected], expected + nudges, expected - nudges])
    results, _ = run(
        images, method, np.broadcast_to(masked, images.shape), 1.3, free_sigma=free_sigma
    )
    slopes = (results[:2, 1:50] - results[:2, 50:]) / (2 * step)
    spread = np.where(masked, 0.0, expected + READ_NOISE_E**2).ravel()
    np.testing.assert_allclose(results[[X_SD, Y_SD], 0], np.sqrt(slopes**2 @ spread), rtol=0.02)


CLIPPED = {
    "one column": np.s_[:, :1],
    "two rows": np.s_[5:, :],
    "a corner": np.s_[:2, :2],
    "the brightest pixel": np.s_[3, 3],
    "half": np.s_[:, :3],
}


@pytest.mark.parametrize("where", CLIPPED)
@every_method
def test_masked_and_clipped_windows_are_unbiased_and_less_sure(method, where):
    masked = np.zeros((7, 7), bool)
    masked[CLIPPED[where]] = True
    x, y = grid()
    images = noise_free(x, y)
    plain, _ = run(images, "phasor")
    results, flags = run(images, method, np.broadcast_to(masked, images.shape))
    assert np.abs(results[X] - x).max() < 0.001
    assert np.abs(results[Y] - y).max() < 0.001
    np.testing.assert_allclose(results[PHOTONS], 1000.0, rtol=0.01)
    # The middle pixel has no weight for a spot in the middle.
    assert (results[X_SD] + results[Y_SD] > 0.9999 * (plain[X_SD] + plain[Y_SD])).all()
    assert not flags.any()


@every_method
def test_clipped_windows_scatter_as_reported(method):
    rng = np.random.default_rng(31)
    x, y = rng.uniform(-0.5, 0.5, (2, 5000))
    images = spots.noisy_windows(rng, noise_free(x, y, 1000.0), READ_NOISE_E)
    masked = np.zeros(images.shape, bool)
    masked[:, :, :2] = True
    results, flags = run(images, method, masked)
    good = flags & FAILED == 0
    assert good.mean() > 0.97
    assert 0.9 < rms((results[X] - x)[good] / results[X_SD, good]) < 1.15
    assert 0.9 < rms((results[Y] - y)[good] / results[Y_SD, good]) < 1.15


@st.composite
def noisy_spot(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    x, y = draw(st.floats(-0.6, 0.6)), draw(st.floats(-0.6, 0.6))
    photons = draw(st.floats(800.0, 1e5))
    size = draw(st.sampled_from([7, 9]))
    images = noise_free(x, y, photons, draw(st.floats(0.9, 1.4)), size)
    return spots.noisy_windows(rng, images, READ_NOISE_E)


@settings(max_examples=60, deadline=None)
@given(images=noisy_spot(), method=st.sampled_from(sorted(QUICK_METHODS)))
def test_mirrored_and_transposed_windows_give_mirrored_and_transposed_spots(images, method):
    plain, _ = run(images, method)
    mirrored, _ = run(images[:, :, ::-1], method)
    transposed, _ = run(images.swapaxes(1, 2), method)
    expected = plain.copy()
    expected[X] = -plain[X]
    np.testing.assert_allclose(mirrored, expected, rtol=2e-3, atol=2e-3)
    expected = plain[[Y, X, PHOTONS, BACKGROUND, SIGMA, Y_SD, X_SD, BACKGROUND_SD, CHI2, DEVIANCE]]
    np.testing.assert_allclose(transposed, expected, rtol=2e-3, atol=2e-3)


@settings(max_examples=30, deadline=None)
@given(
    images=noisy_spot(),
    method=st.sampled_from(sorted(QUICK_METHODS)),
    power=st.integers(-6, 12),
)
def test_places_do_not_depend_on_the_unit_of_light(images, method, power):
    plain, _ = run(images, method)
    scaled, _ = run(images * np.float32(2.0**power), method)
    np.testing.assert_array_equal(scaled[[X, Y, SIGMA]], plain[[X, Y, SIGMA]])
    np.testing.assert_array_equal(
        scaled[[PHOTONS, BACKGROUND]], plain[[PHOTONS, BACKGROUND]] * 2.0**power
    )


@every_method
def test_a_flat_light_changes_the_background_alone(method):
    x, y = grid()
    images = noise_free(x, y, photons=3000.0)
    dark, _ = run(images, method)
    bright, _ = run(images + 200.0, method)
    np.testing.assert_allclose(bright[[X, Y]], dark[[X, Y]], atol=2e-4)
    np.testing.assert_allclose(bright[BACKGROUND], dark[BACKGROUND] + 200.0, atol=0.2)
    assert (bright[X_SD] > dark[X_SD]).all()


@every_method
def test_no_window_depends_on_its_neighbours(method):
    rng = np.random.default_rng(32)
    x, y = rng.uniform(-0.5, 0.5, (2, 2 * LANES + 3))
    images = spots.noisy_windows(rng, noise_free(x, y, 300.0), READ_NOISE_E)
    masked = rng.random(images.shape) < 0.01
    masked[5] = True
    together, flags = run(images, method, masked)
    for k in range(len(images)):
        alone, flag = run(images[k : k + 1], method, masked[k : k + 1])
        np.testing.assert_array_equal(alone[:, 0], together[:, k])
        assert flag[0] == flags[k]


def test_radial_symmetry_leaves_windows_with_holes_to_the_phasor():
    images = np.repeat(noise_free(0.2, 0.1), 2, axis=0)
    masked = np.zeros(images.shape, bool)
    masked[1, 2, 2] = True
    radial, _ = run(images, "radial-symmetry", masked)
    phasor, _ = run(images, "phasor", masked)
    np.testing.assert_array_equal(radial[:, 1], phasor[:, 1])
    assert radial[X, 0] != phasor[X, 0]


@every_method
def test_a_given_width_stays_and_a_wrong_one_costs_photons(method):
    images = noise_free(0.1, 0.2)
    right, _ = run(images, method, sigma_px=SIGMA_PX, free_sigma=False)
    wrong, _ = run(images, method, sigma_px=1.6, free_sigma=False)
    assert right[SIGMA] == pytest.approx(SIGMA_PX)
    assert right[PHOTONS] == pytest.approx(1000.0, rel=1e-3)
    assert wrong[SIGMA] == pytest.approx(1.6)
    assert wrong[PHOTONS] == pytest.approx(1370.0, rel=0.01)


@every_method
def test_hopeless_windows_are_flagged(method):
    images = np.zeros((6, 7, 7), np.float32)
    images[1] = 8.0
    images[2] = -5.0
    images[3] = 50.0 - noise_free(0.0, 0.0, 300.0)[0]
    images[4:] = noise_free(0.0, 0.0)[0]
    masked = np.zeros(images.shape, bool)
    masked[4] = True
    masked[5] = True
    masked[5, 3, 1:6] = False
    results, flags = run(images, method, masked)
    assert ((flags[:4] & FitFlag.SINGULAR) != 0).all()
    assert (flags[4:] == FitFlag.NOT_FINITE).all()
    assert np.isnan(results[:, 4:]).all()


@every_method
def test_bits_of_the_windows_are_kept_and_the_deviance_is_unknown(method):
    windows = as_windows(noise_free(0.0, 0.0))
    windows.flags[:] = FitFlag.SATURATED
    results, flags = estimate(windows, 3, method=method, sigma_px=START_PX)
    assert results.shape == (len(RESULT_COLUMNS), 1)
    assert flags.tolist() == [FitFlag.SATURATED]
    assert np.isnan(results[DEVIANCE]).all()
    assert windows.flags.tolist() == [FitFlag.SATURATED]


@every_method
def test_no_windows_give_no_results(method):
    results, flags = estimate(
        Windows(
            np.empty((0, 49, LANES), np.float32),
            np.empty((0, 49, LANES), np.float32),
            np.empty(0, np.int32),
        ),
        3,
        method=method,
        sigma_px=START_PX,
    )
    assert results.shape == (len(RESULT_COLUMNS), 0)
    assert flags.shape == (0,)
