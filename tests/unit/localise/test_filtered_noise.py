"""The noise of the filtered plane: what it is, and what must not move it."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from rotortrack.cameras.camera import Camera
from rotortrack.localise.detect import find_candidates
from rotortrack.localise.filtered_noise import (
    bands_of,
    filtered_noise,
    has_quiet_cells,
    noise_of_cells,
    plane_noise,
    white_noise_gains,
)
from rotortrack.localise.threshold import parse_threshold
from rotortrack.localise.wavelet import bspline_taps
from rotortrack.localise.windows import camera_arrays

TAPS = bspline_taps(3, 2.0).astype(np.float32)
CAMERA = Camera(offset_adu=0.0, gain_e_per_adu=1.0, read_noise_e=1.6)
READ_NOISE_E = 1.6


def plain_f(photons):
    """F by scipy in double precision, edges extended as far as the filter reaches."""
    wide = np.zeros(2 * TAPS.size - 1)
    wide[::2] = TAPS
    v1 = v2 = np.pad(photons.astype(np.float64), 12, mode="edge")
    for axis in (0, 1):
        v1 = scipy.ndimage.convolve1d(v1, TAPS.astype(np.float64), axis, mode="nearest")
    v2 = v1
    for axis in (0, 1):
        v2 = scipy.ndimage.convolve1d(v2, wide, axis, mode="nearest")
    return (v1 - v2)[12:-12, 12:-12]


def measured(frames, quantum=0.0):
    frames = np.ascontiguousarray(frames, np.float32)
    shape = tuple(int(side) for side in frames.shape)
    one = np.ones(1, np.float32)
    result = np.empty(len(frames))
    no_mask, no_rows = np.zeros(1, bool), np.zeros(shape[1], bool)
    filtered_noise(
        frames.reshape(-1),
        shape,
        0 * one,
        one,
        no_mask,
        no_rows,
        TAPS,
        bands_of(shape[1]),
        quantum,
        result,
    )
    return result


def film(seed, spots=0, photons=0.0, background=8.0, sigma=1.25, frames=6, side=256):
    rng = np.random.default_rng(seed)
    edges = np.arange(side + 1)
    result = np.empty((frames, side, side))
    for frame in result:
        x, y = rng.uniform(2, side - 2, (2, spots, 1))
        along_x = np.diff(ndtr((edges - x) / sigma), axis=1)
        along_y = np.diff(ndtr((edges - y) / sigma), axis=1)
        frame[:] = rng.poisson(background + photons * along_y.T @ along_x)
    return result + rng.normal(0, READ_NOISE_E, result.shape)


def candidates_per_frame(frames):
    arrays = camera_arrays(CAMERA, np.dtype(np.float32))
    threshold = parse_threshold("5.5*noise(Wave.F)")
    found = find_candidates(frames.astype(np.float32), arrays, threshold, taps=TAPS)
    return len(found) / len(frames)


@pytest.mark.parametrize("background", [2.0, 8.0, 50.0])
def test_white_noise_has_the_standard_deviation_of_theory(background):
    expected = np.sqrt(background + READ_NOISE_E**2) * white_noise_gains(TAPS.tobytes())[0]
    noise = measured(film(1, background=background, frames=40))
    # Cells that noise alone makes stand out are left out, too: 0.4 per cent; 40 frames tell 0.2.
    assert noise.mean() == pytest.approx(expected, rel=0.012)
    assert noise.std() < 0.03 * expected


def test_the_gains_for_white_noise_are_those_of_the_filter():
    impulse = np.zeros((41, 41))
    impulse[20, 20] = 1.0
    expected = np.sqrt((plain_f(impulse) ** 2).sum())
    in_f, in_f1 = white_noise_gains(TAPS.tobytes())
    assert in_f == pytest.approx(expected, rel=1e-6)
    finest = impulse[18:23, 18:23] - np.outer(TAPS, TAPS)
    assert in_f1 == pytest.approx(np.sqrt((finest**2).sum()), rel=1e-6)


@pytest.mark.parametrize("background", [8.0, 50.0])
@pytest.mark.parametrize("photons", [100.0, 250.0, 800.0, 5000.0])
def test_fifty_spots_of_any_brightness_move_it_less_than_two_per_cent(background, photons):
    empty = measured(film(2, background=background, frames=16)).mean()
    crowded = measured(film(3, 50, photons, background, frames=16)).mean()
    assert crowded == pytest.approx(empty, rel=0.02)


NOT_WHITE = {
    "smoothed": lambda frame: scipy.ndimage.gaussian_filter(frame, 0.8),
    "smoothed more": lambda frame: scipy.ndimage.gaussian_filter(frame, 1.2),
    "between pixels": lambda frame: scipy.ndimage.shift(frame, 0.5, order=1, mode="nearest"),
    "enlarged": lambda frame: scipy.ndimage.zoom(frame, 2, order=1)[:256, :256],
}


@pytest.mark.parametrize("name", NOT_WHITE)
def test_noise_that_is_not_white_is_measured_and_makes_no_candidates(name):
    frames = np.stack([NOT_WHITE[name](frame) for frame in film(4, background=50.0)])
    expected = np.mean([plain_f(frame).std() for frame in frames])
    assert measured(frames).mean() == pytest.approx(expected, rel=0.03)
    assert candidates_per_frame(frames) < 0.5


def test_an_uneven_background_is_not_taken_for_spots():
    # 5 to 205 photons from left to right; sigma clipping of the frame as a whole gives 0.73.
    level = np.broadcast_to(5 + np.arange(256) * 200 / 256, (256, 256))
    rng = np.random.default_rng(5)
    frames = rng.poisson(level, (6, 256, 256)) + rng.normal(0, READ_NOISE_E, (6, 256, 256))
    expected = np.mean([plain_f(frame).std() for frame in frames])
    assert measured(frames).mean() == pytest.approx(expected, rel=0.06)
    assert candidates_per_frame(frames) < 1


def test_constant_parts_tell_nothing_of_the_noise():
    frames = film(6, background=50.0)
    full = measured(frames).mean()
    frames[:, :, :192] = 0.0
    partly = measured(frames)
    assert (partly > 0.9 * full).all()


@pytest.mark.parametrize("level", [0.0, 8.1, 40000.3])
def test_constant_frames_have_the_noise_of_rounding_alone(level):
    noise = measured(np.full((2, 64, 64), level))
    np.testing.assert_array_less(noise, 1e-5 * level + 1e-12)
    assert candidates_per_frame(np.full((2, 64, 64), level)) == 0
    np.testing.assert_allclose(measured(np.full((1, 64, 64), level), 10.0), 2.9)


@pytest.mark.parametrize(
    "shape", [(256, 256), (70, 83), (16, 8), (15, 7), (5, 40), (40, 5), (1, 4)]
)
def test_the_stream_measures_what_the_whole_plane_shows(shape):
    frames = np.random.default_rng(7).normal(20, 3, (2, *shape)).astype(np.float32)
    expected = [plane_noise(plain_f(f).astype(np.float32), f, 0.0) for f in frames]
    np.testing.assert_allclose(measured(frames), expected, rtol=1e-4)


def test_a_small_region_keeps_its_bright_spot():
    # The spot fills F, so that noise told from F would hide it.
    y, x = np.indices((22, 20))
    spot = 1500 / (2 * np.pi * 1.3**2) * np.exp(-((x - 9) ** 2 + (y - 10) ** 2) / (2 * 1.3**2))
    frames = np.random.default_rng(9).poisson(8 + spot, (5, 22, 20)).astype(np.float32)
    assert not has_quiet_cells(22, 20)
    assert (np.abs(measured(frames)) > 5 * white_noise_gains(TAPS.tobytes())[0] * np.sqrt(8)).all()
    assert candidates_per_frame(frames) == pytest.approx(1, abs=0.5)


@pytest.mark.parametrize("shape", [(48, 48), (16, 256), (256, 48)])
def test_from_48_pixels_on_a_spot_leaves_enough_cells_alone(shape):
    assert has_quiet_cells(*shape)
    y, x = np.indices(shape)
    rng = np.random.default_rng(10)
    frames = rng.normal(20, 3, (30, *shape))
    empty = measured(frames).mean()
    for frame in frames:
        at_y, at_x = rng.uniform(2, np.array(shape) - 2)
        frame += 80 * np.exp(-((x - at_x) ** 2 + (y - at_y) ** 2) / (2 * 1.25**2))
    crowded = measured(frames)
    assert crowded.mean() == pytest.approx(empty, rel=0.03)
    assert crowded.max() < 1.25 * empty


@given(seed=st.integers(0, 2**32 - 1), level=st.floats(-1000, 1000), factor=st.floats(0.01, 100))
@settings(max_examples=20, deadline=None)
def test_a_level_does_not_move_it_and_a_factor_scales_it(seed, level, factor):
    frames = film(seed, 5, 500.0, frames=1, side=64)
    noise = measured(frames)
    np.testing.assert_allclose(measured(frames + level), noise, rtol=1e-3)
    np.testing.assert_allclose(measured(frames * factor), noise * factor, rtol=1e-3)


def test_frames_do_not_see_each_other():
    frames = film(8, 30, 800.0, frames=5)
    alone = [measured(frames[k : k + 1])[0] for k in range(5)]
    np.testing.assert_array_equal(measured(frames), alone)


def test_a_cell_with_a_spot_and_those_beside_it_do_not_count():
    squares = np.array([[1.0, 1.0, 9.0, 50.0, 9.0, 1.0, 1.0, 1.0]])
    tops = np.array([[2.0, 2.0, 3.0, 40.0, 3.0, 2.0, 2.0, 2.0]])
    assert noise_of_cells(tops, squares, 0.0) == 1.0
    assert noise_of_cells(tops, np.zeros_like(squares), 0.0) == 0.0
    assert noise_of_cells(np.full((1, 8), 99.0), squares, 0.0) == -1.0


@pytest.mark.parametrize("rest", ["", "+0*std(Wave.F2)"], ids=["streamed", "planes"])
def test_a_frame_without_any_quiet_cell_still_shows_its_spots(rest):
    frames = film(9, 1000, 300.0, frames=4)
    assert np.all(measured(frames) < 0.0)
    arrays = camera_arrays(CAMERA, np.dtype(np.float32))
    threshold = parse_threshold(f"5.5*noise(Wave.F){rest}")
    crowded = find_candidates(frames.astype(np.float32), arrays, threshold, taps=TAPS)
    noise = measured(film(9, frames=4)).mean()
    known = parse_threshold(f"{5.5 * noise}")
    expected = find_candidates(frames.astype(np.float32), arrays, known, taps=TAPS)
    assert len(crowded) > 0.85 * len(expected)
