"""Fit windows of candidates, cut from raw frames and laid out for vector instructions.

Windows stand in batches of LANES: pixel by pixel, the values of all windows of a batch lie side by
side, so one vector instruction treats the same pixel of every window. What must not count, be it
beyond the frame's border, without a number, or masked by an infinite variance of the camera, has
the value 0 and an infinite variance: weights 1 / (mu + v) are then 0 without any test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.camera import Camera
from rotortrack.flags import FitFlag
from rotortrack.kernels import kernel
from rotortrack.localise.vectors import LANES as LANES

_CACHE_LINE_BYTES = 64

_MASKED_PIXELS = int(FitFlag.MASKED_PIXELS)
_SATURATED = int(FitFlag.SATURATED)
_CLIPPED = int(FitFlag.CLIPPED)


@dataclass(frozen=True)
class Windows:
    """Windows of n candidates in ceil(n / LANES) batches; spare lanes hold what is masked.

    Attributes
    ----------
    photons, variance
        (batch, pixel, LANES) float32: photo-electrons and read variance (electrons^2, infinite for
        pixels that do not count); pixels run row by row through a window.
    flags
        (n,) int32 bits of FitFlag: MASKED_PIXELS, SATURATED, CLIPPED.
    """

    photons: NDArray[np.float32]
    variance: NDArray[np.float32]
    flags: NDArray[np.int32]


@dataclass(frozen=True)
class CameraArrays:
    """A camera as kernels take it: float32, each (1, 1) for all pixels alike or (height, width)."""

    offset_adu: NDArray[np.float32]
    gain_e_per_adu: NDArray[np.float32]
    variance_e2: NDArray[np.float32]
    saturation_adu: NDArray[np.float32]


def camera_arrays(camera: Camera, counts_dtype: np.dtype[Any]) -> CameraArrays:
    """Prepare a camera for kernels.

    Parameters
    ----------
    camera
        Numbers or maps.
    counts_dtype
        Number type of the frames, whose largest integer saturates when the camera names no limit.
    """
    limit = camera.saturation_adu
    if limit is None:
        limit = np.iinfo(counts_dtype).max if counts_dtype.kind in "iu" else np.inf
    return CameraArrays(
        *(
            np.atleast_2d(np.asarray(value, np.float32))
            for value in (camera.offset_adu, camera.gain_e_per_adu, camera.variance_e2, limit)
        )
    )


def cut_windows(
    counts: NDArray[Any],
    camera: CameraArrays,
    candidates: NDArray[np.int32],
    radius: int,
) -> Windows:
    """Cut the window of every candidate and turn its counts into photo-electrons.

    Parameters
    ----------
    counts
        (frame, height, width) raw counts.
    camera
        Of :func:`camera_arrays`.
    candidates
        (n, 3) frame, row, column; windows may reach beyond the frame.
    radius
        Windows are 2 * radius + 1 pixels wide.
    """
    n = len(candidates)
    batches = -(-n // LANES)
    pixels = (2 * radius + 1) ** 2
    windows = Windows(
        _aligned((batches, pixels, LANES)),
        _aligned((batches, pixels, LANES)),
        np.zeros(n, np.int32),
    )
    if camera.variance_e2.size == 1:
        windows.variance[:] = camera.variance_e2[0, 0]
    # Spare lanes of the last batch.
    windows.photons[n // LANES :, :, n % LANES :] = 0.0
    windows.variance[n // LANES :, :, n % LANES :] = np.inf
    _cut(
        counts,
        *_alike(camera, counts.shape[1:]),
        camera.saturation_adu,
        candidates,
        radius,
        windows.photons.reshape(-1),
        windows.variance.reshape(-1),
        windows.flags,
    )
    return windows


def _alike(
    camera: CameraArrays, shape: tuple[int, ...]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Give offset, gain and variance as three numbers or as three maps."""
    values = (camera.offset_adu, camera.gain_e_per_adu, camera.variance_e2)
    if len({value.size for value in values}) == 1:
        return values
    offset, gain, variance = (
        np.ascontiguousarray(np.broadcast_to(value, shape)) for value in values
    )
    return offset, gain, variance


def _aligned(shape: tuple[int, int, int]) -> NDArray[np.float32]:
    """Make room in which no vector straddles two cache lines."""
    count = math.prod(shape)
    raw = np.empty(count + LANES, np.float32)
    skip = (-raw.ctypes.data % _CACHE_LINE_BYTES) // raw.itemsize
    return raw[skip : skip + count].reshape(shape)


@kernel
def _cut(
    counts: NDArray[Any],
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    variance: NDArray[np.float32],
    saturation: NDArray[np.float32],
    candidates: NDArray[np.int32],
    radius: int,
    photons: NDArray[np.float32],
    noise: NDArray[np.float32],
    flags: NDArray[np.int32],
) -> None:
    _, height, width = counts.shape
    size = 2 * radius + 1
    is_uniform = variance.size == 1
    has_limits = saturation.size > 1
    for k in range(candidates.shape[0]):
        frame = counts[candidates[k, 0]]
        top = candidates[k, 1] - radius
        left = candidates[k, 2] - radius
        place = (k // LANES) * size * size * LANES + k % LANES
        flag = 0
        is_inside = top >= 0 and left >= 0 and top + size <= height and left + size <= width
        is_plain = is_inside and not has_limits
        if is_plain:
            highest = np.float32(-np.inf)
            target = place
            for i in range(top, top + size):
                line = frame[i, left : left + size]
                if is_uniform:
                    level = offset[0, 0]
                    factor = gain[0, 0]
                    for j in range(size):
                        count = np.float32(line[j])
                        value = (count - level) * factor
                        photons[target] = value
                        is_plain &= math.isfinite(value)
                        highest = max(highest, count)
                        target += LANES
                else:
                    levels = offset[i, left : left + size]
                    factors = gain[i, left : left + size]
                    spreads = variance[i, left : left + size]
                    for j in range(size):
                        count = np.float32(line[j])
                        spread = spreads[j]
                        value = (count - levels[j]) * factors[j]
                        photons[target] = value
                        noise[target] = spread
                        is_plain &= math.isfinite(value + spread)
                        highest = max(highest, count)
                        target += LANES
            # The fit's own variance, of all pixels alike, was filled in at once beforehand.
            is_plain &= not is_uniform or math.isfinite(variance[0, 0])
            if highest >= saturation[0, 0]:
                flag |= _SATURATED
        if not is_plain:
            flag = 0
            target = place
            for i in range(top, top + size):
                for j in range(left, left + size):
                    photons[target] = 0.0
                    noise[target] = np.inf
                    if i < 0 or i >= height or j < 0 or j >= width:
                        flag |= _CLIPPED
                    else:
                        row = 0 if is_uniform else i
                        column = 0 if is_uniform else j
                        count = np.float32(frame[i, j])
                        value = (count - offset[row, column]) * gain[row, column]
                        spread = variance[row, column]
                        if math.isfinite(value) and spread < np.inf:
                            photons[target] = value
                            noise[target] = spread
                            if count >= (saturation[i, j] if has_limits else saturation[0, 0]):
                                flag |= _SATURATED
                        else:
                            flag |= _MASKED_PIXELS
                    target += LANES
        flags[k] = flag
