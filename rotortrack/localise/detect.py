"""Candidates: where the filtered plane of a frame has a maximum above the threshold.

Thresholds that need nothing but the noise of a frame, and kernels of five taps, take the streamed
kernels of :mod:`rotortrack.localise.wavelet_rows`; everything else takes whole planes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.localise.candidates import frame_maxima, local_maxima
from rotortrack.localise.filtered_noise import (
    bands_of,
    filtered_noise,
    has_quiet_cells,
    plane_noise,
    white_noise_gains,
)
from rotortrack.localise.noise import measure_noise, tile_noise
from rotortrack.localise.threshold import Threshold
from rotortrack.localise.wavelet import Planes, wavelet_planes
from rotortrack.localise.windows import CameraArrays

Candidates = NDArray[np.int32]

_STREAMED_TAPS = 5
_SMALLEST = np.float32(1e-30)
_FIRST_CAPACITY = 4096
_NEIGHBOURS = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]


def find_candidates(
    counts: NDArray[Any],
    camera: CameraArrays,
    threshold: Threshold,
    *,
    taps: NDArray[np.float32],
    connectivity: int = 8,
    border: int = 0,
    quantum_e: float = 0.0,
    hidden: NDArray[np.bool_] | None = None,
) -> Candidates:
    """Find the candidates of every frame of a block.

    A candidate is at or above the threshold, positive, and no neighbour exceeds it; all pixels of
    a plateau are found. Pixels without a number and hidden ones are replaced by their neighbours
    before the filter, so they are no candidates of their own; a frame without any number has none.

    Parameters
    ----------
    counts
        (frame, height, width) uint16 or float32.
    camera
        Of :func:`rotortrack.localise.windows.camera_arrays`; infinite variance hides a pixel.
    threshold
        In photons of the filtered plane.
    taps
        Kernel of :func:`rotortrack.localise.wavelet.bspline_taps` as float32.
    connectivity
        4 or 8 neighbours.
    border
        Margin in pixels that is not searched.
    quantum_e
        Photo-electrons of one count, 0 where counts are not whole: noise cannot be less than what
        rounding to them makes.
    hidden
        (height, width) pixels that the filter must not see, such as hot ones.

    Returns
    -------
    ndarray, shape (n, 3)
        Frame within the block, row and column, in this order.
    """
    masks = _masks(camera, hidden, counts.shape[1:])
    counts = np.ascontiguousarray(counts)
    absent = np.zeros(len(counts), bool)
    if counts.dtype.kind == "f":
        counts, absent = _filled(counts)
    if taps.size != _STREAMED_TAPS or not threshold.is_streamed:
        return _by_planes(
            counts, camera, threshold, taps, connectivity, border, quantum_e, masks, absent
        )
    shape = len(counts), int(counts.shape[1]), int(counts.shape[2])
    pixels = counts.reshape(-1)
    offset, gain = _flat_maps(camera, shape[1:])
    values = _noises(pixels, shape, offset, gain, masks, taps, threshold.needs, quantum_e)
    limits = np.broadcast_to(threshold.value(values), len(counts)).copy()
    limits[~(limits < np.inf) | absent] = np.inf
    np.maximum(limits, _SMALLEST, out=limits)
    hides, row_hides = masks
    eight = connectivity == 8
    parts: list[Candidates] = []
    frame, capacity = 0, _FIRST_CAPACITY
    while not parts or frame < len(counts):
        room = np.empty((capacity, 3), np.int32)
        frame, rows = frame_maxima(
            pixels, shape, frame, offset, gain, hides, row_hides, taps, limits, eight, border, room
        )
        parts.append(room[:rows])
        if rows == 0:
            capacity *= 4
    return np.concatenate(parts)


def _noises(
    pixels: NDArray[Any],
    shape: tuple[int, int, int],
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    masks: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    taps: NDArray[np.float32],
    needs: frozenset[str],
    quantum_e: float,
) -> dict[str, NDArray[np.float64]]:
    """Measure what a streamed threshold needs, each (frame,)."""
    frames, height, width = shape
    values: dict[str, NDArray[np.float64]] = {}
    in_f, in_f1 = white_noise_gains(taps.tobytes())
    on_f = "noise(F)" in needs and has_quiet_cells(height, width)
    if on_f:
        noise = values["noise(F)"] = np.empty(frames)
        quantum = quantum_e * in_f
        layout = bands_of(height)
        filtered_noise(pixels, shape, offset, gain, *masks, taps, layout, quantum, noise)
        crowded = np.flatnonzero(noise < 0.0)
        if crowded.size:
            finest, _, _ = measure_noise(
                pixels.reshape(shape)[crowded].reshape(-1),
                (crowded.size, height, width),
                offset,
                gain,
                *masks,
                taps,
                quantum_e,
                all_rows=False,
            )
            noise[crowded] = _crowded_noise(noise[crowded], finest * (in_f / in_f1))
    if needs - values.keys():
        finest, _, variance = measure_noise(
            pixels,
            shape,
            offset,
            gain,
            *masks,
            taps,
            quantum_e,
            all_rows=any(name.startswith(("std", "var")) for name in needs),
        )
        values["noise(F1)"] = finest
        values["var(F1)"] = variance
        values["std(F1)"] = np.sqrt(variance)
        if not on_f:
            values["noise(F)"] = finest * (in_f / in_f1)
    return values


def _crowded_noise(bound: Any, white: Any) -> Any:
    """Give the noise of F in frames so full that hardly a cell of F is free of spots.

    A spot reaches half as far in F1, which then tells white noise far better than F does. Noise
    smoother than white is underestimated from it: false candidates cost time, lost spots are lost.

    Parameters
    ----------
    bound
        What :func:`filtered_noise` gave, negative.
    white
        Noise of F told from F1 as if it were white.
    """
    return np.minimum(-bound, white)


def _by_planes(
    counts: NDArray[Any],
    camera: CameraArrays,
    threshold: Threshold,
    taps: NDArray[np.float32],
    connectivity: int,
    border: int,
    quantum_e: float,
    masks: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    absent: NDArray[np.bool_],
) -> Candidates:
    hidden = masks[0].reshape(counts.shape[1:]) if masks[0].size > 1 else None
    in_f, in_f1 = white_noise_gains(taps.tobytes())
    on_f = has_quiet_cells(*counts.shape[1:])
    found = []
    for index, frame in enumerate(counts):
        if absent[index]:
            continue
        photons = (frame.astype(np.float32) - camera.offset_adu) * camera.gain_e_per_adu
        if hidden is not None:
            photons[hidden] = np.nan
            photons = _filled(photons[np.newaxis])[0][0]
        planes = _planes(photons, taps)
        values: dict[str, Any] = {
            "I": photons,
            "F": planes.f,
            "F1": planes.f1,
            "F2": planes.f2,
        }
        if any(name.startswith("noise") for name in threshold.needs):
            finest = tile_noise(planes.f1, photons, quantum_e)
            values["noise(F1)"] = finest
            white = finest * in_f / in_f1
            noise = plane_noise(planes.f, photons, quantum_e * in_f) if on_f else white
            values["noise(F)"] = noise if noise >= 0.0 else float(_crowded_noise(noise, white))
        limit = max(np.float32(threshold.value(values)), _SMALLEST)
        maxima = local_maxima(planes.f, limit, connectivity, border)
        rows = np.empty((len(maxima), 3), np.int32)
        rows[:, 0] = index
        rows[:, 1:] = maxima
        found.append(rows)
    return np.concatenate(found) if found else np.empty((0, 3), np.int32)


def _planes(photons: NDArray[np.float32], taps: NDArray[np.float32]) -> Planes:
    """Filter a frame that is extended by what the plugin's way would bias at its border."""
    extra = taps.size // 2
    inner = (slice(extra, -extra or None),) * 2
    planes = wavelet_planes(np.pad(photons, extra, mode="edge"), taps)
    return Planes(*(np.ascontiguousarray(plane[inner]) for plane in planes))


