"""Fits in lanes are those of the scalar reference, lane by lane, and as fast as they must be."""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.cameras.camera import Camera
from rotortrack.flags import FIT_FAILED
from rotortrack.localise import lanes
from rotortrack.localise.fit import METHODS, RESULT_COLUMNS, fit_chosen
from rotortrack.localise.lane_math import profile
from rotortrack.localise.lanes import fit_windows
from rotortrack.localise.vectors import LANES, load, store
from rotortrack.localise.windows import Windows, camera_arrays, cut_windows

_spec = importlib.util.spec_from_file_location("spots", Path(__file__).with_name("spots.py"))
spots = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(spots)

READ_NOISE_E = 1.6
PARAMETERS = RESULT_COLUMNS[:5]


def some_spots(rng, n, photons, *, background=8.0, sigma=1.25, size=7, reach=0.5):
    x, y = size / 2 + rng.uniform(-reach, reach, (2, n))
    expected = spots.expected_windows(x, y, np.full(n, photons), background, sigma, size)
    return spots.noisy_windows(rng, expected, READ_NOISE_E)


def both_tiers(windows, method, **options):
    options = {"variance": READ_NOISE_E**2} | options
    lane, lane_flags = spots.fit(windows, method, **options)
    scalar, scalar_flags = spots.fit(windows, method, scalar=True, **options)
    return lane, lane_flags, scalar, scalar_flags


def in_units_of_its_error(lane, scalar):
    return np.abs(
        [(lane[name] - scalar[name]) / scalar[f"{name[0]}_sd_px"] for name in PARAMETERS[:2]]
    )


@pytest.mark.parametrize("free_sigma", [True, False])
@pytest.mark.parametrize("correct_bias", [True, False])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("photons", "radius"), [(250.0, 3), (1000.0, 3), (1000.0, 2), (1000.0, 5)])
def test_lanes_agree_with_the_reference(method, photons, radius, correct_bias, free_sigma):
    windows = some_spots(np.random.default_rng(1), 200, photons, size=2 * radius + 1)
    lane, lane_flags, scalar, scalar_flags = both_tiers(
        windows,
        method,
        sigma_px=1.4 if free_sigma else 1.25,
        free_sigma=free_sigma,
        correct_bias=correct_bias,
    )
    np.testing.assert_array_equal(lane_flags, scalar_flags)
    good = scalar_flags & FIT_FAILED == 0
    assert good.mean() > 0.97
    difference = in_units_of_its_error(lane, scalar)[:, good]
    assert np.median(difference) < 2e-4
    assert np.percentile(difference, 99) < 5e-3
    for name in RESULT_COLUMNS[2:]:
        ratio = (lane[name][good] + 1e-6) / (scalar[name][good] + 1e-6)
        assert np.median(np.abs(ratio - 1)) < 3e-4, name
        assert np.percentile(np.abs(ratio - 1), 95) < 1e-2, name
    if not free_sigma:
        if not correct_bias:
            assert (lane["sigma_px"] == np.float32(1.25)).all()
        np.testing.assert_allclose(lane["sigma_px"], 1.25, rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "spot",
    [
        {"photons": 1e6, "background": 8.0, "sigma": 1.25},
        {"photons": 1e5, "background": 1e-3, "sigma": 1.25},
        {"photons": 2000.0, "background": 8.0, "sigma": 0.6},
        {"photons": 20000.0, "background": 8.0, "sigma": 3.0, "size": 11},
        {"photons": 2000.0, "background": 8.0, "sigma": 1.25, "reach": 1.4},
        {"photons": 300.0, "background": 0.2, "sigma": 1.0},
    ],
)
def test_unusual_spots_agree_with_the_reference_too(method, spot):
    windows = some_spots(np.random.default_rng(2), 100, **spot)
    lane, lane_flags, scalar, scalar_flags = both_tiers(windows, method)
    good = (lane_flags | scalar_flags) & FIT_FAILED == 0
    assert good.mean() > 0.9
    assert np.percentile(in_units_of_its_error(lane, scalar)[:, good], 95) < 0.02


@pytest.mark.parametrize("method", METHODS)
def test_without_any_noise_of_reading_pixels_of_no_photons_do_no_harm(method):
    rng = np.random.default_rng(3)
    x, y = 3.5 + rng.uniform(-0.5, 0.5, (2, 200))
    expected = spots.expected_windows(x, y, np.full(200, 300.0), 0.05, 1.1)
    windows = rng.poisson(expected).astype(np.float32)
    fitted, flags = spots.fit(windows, method, variance=0.0)
    assert (flags & FIT_FAILED == 0).mean() > 0.9
    good = flags & FIT_FAILED == 0
    assert np.median(np.abs(fitted["x_px"] - x)[good]) < 0.1


