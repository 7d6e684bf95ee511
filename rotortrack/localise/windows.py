"""Fit windows of candidates, cut from raw frames and laid out for vector instructions.

Windows stand in batches of LANES: pixel by pixel, the values of all windows of a batch lie side by
side, so one vector instruction treats the same pixel of every window. What must not count, be it
beyond the frame's border, without a number, or masked by an infinite variance of the camera, has
the value 0 and an infinite variance: weights 1 / (mu + v) are then 0 without any test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.camera import Camera
from rotortrack.flags import FitFlag
from rotortrack.kernels import kernel

LANES: Final = 16

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
    pixels = (2 * radius + 1) ** 2
    shape = (-(-n // LANES), pixels, LANES)
    windows = Windows(
        np.zeros(shape, np.float32), np.full(shape, np.inf, np.float32), np.zeros(n, np.int32)
    )
    _cut(
        counts,
        camera.offset_adu,
        camera.gain_e_per_adu,
        camera.variance_e2,
        camera.saturation_adu,
        candidates,
        radius,
        windows.photons,
        windows.variance,
        windows.flags,
    )
    return windows


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
    has_offsets = offset.size > 1
    has_gains = gain.size > 1
    has_variances = variance.size > 1
    has_limits = saturation.size > 1
    for k in range(candidates.shape[0]):
        frame = counts[candidates[k, 0]]
        top = candidates[k, 1] - radius
        left = candidates[k, 2] - radius
        batch = k // LANES
        lane = k % LANES
        flag = 0
        pixel = 0
        for i in range(top, top + 2 * radius + 1):
            for j in range(left, left + 2 * radius + 1):
                if i < 0 or i >= height or j < 0 or j >= width:
                    flag |= _CLIPPED
                else:
                    count = np.float32(frame[i, j])
                    level = offset[i, j] if has_offsets else offset[0, 0]
                    factor = gain[i, j] if has_gains else gain[0, 0]
                    spread = variance[i, j] if has_variances else variance[0, 0]
                    limit = saturation[i, j] if has_limits else saturation[0, 0]
                    value = (count - level) * factor
                    if math.isfinite(value) and spread < np.inf:
                        photons[batch, pixel, lane] = value
                        noise[batch, pixel, lane] = spread
                        if count >= limit:
                            flag |= _SATURATED
                    else:
                        flag |= _MASKED_PIXELS
                pixel += 1
        flags[k] = flag
