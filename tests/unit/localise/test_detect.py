"""Candidates of the streamed search are those of the plain filter, whatever the frame."""

from __future__ import annotations

import time

import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.cameras.camera import Camera
from rotortrack.localise.detect import find_candidates
from rotortrack.localise.noise import measure_noise, tile_noise
from rotortrack.localise.threshold import parse_threshold
from rotortrack.localise.wavelet import bspline_taps, wavelet_planes
from rotortrack.localise.windows import camera_arrays

TAPS = bspline_taps(3, 2.0).astype(np.float32)
CAMERA = Camera(offset_adu=100.0, gain_e_per_adu=0.45, read_noise_e=1.6)


def film(rng, frames=4, shape=(70, 83), spots=12, photons=800.0, background=8.0):
    """Counts of frames with Gaussian spots anywhere, border included."""
    y, x = np.indices(shape)
    electrons = np.full((frames, *shape), background)
    for frame in electrons:
        for at_x, at_y in rng.uniform(0, 1, (spots, 2)) * (shape[1], shape[0]):
            peak = photons / (2 * np.pi * 1.3**2)
            frame += peak * np.exp(-((x - at_x) ** 2 + (y - at_y) ** 2) / (2 * 1.3**2))
    noisy = rng.poisson(electrons) + rng.normal(0, 1.6, electrons.shape)
    return np.clip(np.rint(noisy / 0.45 + 100), 0, 65535).astype(np.uint16)


def search(counts, threshold="std(Wave.F1)", camera=CAMERA, taps=TAPS, **options):
    arrays = camera_arrays(camera, counts.dtype)
    return find_candidates(counts, arrays, parse_threshold(threshold), taps=taps, **options)


def convolve(image, taps, spacing):
    wide = np.zeros((len(taps) - 1) * spacing + 1)
    wide[::spacing] = taps
    once = scipy.ndimage.convolve1d(image, wide, 0, mode="constant")
    return scipy.ndimage.convolve1d(once, wide, 1, mode="constant")


def plain_planes(photons, taps):
    """F and F1 by scipy in double precision, edges extended as far as both kernels reach."""
    margin = 2 * len(taps)
    padded = np.pad(photons.astype(np.float64), margin, mode="edge")
    v1 = convolve(padded, taps, 1)
    v2 = convolve(v1, taps, 2)
    inner = (slice(margin, -margin or None),) * 2
    return (v1 - v2)[inner], photons - v1[inner]


def plain_candidates(photons, taps, limit_of, connectivity=8, border=0):
    f, f1 = plain_planes(photons, taps)
    limit = limit_of(f1)
    footprint = scipy.ndimage.generate_binary_structure(2, 1 if connectivity == 4 else 2)
    highest = scipy.ndimage.maximum_filter(f, footprint=footprint, mode="constant", cval=-np.inf)
    found = np.argwhere((f == highest) & (f >= limit) & (f > 0))
    inside = (found >= border).all(1) & (found < np.array(f.shape) - border).all(1)
    # Double and single precision may differ about a candidate this close to the limit.
    assert not (np.abs(f[tuple(found.T)] / limit - 1) < 1e-5).any()
    return found[inside]


def sample_sd(f1):
    return np.std(f1, ddof=1)


@pytest.mark.parametrize("shape", [(70, 83), (64, 64), (5, 40), (40, 5), (33, 16), (9, 9), (1, 4)])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
@pytest.mark.parametrize("maps", [False, True])
def test_candidates_are_those_of_scipy(shape, dtype, maps):
    rng = np.random.default_rng(11)
    counts = film(rng, shape=shape).astype(dtype)
    camera = CAMERA
    if maps:
        camera = Camera(rng.uniform(99, 101, shape), rng.uniform(0.44, 0.46, shape), 1.6)
    photons = camera.to_photons(counts)
    for connectivity, border in ((8, 0), (4, 0), (8, 3)):
        found = search(counts, camera=camera, connectivity=connectivity, border=border)
        for k, frame in enumerate(photons):
            expected = plain_candidates(frame, TAPS, sample_sd, connectivity, border)
            np.testing.assert_array_equal(found[found[:, 0] == k, 1:], expected)
    assert (np.diff(found[:, 0]) >= 0).all()