def test_no_result_depends_on_the_other_lanes():
    rng = np.random.default_rng(4)
    n = 5 * LANES + 3
    # Hopeless windows among good ones, so that lanes end after different numbers of iterations.
    windows = some_spots(rng, n, 250.0)
    windows[::7] = rng.normal(5, 3, windows[::7].shape)
    windows[3, 2, 2] = np.nan
    whole, flags = fit_windows(spots.as_windows(windows, 2.5), 3, method="mle", sigma_px=1.6)
    order = rng.permutation(n)
    shuffled, shuffled_flags = fit_windows(
        spots.as_windows(windows[order], 2.5), 3, method="mle", sigma_px=1.6
    )
    np.testing.assert_array_equal(shuffled, whole[:, order])
    np.testing.assert_array_equal(shuffled_flags, flags[order])
    for count in (0, 1, LANES, LANES + 1):
        part, part_flags = fit_windows(
            spots.as_windows(windows[:count], 2.5), 3, method="mle", sigma_px=1.6
        )
        np.testing.assert_array_equal(part, whole[:, :count])
        np.testing.assert_array_equal(part_flags, flags[:count])


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    radius=st.integers(2, 6),
    method=st.sampled_from(sorted(METHODS)),
    free_sigma=st.booleans(),
    photons=st.floats(400, 5000),
)
def test_mirrored_and_transposed_windows_give_mirrored_and_transposed_spots(
    seed, radius, method, free_sigma, photons
):
    size = 2 * radius + 1
    window = some_spots(np.random.default_rng(seed), 1, photons, size=size, sigma=1.1)[0]
    stack = np.array([window, window[:, ::-1], window[::-1], window.T])
    options = {"sigma_px": 1.1, "free_sigma": free_sigma, "correct_bias": method == "mle"}
    fitted, flags = spots.fit(stack, method, variance=READ_NOISE_E**2, **options)
    x, y = fitted["x_px"], fitted["y_px"]
    # A spot near the limits of what can be fitted may take either tier.
    if flags.any():
        return
    tolerance = 0.01 * fitted["x_sd_px"][0]
    np.testing.assert_allclose([x[1], y[1]], [size - x[0], y[0]], atol=tolerance)
    np.testing.assert_allclose([x[2], y[2]], [x[0], size - y[0]], atol=tolerance)
    np.testing.assert_allclose([x[3], y[3]], [y[0], x[0]], atol=tolerance)
    for name in ("photons", "sigma_px", "chi2"):
        np.testing.assert_allclose(fitted[name], fitted[name][0], rtol=2e-3)


def test_moving_the_frame_by_whole_pixels_moves_nothing_within_the_window():
    rng = np.random.default_rng(5)
    frame = rng.poisson(8, (1, 40, 40)) + 100
    frame[0, 12:19, 20:27] += rng.poisson(
        spots.expected_windows([3.3], [3.6], [900.0], 0.0, 1.2)[0]
    )
    camera = camera_arrays(Camera(100.0, 1.0, 1.6), np.dtype(np.uint16))
    results = []
    for rows, columns in ((0, 0), (5, -7), (-9, 3)):
        moved = np.roll(frame, (rows, columns), (1, 2)).astype(np.uint16)
        candidate = np.array([[0, 15 + rows, 23 + columns]], np.int32)
        windows = cut_windows(moved, camera, candidate, 3)
        results.append(fit_windows(windows, 3, method="mle", sigma_px=1.6)[0])
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


@pytest.mark.parametrize("clip", ["columns", "corner"])
def test_clipped_windows_reach_the_bound_of_what_is_left(clip):
    rng = np.random.default_rng(6)
    n = 3000
    mask = np.zeros((7, 7), bool)
    mask[:, :2] = True
    if clip == "corner":
        mask[5:] = True
    x, y = 3.5 + rng.uniform(-0.3, 0.3, (2, n))
    expected = spots.expected_windows(x, y, np.full(n, 2000.0), 8.0, 1.25)
    windows = spots.noisy_windows(rng, expected, READ_NOISE_E)
    windows[:, mask] = np.nan
    fitted, flags = spots.fit(windows, "mle", variance=READ_NOISE_E**2, correct_bias=True)
    good = flags & FIT_FAILED == 0
    assert good.mean() > 0.99
    bound = spots.bound(3.5, 3.5, 2000.0, 8.0, 1.25, READ_NOISE_E, mask=mask)
    for name, truth, own in (("x_px", x, bound[0]), ("y_px", y, bound[1])):
        error = (fitted[name] - truth)[good]
        pull = error / fitted[f"{name[0]}_sd_px"][good]
        assert np.sqrt(np.mean(pull**2)) == pytest.approx(1.0, abs=0.06)
        assert np.std(error) == pytest.approx(own, rel=0.08)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    scale=st.sampled_from([0.0, 1e-6, 1.0, 1e3, 1e7]),
    variance=st.sampled_from([0.0, 1e-6, 2.5, 1e6, np.inf]),
    method=st.sampled_from(sorted(METHODS)),
    masked=st.floats(0, 1),
)
def test_whatever_the_windows_hold_good_fits_are_numbers(seed, scale, variance, method, masked):
    rng = np.random.default_rng(seed)
    windows = (scale * rng.standard_t(1.5, (20, 7, 7))).astype(np.float32)
    windows[rng.random(windows.shape) < masked] = np.nan
    fitted, flags = spots.fit(windows, method, variance=variance, correct_bias=True)
    good = flags & FIT_FAILED == 0
    for name in RESULT_COLUMNS:
        assert np.isfinite(fitted[name][good]).all(), name
    assert (fitted["photons"][good] > 0).all()
    assert (fitted["x_sd_px"][good] > 0).all()


