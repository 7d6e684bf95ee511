"""Fits of many windows at once: sixteen spots in the lanes of vectors, in float32.

A fit starts from a linear template, so close to the optimum that Newton's steps usually end it
after three or four. A lane that has settled stands still, hence no result depends on what shares
its batch. What does not settle, or settles where it may not, goes to the scalar fit of
:mod:`rotortrack.localise.fit`, which is also what the lanes are tested against.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from rotortrack.flags import FitFlag
from rotortrack.kernels import kernel
from rotortrack.localise.fit import METHODS, RESULT_COLUMNS, fit_chosen
from rotortrack.localise.lane_math import (
    ENTRIES,
    FIXED,
    LEAST_PIVOT,
    PROFILE_ROWS,
    Scratch,
    factor,
    information,
    products,
    profile,
    score,
    solve,
)
from rotortrack.localise.lane_results import finish
from rotortrack.localise.lane_start import MLE, prepare, start_from_template
from rotortrack.localise.templates import template
from rotortrack.localise.vectors import (
    LANES,
    all_lanes,
    bits,
    larger,
    load,
    select,
    smaller,
    store,
)
from rotortrack.localise.windows import Windows

FIRST_ITERATIONS: Final = 7
SECOND_ITERATIONS: Final = 30
"""Iterations of all windows, and of those that have not settled by then, from the start again."""

SETTLED_STEP: Final = 0.03
"""A lane has settled with a Newton step this short, in standard deviations of all parameters
together. Newton's steps shrink by squares: the step is still taken, and what is left is 1e-4 of a
standard deviation in the median and below 5e-3 in 99 of 100 fits."""

_NEWTON_BELOW = 10.0
"""Squared length of a step, in standard deviations, after which Newton's matrix is used."""

_SIGMA_BOUNDS_PX = (0.35, 20.0)
_LEAST_PHOTONS = 1e-3

_AT_BOUND = int(FitFlag.AT_BOUND)


