"""What lane fits report: goodness of fit, corrected parameters and their errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.bias import LONGEST_CORRECTION
from rotortrack.localise.lane_math import (
    ENTRIES,
    FIXED,
    LEAST_PIVOT,
    SMALLEST_EXPECTATION,
    Scratch,
    deviance,
    factor,
    information,
    invert,
    products,
    profile,
    project,
    solve,
)
from rotortrack.localise.vectors import (
    LANES,
    Mask,
    Vector,
    all_lanes,
    larger,
    load,
    select,
    smaller,
    sqrt,
    store,
)


@kernel
def finish(
    raw: Scratch,
    spread: Scratch,
    noise: Scratch,
    likely: bool,
    correct_bias: bool,
    fixed: float,
    size: int,
    at_bound: Mask,
    state: Scratch,
    along_x: Scratch,
    along_y: Scratch,
    weights: Scratch,
    system: Scratch,
    inverse: Scratch,
    results: NDArray[np.float64],
    batch: int,
    batches: int,
) -> Mask:
    """Judge a batch at its optimum, correct the bias, and store errors and goodness of fit.

    Parameters
    ----------
    raw, spread
        Photo-electrons and read variance of the windows.
    noise
        What the weights of squares were made of, see :func:`score`.
    likely, correct_bias
        Whether the likelihood was maximised, and whether its bias is to be subtracted.
    fixed
        Goes onto the diagonal of sigma: 0 when it was free.
    size
        Pixels of an axis.
    at_bound
        Lanes whose background rests on 0.
    state
        The parameters; corrected in place.
    along_x, along_y, weights, system, inverse
        Scratch.
    results
        Rows of `batches` batches.
    batch, batches
        Which batch of how many.

    Returns
    -------
    Mask
        Lanes whose errors are known.
    """
    _profiles(state, size, along_x, along_y)
    _judge(raw, spread, size, state, along_x, along_y, weights, results, batch, batches)
    step = system[ENTRIES * LANES :]
    if correct_bias:
        _inform(weights, size, fixed, along_x, along_y, system)
        store(system, 9, load(system, 9) + select(at_bound, FIXED, 0.0))
        factor(system)
        invert(system, inverse)
        _weigh_by_trace(inverse, weights, size, state, along_x, along_y)
        project(weights, size, along_x, along_y, step)
        _correct(system, step, at_bound, state)
        _profiles(state, size, along_x, along_y)
        _weigh(spread, size, state, along_x, along_y, weights)
    if not likely:
        return _sandwich(
            noise,
            size,
            fixed,
            state,
            along_x,
            along_y,
            weights,
            system,
            inverse,
            results,
            batch,
            batches,
        )
    _inform(weights, size, fixed, along_x, along_y, system)
    known = factor(system) > LEAST_PIVOT
    for a in range(2):
        for b in range(5):
            store(step, b, 1.0 if a == b else 0.0)
        solve(system, step)
        known = known & (load(step, a) > 0.0) & (load(step, a) < np.inf)
        _store_error(load(step, a), a, state, results, batch, batches)
    return known


@kernel
def _profiles(state: Scratch, size: int, along_x: Scratch, along_y: Scratch) -> None:
    inverse = 1.0 / load(state, 4)
    profile(load(state, 0), inverse, size, along_x)
    profile(load(state, 1), inverse, size, along_y)
    products(along_x, size)
    products(along_y, size)


@kernel
def _inform(
    weights: Scratch, size: int, fixed: float, along_x: Scratch, along_y: Scratch, system: Scratch
) -> None:
    for entry in range(ENTRIES):
        store(system, entry, 0.0)
    information(weights, size, along_x, along_y, system)
    store(system, 14, load(system, 14) + fixed)


@kernel
def _store_error(
    squared: Vector,
    axis: int,
    state: Scratch,
    results: NDArray[np.float64],
    batch: int,
    batches: int,
) -> None:
    store(results, (5 + axis) * batches + batch, sqrt(squared) / load(state, 2))


@kernel
def _weigh(
    spread: Scratch,
    size: int,
    state: Scratch,
    along_x: Scratch,
    along_y: Scratch,
    weights: Scratch,
) -> None:
    """Fill the weights with 1 over the variance of each pixel."""
    ground = load(state, 3)
    for i in range(size):
        row = load(state, 2) * load(along_y, i)
        for j in range(size):
            expected = row * load(along_x, j) + ground + load(spread, i * size + j)
            store(weights, i * size + j, 1.0 / larger(expected, SMALLEST_EXPECTATION))


@kernel
def _correct(system: Scratch, step: Scratch, at_bound: Mask, state: Scratch) -> None:
    """Solve for minus the bias and add it; long ones are shortened, see :mod:`bias`."""
    r_0 = load(step, 0)
    r_1 = load(step, 1)
    r_2 = load(step, 2)
    r_3 = load(step, 3)
    r_4 = load(step, 4)
    solve(system, step)
    squared = r_0 * load(step, 0) + r_1 * load(step, 1) + r_2 * load(step, 2)
    squared = squared + r_3 * load(step, 3) + r_4 * load(step, 4)
    part = smaller(LONGEST_CORRECTION / sqrt(larger(squared, 1e-12)), 1.0)
    light = load(state, 2)
    sigma = load(state, 4)
    per_photon = part / light
    store(state, 0, load(state, 0) + load(step, 0) * per_photon)
    store(state, 1, load(state, 1) + load(step, 1) * per_photon)
    store(state, 2, larger(light + load(step, 2) * part, 0.5 * light))
    ground = larger(load(state, 3) + load(step, 3) * part, 0.0)
    store(state, 3, select(at_bound, 0.0, ground))
    store(state, 4, larger(sigma + load(step, 4) * per_photon, 0.5 * sigma))


@kernel
def _sandwich(
    noise: Scratch,
    size: int,
    fixed: float,
    state: Scratch,
    along_x: Scratch,
    along_y: Scratch,
    weights: Scratch,
    system: Scratch,
    inverse: Scratch,
    results: NDArray[np.float64],
    batch: int,
    batches: int,
) -> Mask:
    """Store the errors of squares, see :func:`rotortrack.localise.precision.covariance`."""
    for pixel in range(size * size):
        w = 1.0 / load(noise, pixel)
        # Pixels without weight have no finite variance either.
        store(weights, pixel, select(w > 0.0, w * w / load(weights, pixel), 0.0))
    filling = inverse[10 * LANES :]
    for entry in range(ENTRIES):
        store(filling, entry, 0.0)
    information(weights, size, along_x, along_y, filling)
    for pixel in range(size * size):
        store(weights, pixel, 1.0 / load(noise, pixel))
    _inform(weights, size, fixed, along_x, along_y, system)
    known = factor(system) > LEAST_PIVOT
    for a in range(2):
        column = inverse[a * 5 * LANES : (a + 1) * 5 * LANES]
        for b in range(5):
            store(column, b, 1.0 if a == b else 0.0)
        solve(system, column)
        total = all_lanes(0.0)
        for b in range(5):
            part = load(filling, b * (b + 1) // 2 + b) * load(column, b) * 0.5
            for c in range(b):
                part += load(filling, b * (b + 1) // 2 + c) * load(column, c)
            total += 2.0 * part * load(column, b)
        known = known & (total > 0.0) & (total < np.inf)
        _store_error(total, a, state, results, batch, batches)
    return known


@kernel
def _weigh_by_trace(
    inverse: Scratch,
    weights: Scratch,
    size: int,
    state: Scratch,
    along_x: Scratch,
    along_y: Scratch,
) -> None:
    """Multiply weights by half the trace of the model's Hessian with the inverse, times photons."""
    part = 0.5 / load(state, 2)
    scale = 1.0 / load(state, 4)
    xx = load(inverse, 0)
    xy = load(inverse, 1) * 2.0
    xn = load(inverse, 2) * 2.0
    xs = load(inverse, 4) * 2.0
    yy = load(inverse, 6)
    yn = load(inverse, 7) * 2.0
    ys = load(inverse, 9) * 2.0
    ns = load(inverse, 14) * 2.0
    ss = load(inverse, 24)
    for i in range(size):
        g = load(along_y, i) * part
        d = load(along_y, size + i) * part
        s = load(along_y, 2 * size + i) * part
        ds = load(along_y, 3 * size + i) * part
        bend = load(along_y, 4 * size + i) * part
        own = yy * scale * s + ys * ds + ss * bend
        for j in range(size):
            pixel = i * size + j
            gx = load(along_x, j)
            dx = load(along_x, size + j)
            sx = load(along_x, 2 * size + j)
            with_g = xx * scale * sx + xn * dx + xs * load(along_x, 3 * size + j)
            with_g += ns * sx + ss * load(along_x, 4 * size + j)
            with_d = xy * dx + yn * gx + ys * sx
            with_s = xs * dx + ns * gx + 2.0 * ss * sx
            total = with_g * g + with_d * d + with_s * s + own * gx
            store(weights, pixel, load(weights, pixel) * total)