@pytest.mark.parametrize(("order", "scale"), [(1, 2.0), (2, 2.0), (3, 1.0), (3, 3.0), (5, 2.0)])
def test_other_kernels_find_what_scipy_finds(order, scale):
    counts = film(np.random.default_rng(12), frames=2)
    taps = bspline_taps(order, scale).astype(np.float32)
    found = search(counts, taps=taps)
    for k, frame in enumerate(CAMERA.to_photons(counts)):
        expected = plain_candidates(frame, taps, sample_sd)
        np.testing.assert_array_equal(found[found[:, 0] == k, 1:], expected)


@pytest.mark.parametrize(
    ("streamed", "plain"),
    [
        ("std(Wave.F1)", "std(0 + Wave.F1)"),
        ("2 * var(Wave.F1) / 9", "2 * var(0 + Wave.F1) / 9"),
        ("5.5*noise(Wave.F)", "5.5*noise(Wave.F) + 0*mean(I)"),
        ("noise(Wave.F1)", "noise(Wave.F1) + 0*mean(I)"),
    ],
)
@pytest.mark.parametrize("shape", [(40, 48), (30, 11)])
def test_streamed_thresholds_are_those_of_whole_planes(streamed, plain, shape):
    counts = film(np.random.default_rng(13), shape=shape)
    assert parse_threshold(streamed).is_streamed
    assert not parse_threshold(plain).is_streamed
    options = {"quantum_e": 0.45}
    np.testing.assert_array_equal(
        search(counts, streamed, **options), search(counts, plain, **options)
    )


def test_more_candidates_than_expected_find_room():
    counts = np.random.default_rng(14).integers(0, 60000, (3, 256, 256)).astype(np.uint16)
    found = search(counts, "0.001")
    assert len(found) > 4096
    for k, frame in enumerate(CAMERA.to_photons(counts)):
        expected = plain_candidates(frame, TAPS, lambda _: 0.001)
        np.testing.assert_array_equal(found[found[:, 0] == k, 1:], expected)


@given(
    seed=st.integers(0, 2**32 - 1),
    level=st.integers(0, 3000),
    flips=st.tuples(st.booleans(), st.booleans(), st.booleans()),
)
@settings(max_examples=25, deadline=None)
def test_a_level_moves_nothing_and_a_mirror_moves_all(seed, level, flips):
    counts = film(np.random.default_rng(seed), frames=1, shape=(64, 64))
    before = search(counts, "5.5*noise(Wave.F)", border=8)[:, 1:]
    raised = search(counts + np.uint16(level), "5.5*noise(Wave.F)", border=8)[:, 1:]
    # Rounding may decide a candidate that lies at the threshold to six digits.
    assert abs(len(raised) - len(before)) <= 1
    image = counts[0]
    places = before.copy()
    if flips[0]:
        image, places = image[::-1], places * (-1, 1) + (63, 0)
    if flips[1]:
        image, places = image[:, ::-1], places * (1, -1) + (0, 63)
    if flips[2]:
        image, places = image.T, places[:, ::-1]
    # Tiles of the noise are wider than high, so a constant stands for it here.
    fixed = search(counts, "12", border=8)[:, 1:]
    if flips[0]:
        fixed = fixed * (-1, 1) + (63, 0)
    if flips[1]:
        fixed = fixed * (1, -1) + (0, 63)
    if flips[2]:
        fixed = fixed[:, ::-1]
    turned = search(np.ascontiguousarray(image)[np.newaxis], "12", border=8)[:, 1:]
    assert {tuple(place) for place in turned} == {tuple(place) for place in fixed}


@pytest.mark.parametrize("value", [0, 100, 40000])
@pytest.mark.parametrize("threshold", ["5.5*noise(Wave.F)", "std(Wave.F1)", "0", "median(I) * 0"])
def test_a_constant_frame_has_no_candidates(value, threshold):
    counts = np.full((2, 40, 40), value, np.uint16)
    found = search(counts, threshold, quantum_e=0.45)
    if threshold.startswith("5.5"):
        assert len(found) == 0
    # Rounding leaves some 1e-7 of the level in a plane, which only a threshold of 0 lets pass.
    assert len(found) < 40 * 40