def fit_windows(
    windows: Windows,
    radius: int,
    *,
    method: Literal["lsq", "wlsq", "mle"],
    sigma_px: float,
    free_sigma: bool = True,
    correct_bias: bool = True,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Fit an integrated Gaussian on a flat background to every window.

    Parameters
    ----------
    windows
        Photo-electrons and read variances.
    radius
        Windows are 2 * radius + 1 pixels wide.
    method
        What is minimised: squares, squares weighted with 1 / value, or the deviance of Poisson and
        read noise (the maximum of the likelihood).
    sigma_px
        Width that spots are expected to have, or have when it is not fitted, pixels.
    free_sigma
        Whether the width is fitted.
    correct_bias
        Subtract the bias of likelihood fits to second order, see :mod:`rotortrack.localise.bias`;
        their errors are then those of the corrected parameters. At 250 photons on 8 of background
        it lowers the bias of the photons from 4.7 to 0.6 %; below 150 photons the series does not
        tell all of it.

    Returns
    -------
    results : ndarray, shape (10, n)
        Rows RESULT_COLUMNS, x and y in pixels from the window's middle; NaN where unknown. Chi2
        and log-likelihood ratio are those at the optimum, before any correction.
    flags : ndarray of int32, shape (n,)
        Bits of FitFlag: those of the windows, AT_BOUND, and how a fit ended that did not settle.

    Notes
    -----
    Costs about 0.3 us for 7 x 7 pixels with AVX-512, errors included, and 0.07 us more with the
    correction. The scalar fit, some 60 us for a window as hard as these, takes one isolated spot in
    10 000 at 250 photons, and one window in 1000 where spots overlap.
    """
    correct = correct_bias and method == "mle"
    width = (sigma_px, free_sigma)
    results, flags, left = _run(windows, radius, method, *width, correct, FIRST_ITERATIONS)
    if len(left):
        # A straggler would hold up its whole batch, so stragglers have batches of their own.
        again = _gather(windows, left)
        results[:, left], flags[left], rest = _run(
            again, radius, method, *width, correct, SECOND_ITERATIONS
        )
        left = left[rest]
    flags |= windows.flags
    if len(left):
        fit_chosen(
            windows,
            left,
            method=method,
            sigma_px=sigma_px,
            free_sigma=free_sigma,
            correct_bias=correct,
            results=results,
            flags=flags,
        )
    return results, flags


def _run(
    windows: Windows,
    radius: int,
    method: str,
    sigma_px: float,
    free_sigma: bool,
    correct_bias: bool,
    iterations: int,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int64]]:
    """Fit in lanes; the third result numbers the windows that did not settle."""
    n = len(windows.flags)
    lanes = len(windows.photons) * LANES
    results = np.empty((len(RESULT_COLUMNS), lanes))
    flags = np.empty(lanes, np.int32)
    unsettled = np.empty(lanes, np.bool_)
    start = template(radius, sigma_px, free_sigma)
    _fit(
        windows.photons.reshape(-1),
        windows.variance.reshape(-1),
        2 * radius + 1,
        METHODS[method],
        free_sigma,
        correct_bias,
        iterations,
        start.filters,
        start.curves,
        start.range[0],
        start.range[1],
        results.reshape(-1),
        flags,
        unsettled,
    )
    left = np.flatnonzero(unsettled[:n])
    flags[left] = 0
    return results[:, :n], flags[:n], left


def _gather(windows: Windows, chosen: NDArray[np.int64]) -> Windows:
    """Copy chosen windows into batches of their own."""
    shape = (-(-len(chosen) // LANES), windows.photons.shape[1], LANES)
    photons = np.zeros(shape, np.float32)
    variance = np.full(shape, np.inf, np.float32)
    places = np.arange(len(chosen))
    for source, target in ((windows.photons, photons), (windows.variance, variance)):
        target[places // LANES, :, places % LANES] = source[chosen // LANES, :, chosen % LANES]
    return Windows(photons, variance, windows.flags[chosen])


@kernel
def _scratch(count: int) -> Scratch:
    """Make room for `count` vectors, none of which straddles two cache lines."""
    raw = np.empty((count + 1) * LANES, np.float32)
    skip = (-raw.ctypes.data % (4 * LANES)) // 4
    return raw[skip : skip + count * LANES]


@kernel
def _fit(
    photons: Scratch,
    variance: Scratch,
    size: int,
    method: int,
    free_sigma: bool,
    correct_bias: bool,
    iterations: int,
    filters: NDArray[np.float32],
    curves: NDArray[np.float32],
    least_ratio: float,
    largest_ratio: float,
    results: NDArray[np.float64],
    flags: NDArray[np.int32],
    unsettled: NDArray[np.bool_],
) -> None:
    pixels = size * size
    batches = flags.shape[0] // LANES
    data = _scratch(pixels)
    noise = _scratch(pixels)
    weights = _scratch(pixels)
    along_x = _scratch(PROFILE_ROWS * size)
    along_y = _scratch(PROFILE_ROWS * size)
    system = _scratch(ENTRIES + 5)
    step = system[ENTRIES * LANES :]
    state = _scratch(5)
    inverse = _scratch(25)
    share = 1.0 if method == MLE else 0.0
    fixed = 0.0 if free_sigma else FIXED
    moving = 1.0 if free_sigma else 0.0
    for batch in range(batches):
        raw = photons[batch * pixels * LANES : (batch + 1) * pixels * LANES]
        spread = variance[batch * pixels * LANES : (batch + 1) * pixels * LANES]
        count = prepare(raw, spread, pixels, method, data, noise)
        start_from_template(
            raw, spread, pixels, count, filters, curves, least_ratio, largest_ratio, state
        )
        x = load(state, 0)
        y = load(state, 1)
        light = load(state, 2)
        ground = load(state, 3)
        sigma = load(state, 4)
        usable = count > 5.0
        active = usable
        newton = all_lanes(1.0)
        held = count < 0.0
        for _ in range(iterations):
            if bits(active) == 0:
                break
            scale = 1.0 / sigma
            profile(x, scale, size, along_x)
            profile(y, scale, size, along_y)
            products(along_x, size)
            products(along_y, size)
            score(
                data,
                noise,
                share,
                newton,
                size,
                light,
                ground,
                scale,
                along_x,
                along_y,
                weights,
                system,
            )
            information(weights, size, along_x, along_y, system)
            pinned = (ground <= 0.0) & ((load(step, 3) <= 0.0) | held)
            store(system, 9, load(system, 9) + select(pinned, FIXED, 0.0))
            store(step, 3, select(pinned, 0.0, load(step, 3)))
            store(system, 14, load(system, 14) + fixed)
            store(step, 4, load(step, 4) * moving)
            g_0 = load(step, 0)
            g_1 = load(step, 1)
            g_2 = load(step, 2)
            g_3 = load(step, 3)
            g_4 = load(step, 4)
            sound = factor(system) > LEAST_PIVOT
            solve(system, step)
            length = g_0 * load(step, 0) + g_1 * load(step, 1) + g_2 * load(step, 2)
            length = length + g_3 * load(step, 3) + g_4 * load(step, 4)
            sound = sound & (length >= 0.0)
            # A step beyond the bound of the background ends on it; there, one that leads out is
            # taken back, and the next one leaves the background where it is.
            fall = select(pinned, 0.0, -load(step, 3))
            part = select(fall > ground, ground / fall, 1.0)
            blocked = (fall > 0.0) & (ground <= 0.0)
            moved = active & sound & ~blocked
            per_photon = part / light
            dx = smaller(larger(load(step, 0) * per_photon, -0.7), 0.7)
            dy = smaller(larger(load(step, 1) * per_photon, -0.7), 0.7)
            x = select(moved, x + dx, x)
            y = select(moved, y + dy, y)
            wider = sigma + load(step, 4) * per_photon
            brighter = light + load(step, 2) * part
            sigma = select(moved, smaller(larger(wider, sigma * 0.6), sigma * 1.6), sigma)
            light = select(moved, smaller(larger(brighter, light * 0.3), light * 3.0), light)
            ground = select(moved, larger(ground - fall, 0.0), ground)
            ended = moved & (part >= 1.0) & ~held
            held = blocked & sound
            limit = select(newton >= 1.0, SETTLED_STEP**2, 0.01 * SETTLED_STEP**2)
            # Where a matrix is not positive definite, the next one has half as much of Newton's;
            # after a long step it is Fisher's, which always is.
            newton = select(
                sound,
                select(length < _NEWTON_BELOW, smaller(2.0 * newton + 0.25, 1.0), 0.0),
                0.5 * newton,
            )
            active = active & ~(ended & (length < limit))
        settled = usable & ~active
        settled = settled & (abs(x) <= 0.5 * size - 0.5) & (abs(y) <= 0.5 * size - 0.5)
        settled = settled & (sigma > _SIGMA_BOUNDS_PX[0]) & (sigma < _SIGMA_BOUNDS_PX[1])
        settled = settled & (light > _LEAST_PHOTONS)
        at_bound = ground <= 0.0
        store(state, 0, x)
        store(state, 1, y)
        store(state, 2, light)
        store(state, 3, ground)
        store(state, 4, sigma)
        known = finish(
            raw,
            spread,
            noise,
            method == MLE,
            correct_bias,
            fixed,
            size,
            at_bound,
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
        settled = settled & known
        for a in range(5):
            store(results, a * batches + batch, load(state, a))
        left = bits(settled)
        bound = bits(at_bound)
        for lane in range(LANES):
            unsettled[batch * LANES + lane] = (left >> lane) & 1 == 0
            flags[batch * LANES + lane] = _AT_BOUND * ((bound >> lane) & 1)
