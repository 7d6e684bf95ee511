"""Windows hold the camera's photo-electrons of their candidates and nothing that must not count."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.cameras.camera import Camera
from rotortrack.flags import FitFlag
from rotortrack.localise.windows import LANES, camera_arrays, cut_windows

SHAPE = (3, 20, 30)


def some_camera(rng, *, maps):
    size = SHAPE[1:] if maps else ()
    return Camera(
        offset_adu=rng.uniform(90, 110, size)[()],
        gain_e_per_adu=rng.uniform(0.4, 0.6, size)[()],
        read_noise_e=rng.uniform(1.0, 3.0, size)[()],
    )


def plain(values, fill, candidate, radius):
    """The window of one candidate in a padded image."""
    row, column = candidate[1] + radius, candidate[2] + radius
    padded = np.pad(values, radius, constant_values=fill)
    return padded[row - radius : row + radius + 1, column - radius : column + radius + 1].ravel()


@pytest.mark.parametrize("maps", [False, True])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
@pytest.mark.parametrize("radius", [2, 3, 5])
def test_windows_are_those_of_the_padded_frame(maps, dtype, radius):
    rng = np.random.default_rng(1)
    counts = rng.integers(0, 3000, SHAPE).astype(dtype)
    camera = some_camera(rng, maps=maps)
    candidates = rng.integers(0, SHAPE, (3 * LANES + 5, 3)).astype(np.int32)
    windows = cut_windows(counts, camera_arrays(camera, counts.dtype), candidates, radius)
    photons = camera.to_photons(counts)
    variance = np.broadcast_to(np.float32(camera.variance_e2), SHAPE[1:])
    assert windows.photons.shape == (4, (2 * radius + 1) ** 2, LANES)
    for k, candidate in enumerate(candidates):
        batch, lane = divmod(k, LANES)
        np.testing.assert_allclose(
            windows.photons[batch, :, lane],
            plain(photons[candidate[0]], 0.0, candidate, radius),
            rtol=1e-5,
            atol=1e-4,
        )
        expected = plain(variance, np.inf, candidate, radius)
        np.testing.assert_allclose(windows.variance[batch, :, lane], expected, rtol=1e-6)
        assert bool(windows.flags[k] & FitFlag.CLIPPED) == bool(np.isinf(expected).any())
    assert not (windows.flags & ~FitFlag.CLIPPED).any()


def test_spare_lanes_hold_nothing_that_counts():
    counts = np.full((1, 9, 9), 500, np.uint16)
    windows = cut_windows(
        counts, camera_arrays(Camera(100, 1, 1), counts.dtype), np.array([[0, 4, 4]], np.int32), 3
    )
    assert (windows.photons[0, :, 1:] == 0).all()
    assert np.isinf(windows.variance[0, :, 1:]).all()


def test_pixels_without_a_number_and_dead_pixels_are_masked():
    counts = np.full((1, 9, 9), 500, np.float32)
    counts[0, 3, 3] = np.nan
    counts[0, 3, 4] = np.inf
    camera = camera_arrays(Camera(100, 1, np.full((9, 9), 2.0)), counts.dtype)
    camera.variance_e2[5, 5] = np.inf
    windows = cut_windows(counts, camera, np.array([[0, 4, 4], [0, 7, 7]], np.int32), 2)
    masked = np.isinf(windows.variance[0, :, 0]).reshape(5, 5)
    assert np.argwhere(masked).tolist() == [[1, 1], [1, 2], [3, 3]]
    assert (windows.photons[0, masked.ravel(), 0] == 0).all()
    assert windows.flags.tolist() == [
        FitFlag.MASKED_PIXELS,
        FitFlag.MASKED_PIXELS | FitFlag.CLIPPED,
    ]


def test_a_count_at_the_limit_is_saturated():
    counts = np.full((1, 9, 9), 500, np.uint16)
    counts[0, 2, 2] = 4095
    candidates = np.array([[0, 4, 4], [0, 5, 5]], np.int32)
    camera = Camera(100, 1, 1, saturation_adu=4095)
    flags = cut_windows(counts, camera_arrays(camera, counts.dtype), candidates, 2).flags
    assert flags.tolist() == [FitFlag.SATURATED, 0]
    limits = np.full((9, 9), 5000.0)
    limits[6, 6] = 500.0
    camera = Camera(100, 1, 1, saturation_adu=limits)
    flags = cut_windows(counts, camera_arrays(camera, counts.dtype), candidates, 2).flags
    assert flags.tolist() == [FitFlag.SATURATED, FitFlag.SATURATED]
    own_limit = camera_arrays(Camera(100, 1, 1), np.dtype(np.uint16)).saturation_adu
    assert own_limit.tolist() == [[65535.0]]