def test_a_quantised_frame_without_noise_shows_its_spots_alone():
    y, x = np.indices((64, 64))
    spot = 400 * np.exp(-((x - 30) ** 2 + (y - 20) ** 2) / (2 * 1.3**2))
    counts = (100 + np.rint(spot)).astype(np.uint16)[np.newaxis]
    found = search(counts, "5.5*noise(Wave.F)", quantum_e=0.45)
    assert [0, 20, 30] in found.tolist()
    assert len(found) <= 5


def test_hidden_and_missing_pixels_make_no_candidates():
    rng = np.random.default_rng(15)
    clean = film(rng, spots=0)
    hot = clean.copy()
    hot[:, 20, 30] = 9000
    hot[:, 41, 50:52] = 9000
    assert len(search(hot, "5.5*noise(Wave.F)")) >= 8
    hidden = np.zeros(clean.shape[1:], bool)
    hidden[20, 30] = hidden[41, 50] = hidden[41, 51] = True
    assert len(search(hot, "5.5*noise(Wave.F)", hidden=hidden)) <= 1
    assert len(search(hot, "5.5*noise(Wave.F) + 0*mean(I)", hidden=hidden)) <= 1
    missing = np.where(hidden, np.nan, hot.astype(np.float32)).astype(np.float32)
    assert len(search(missing, "5.5*noise(Wave.F)")) <= 1
    missing[1] = np.inf
    assert not (search(missing, "0.1")[:, 0] == 1).any()


def measured_noise(counts, *, all_rows=True):
    one = np.ones(1, np.float32)
    return measure_noise(
        counts.reshape(-1),
        counts.shape,
        100 * one,
        np.float32(0.45) * one,
        np.zeros(1, bool),
        np.zeros(counts.shape[1], bool),
        TAPS,
        0.45,
        all_rows=all_rows,
    )


@pytest.mark.parametrize("shape", [(70, 83), (7, 40), (40, 9)])
def test_noise_of_the_stream_is_that_of_the_plane(shape):
    counts = film(np.random.default_rng(16), shape=shape)
    for frame, (noise, mean, variance) in zip(
        CAMERA.to_photons(counts), zip(*measured_noise(counts), strict=True), strict=True
    ):
        f1 = wavelet_planes(frame, TAPS).f1.astype(np.float64)
        assert noise == pytest.approx(tile_noise(f1, frame, 0.45), rel=1e-4)
        assert mean == pytest.approx(f1.mean(), abs=1e-4)
        assert variance == pytest.approx(f1.var(ddof=1), rel=1e-4)


def test_noise_is_what_the_camera_makes_and_spots_hardly_move_it():
    # Poisson and read noise, rounding, and the gain of the filter for white noise.
    kernel = np.outer(TAPS, TAPS).astype(np.float64)
    finest = -kernel
    finest[2, 2] += 1
    expected = np.sqrt((8 + 1.6**2 + 0.45**2 / 12) * (finest**2).sum())
    empty = film(np.random.default_rng(17), shape=(256, 256), spots=0)
    alone = measured_noise(empty)[0].mean()
    assert alone == pytest.approx(expected, rel=0.02)
    assert measured_noise(empty, all_rows=False)[0].mean() == pytest.approx(alone, rel=0.02)
    for photons in (100.0, 800.0, 5000.0):
        crowded = film(np.random.default_rng(18), shape=(256, 256), spots=50, photons=photons)
        assert measured_noise(crowded)[0].mean() == pytest.approx(alone, rel=0.04)


def test_the_streamed_search_keeps_its_vectors():
    """A loop that fell back to numbers one by one would be no faster than scipy's."""
    counts = film(np.random.default_rng(20), frames=8, shape=(256, 256))
    photons = CAMERA.to_photons(counts)

    def seconds(work):
        work()
        best = np.inf
        for _ in range(5):
            start = time.thread_time()
            work()
            best = min(best, time.thread_time() - start)
        return best

    streamed = seconds(lambda: search(counts))
    plain = seconds(lambda: [plain_planes(frame, TAPS) for frame in photons])
    assert streamed < plain / 8