def _flat_maps(
    camera: CameraArrays, shape: tuple[int, ...]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Give offset and gain as one number each, or as maps both."""
    offset, gain = camera.offset_adu, camera.gain_e_per_adu
    if offset.size > 1 or gain.size > 1:
        offset, gain = (np.ascontiguousarray(np.broadcast_to(a, shape)) for a in (offset, gain))
    return offset.reshape(-1), gain.reshape(-1)


def _masks(
    camera: CameraArrays, hidden: NDArray[np.bool_] | None, shape: tuple[int, ...]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Give the pixels to hide, flat (one value when there are none), and whether a row has any."""
    mask: NDArray[np.bool_] = np.broadcast_to(~np.isfinite(camera.variance_e2), shape)
    if hidden is not None:
        mask = mask | hidden
    if not mask.any():
        return np.zeros(1, bool), np.zeros(shape[0], bool)
    return np.ascontiguousarray(mask).reshape(-1), np.logical_or.reduce(mask, axis=1)


def _filled(frames: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Give pixels without a number the mean of their neighbours, ring by ring into large holes.

    Returns the frames, copied where something is missing, and which of them have no number at all.
    """
    missing = ~np.isfinite(frames)
    absent: NDArray[np.bool_] = np.logical_and.reduce(missing, axis=(1, 2))
    if not missing.any():
        return frames, absent
    filled = np.where(missing, np.float32(0.0), frames)
    for index in np.flatnonzero(missing.any(axis=(1, 2)) & ~absent):
        known = np.pad(~missing[index], 1)
        frame = np.pad(filled[index], 1)
        while not known[1:-1, 1:-1].all():
            neighbours = [np.roll(known, shift, (0, 1)) for shift in _NEIGHBOURS]
            values = [np.roll(frame, shift, (0, 1)) for shift in _NEIGHBOURS]
            count = np.sum(neighbours, axis=0)
            mean = np.sum(values, axis=0, where=neighbours) / np.maximum(count, 1)
            reached = np.pad(np.ones(frames.shape[1:], bool), 1) & ~known & (count > 0)
            frame[reached] = mean[reached]
            known = known | reached
        filled[index] = frame[1:-1, 1:-1]
    return filled, absent
