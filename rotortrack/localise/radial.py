"""Spots as centres of radial symmetry: the point that the lines along all gradients pass nearest.

The squared distances of that point to the lines are least, weighted by the squared gradient over
the distance to the gradients' centroid (Parthasarathy, Nature Methods 9, 724 (2012)). With a
gradient g at the place p this weighted square is [(x - p_x) g_y - (y - p_y) g_x]^2 / r, so the
centre follows from two linear equations. A flat background has no gradient and needs no estimate.

Gradients are averages over 3 x 3, beyond the rim taken as zero, as published. A window with masked
or clipped pixels has no symmetry to look for: it gets nan.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.vectors import all_lanes, load, sqrt, store
from rotortrack.localise.windows import LANES

_SOFTENING_PX2 = 0.25
"""Added to squared distances, so that no gradient beside the centroid outweighs all others."""


@kernel
def radial_centres(
    photons: NDArray[np.float32],
    variance: NDArray[np.float32],
    radius: int,
    results: NDArray[np.float64],
) -> None:
    """Find the centre of every window with its standard deviation.

    The deviation is that of Poisson and read noise carried through the equations to first order,
    the pixels' own photons standing for their expectation.

    Parameters
    ----------
    photons, variance
        (batch, pixel, LANES) of Windows.
    radius
        Windows are 2 * radius + 1 pixels wide.
    results
        (10, n) of RESULT_COLUMNS; receives x, y (pixels from the window's centre) and their
        standard deviations, nan where no gradient tells them and where pixels are masked.
    """
    # Gradients stand where four pixels meet; a rim of zeros around them spares every test.
    side = 2 * radius + 2
    raw = np.zeros((2, side * side, LANES), np.float32)
    smooth = np.zeros((2, side * side, LANES), np.float32)
    effect = np.zeros((4, side * side, LANES), np.float32)
    spread = np.zeros((4, side * side, LANES), np.float32)
    outcome = np.empty((4, LANES), np.float32)
    for batch in range(photons.shape[0]):
        light = photons[batch]
        noise = variance[batch]
        _gradients(side, light, raw)
        _smooth(side, raw, smooth)
        x, y = _centre(side, smooth, effect)
        # What a gradient does by way of its averages is again a sum over its neighbours.
        _smooth(side, effect, spread)
        store(outcome, 0, x)
        store(outcome, 1, y)
        store(outcome, 2, sqrt(_variance(side, 0, light, noise, spread)))
        store(outcome, 3, sqrt(_variance(side, 2 * side * side, light, noise, spread)))
        first = batch * LANES
        for lane in range(min(LANES, results.shape[1] - first)):
            results[0, first + lane] = outcome[0, lane]
            results[1, first + lane] = outcome[1, lane]
            results[5, first + lane] = outcome[2, lane]
            results[6, first + lane] = outcome[3, lane]


@kernel
def _gradients(side: int, light: NDArray[np.float32], raw: NDArray[np.float32]) -> None:
    """Fill (2, side^2): gradients by x and by y."""
    n = side - 1
    size = side * side
    for i in range(1, n):
        for j in range(1, n):
            p = (i - 1) * n + j - 1
            fall = load(light, p + n + 1) - load(light, p)
            rise = load(light, p + 1) - load(light, p + n)
            store(raw, i * side + j, fall + rise)
            store(raw, size + i * side + j, fall - rise)


@kernel
def _smooth(side: int, gradients: NDArray[np.float32], result: NDArray[np.float32]) -> None:
    """Sum every 3 x 3 entries of each field, zeros beyond the rim."""
    size = side * side
    for field in range(result.shape[0]):
        for i in range(1, side - 1):
            for j in range(1, side - 1):
                total = all_lanes(0.0)
                for down in range(-1, 2):
                    for right in range(-1, 2):
                        total += load(gradients, field * size + (i + down) * side + j + right)
                store(result, field * size + i * side + j, total)


@kernel
def _centre(side: int, smooth: NDArray[np.float32], effect: NDArray[np.float32]) -> Any:
    """Solve for the centre, and fill (4, side^2) with what the smoothed gradients do to it.

    Returns
    -------
    tuple
        x and y; `effect` holds dx/dgx, dx/dgy, dy/dgx, dy/dgy.
    """
    size = side * side
    middle = 0.5 * side - 0.5
    total = all_lanes(0.0)
    x = all_lanes(0.0)
    y = all_lanes(0.0)
    for k in range(size):
        square = load(smooth, k) * load(smooth, k) + load(smooth, size + k) * load(smooth, size + k)
        total += square
        x += square * (k % side - middle)
        y += square * (k // side - middle)
    x = x / total
    y = y / total
    xx = all_lanes(0.0)
    xy = all_lanes(0.0)
    yy = all_lanes(0.0)
    right_x = all_lanes(0.0)
    right_y = all_lanes(0.0)
    for k in range(size):
        by_x = load(smooth, k)
        by_y = load(smooth, size + k)
        at_x = k % side - middle
        at_y = k // side - middle
        away_x = at_x - x
        away_y = at_y - y
        weight = 1.0 / sqrt(away_x * away_x + away_y * away_y + _SOFTENING_PX2)
        store(effect, k, weight)
        moment = weight * (at_x * by_y - at_y * by_x)
        xx += weight * by_y * by_y
        xy -= weight * by_x * by_y
        yy += weight * by_x * by_x
        right_x += by_y * moment
        right_y -= by_x * moment
    scale = 1.0 / (xx * yy - xy * xy)
    x = (right_x * yy - right_y * xy) * scale
    y = (right_y * xx - right_x * xy) * scale
    for k in range(size):
        by_x = load(smooth, k)
        by_y = load(smooth, size + k)
        share = load(effect, k) * scale
        of_x = share * (yy * by_y + xy * by_x)
        of_y = share * (-1.0 * xy * by_y - xx * by_x)
        across = y - (k // side - middle)
        along = k % side - middle - x
        store(effect, k, of_x * across)
        store(effect, size + k, of_x * along)
        store(effect, 2 * size + k, of_y * across)
        store(effect, 3 * size + k, of_y * along)
    return x, y


@kernel
def _variance(
    side: int,
    along: int,
    light: NDArray[np.float32],
    noise: NDArray[np.float32],
    effect: NDArray[np.float32],
) -> Any:
    """Carry the pixels' noise to a coordinate, whose effects start at `along`."""
    n = side - 1
    size = side * side
    total = all_lanes(0.0)
    for i in range(n):
        for j in range(n):
            k = i * side + j + along
            across = k + size
            fall = load(effect, k) - load(effect, k + side + 1)
            rise = load(effect, k + side) - load(effect, k + 1)
            slope = fall + rise
            fall = load(effect, across) - load(effect, across + side + 1)
            rise = load(effect, across + side) - load(effect, across + 1)
            slope += fall - rise
            read = load(noise, i * n + j)
            total += (load(light, i * n + j) + read) * slope * slope
    return total