def test_few_spots_need_the_second_tier(monkeypatch):
    counts = []

    def counted(windows, chosen, **options):
        counts.append(len(chosen))
        fit_chosen(windows, chosen, **options)

    monkeypatch.setattr(lanes, "fit_chosen", counted)
    for photons, part in ((1000.0, 1e-3), (250.0, 1e-2)):
        counts.clear()
        windows = some_spots(np.random.default_rng(7), 4000, photons)
        spots.fit(windows, "mle", variance=READ_NOISE_E**2)
        assert sum(counts) <= part * len(windows)


def cpu_time(run):
    best = np.inf
    for _ in range(5):
        start = time.thread_time()
        run()
        best = min(best, time.thread_time() - start)
    return best


def test_lanes_are_many_times_faster_than_one_spot_at_a_time():
    windows = spots.as_windows(some_spots(np.random.default_rng(8), 4096, 800.0), 2.5)
    results = np.empty((len(RESULT_COLUMNS), 4096))
    flags = np.zeros(4096, np.int32)
    options = {"method": "mle", "sigma_px": 1.6, "free_sigma": True, "correct_bias": True}

    def scalar():
        fit_chosen(windows, np.arange(512), **options, results=results, flags=flags)

    def vector():
        fit_windows(windows, 3, **options)

    scalar()
    vector()
    ratio = 8 * cpu_time(scalar) / cpu_time(vector)
    # Some 40 with vectors of 512 bits.
    assert ratio > 8


@pytest.mark.skipif(
    platform.machine().lower() not in {"x86_64", "amd64"}, reason="names of other instructions"
)
def test_the_arithmetic_of_lanes_is_packed():
    @numba.njit(error_model="numpy", fastmath={"contract"})
    def kernel(values, along):
        profile(load(values, 0), load(values, 1), 7, along)
        store(values, 0, load(along, 3) * 2.0)

    kernel(np.ones(2 * LANES, np.float32), np.zeros(35 * LANES, np.float32))
    (assembly,) = kernel.inspect_asm().values()
    words = [line.split()[0].lstrip("v") for line in assembly.splitlines() if line.split()]
    kinds = ("mul", "add", "sub", "div", "fmadd", "fnmadd", "fmsub", "fnmsub")
    packed = sum(word.startswith(kinds) and word.endswith("ps") for word in words)
    scalar = sum(word.startswith(kinds) and word.endswith(("ss", "sd")) for word in words)
    assert packed > 25
    assert scalar < 0.1 * packed


def test_a_second_process_compiles_nothing():
    windows = spots.as_windows(some_spots(np.random.default_rng(9), 20, 800.0), 2.5)
    fit_windows(windows, 3, method="mle", sigma_px=1.6)
    trial = """
import json
import numpy as np
from rotortrack.localise import lanes
from rotortrack.localise.windows import Windows
windows = Windows(np.zeros((1, 49, 16), np.float32), np.full((1, 49, 16), np.inf, np.float32),
                  np.zeros(0, np.int32))
lanes.fit_windows(windows, 3, method="mle", sigma_px=1.6)
stats = lanes._fit.stats
print(json.dumps([sum(stats.cache_hits.values()), sum(stats.cache_misses.values())]))
"""
    done = subprocess.run(
        [sys.executable, "-c", trial], capture_output=True, text=True, check=True, env=os.environ
    )
    assert json.loads(done.stdout) == [1, 0]


def test_windows_without_spots_give_empty_results():
    empty = Windows(
        np.zeros((0, 49, LANES), np.float32),
        np.zeros((0, 49, LANES), np.float32),
        np.zeros(0, np.int32),
    )
    results, flags = fit_windows(empty, 3, method="mle", sigma_px=1.6)
    assert results.shape == (len(RESULT_COLUMNS), 0)
    assert flags.shape == (0,)