@kernel
def _judge(
    raw: Scratch,
    spread: Scratch,
    size: int,
    state: Scratch,
    along_x: Scratch,
    along_y: Scratch,
    weights: Scratch,
    results: NDArray[np.float64],
    batch: int,
    batches: int,
) -> None:
    """Store the residuals' standard deviation, Pearson's chi-square and the deviance.

    `weights` receives 1 over the variance of each pixel.
    """
    light = load(state, 2)
    ground = load(state, 3)
    zero = all_lanes(0.0)
    count = first = second = pearson = total = zero
    for i in range(size):
        row = light * load(along_y, i)
        for j in range(size):
            pixel = i * size + j
            v = load(spread, pixel)
            expected = row * load(along_x, j) + ground
            residual = load(raw, pixel) - expected
            expected = larger(expected + v, SMALLEST_EXPECTATION)
            w = 1.0 / expected
            store(weights, pixel, w)
            kept = select(v < np.inf, residual, 0.0)
            count += select(v < np.inf, 1.0, 0.0)
            first += kept
            second += kept * residual
            pearson += w * residual * residual
            excess = larger(residual * w, -1.0)
            total += deviance(
                excess, excess * select(v < np.inf, larger(residual, -expected), 0.0), expected
            )
    mean = first / count
    store(results, 7 * batches + batch, sqrt(larger(second / count - mean * mean, 0.0)))
    store(results, 8 * batches + batch, pearson)
    store(results, 9 * batches + batch, total)
