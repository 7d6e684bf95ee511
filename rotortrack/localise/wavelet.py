"""Undecimated B-spline wavelet planes of a frame.

The filter convolves a frame with the B-spline kernel K1 and then with K2, which is K1 with a zero
between its taps: V1 = K1 * I, V2 = K2 * V1. The planes are F = V1 - V2 (where candidates are
sought), F1 = I - V1 (noise) and F2 = I - V2.

The frame is extended by its edge values by the half-width of K2 and both convolutions see zeros
beyond that, which is what ThunderSTORM does and what biases the two outermost rows and columns of
V2; agreement with the plugin, border included, is tested.

References
----------
Izeddin et al., Optics Express 20, 2081 (2012); Ovesny et al., Bioinformatics 30, 2389 (2014).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel


class Planes(NamedTuple):
    """The wavelet planes of one frame, each (height, width) float32 in the frame's unit."""

    f: NDArray[np.float32]
    f1: NDArray[np.float32]
    f2: NDArray[np.float32]


def bspline_taps(order: int, scale: float) -> NDArray[np.float64]:
    """Sample the B-spline of an order at the integers, stretched by a scale, with sum 1.

    Parameters
    ----------
    order
        Order q of the B-spline (q = 3 is piecewise quadratic).
    scale
        Stretch l in pixels.

    Returns
    -------
    ndarray, shape (2 * ceil(q * l / 2) - 1,)
        ``N_q(t / l + q / 2)`` by the Cox-de Boor recursion; q = 3, l = 2 gives 1 4 6 4 1 over 16.
    """
    count = 2 * math.ceil(order * scale / 2.0) - 1
    offsets = np.arange(count) - count // 2
    taps = np.array([_cox_de_boor(order, t / scale + order / 2.0) for t in offsets])
    normalised: NDArray[np.float64] = taps / taps.sum()
    return normalised


def _cox_de_boor(order: int, t: float) -> float:
    if order == 1:
        return 1.0 if 0.0 <= t < 1.0 else 0.0
    rising = t / (order - 1) * _cox_de_boor(order - 1, t)
    falling = (order - t) / (order - 1) * _cox_de_boor(order - 1, t - 1.0)
    return rising + falling


def wavelet_planes(frame: NDArray[np.float32], taps: NDArray[np.float32]) -> Planes:
    """Filter one frame.

    Parameters
    ----------
    frame
        (height, width) in photons, without NaN.
    taps
        Kernel of :func:`bspline_taps` as float32.

    Returns
    -------
    Planes
        F, F1 and F2 of the frame's shape.
    """
    return Planes(*_filter(frame, taps))


@kernel
def _filter(
    frame: NDArray[np.float32], taps: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    height, width = frame.shape
    margin = taps.size - 1
    padded = np.empty((height + 2 * margin, width + 2 * margin), np.float32)
    for i in range(padded.shape[0]):
        row = min(max(i - margin, 0), height - 1)
        for j in range(margin):
            padded[i, j] = frame[row, 0]
            padded[i, margin + width + j] = frame[row, width - 1]
        for j in range(width):
            padded[i, margin + j] = frame[row, j]
    first = _convolve(padded, taps, 1)
    second = _convolve(first, taps, 2)
    f = np.empty_like(frame)
    f1 = np.empty_like(frame)
    f2 = np.empty_like(frame)
    for i in range(height):
        for j in range(width):
            v1 = first[i + margin, j + margin]
            v2 = second[i + margin, j + margin]
            f[i, j] = v1 - v2
            f1[i, j] = frame[i, j] - v1
            f2[i, j] = frame[i, j] - v2
    return f, f1, f2


@kernel
def _convolve(
    image: NDArray[np.float32], taps: NDArray[np.float32], spacing: int
) -> NDArray[np.float32]:
    """Convolve along both axes with zeros beyond the image, taps `spacing` pixels apart."""
    height, width = image.shape
    half = taps.size // 2
    vertical = np.zeros_like(image)
    result = np.zeros_like(image)
    for i in range(height):
        target = vertical[i]
        for k in range(taps.size):
            row = i + (k - half) * spacing
            if 0 <= row < height:
                _add_scaled(target, image[row], taps[k])
    for i in range(height):
        target = result[i]
        source = vertical[i]
        for k in range(taps.size):
            shift = (k - half) * spacing
            if shift >= 0:
                _add_scaled(target[: width - shift], source[shift:], taps[k])
            else:
                _add_scaled(target[-shift:], source[: width + shift], taps[k])
    return result


@kernel
def _add_scaled(
    target: NDArray[np.float32], source: NDArray[np.float32], factor: np.float32
) -> None:
    # Contiguous one-dimensional slices are what the compiler turns into vector instructions.
    for j in range(target.size):
        target[j] += factor * source[j]
