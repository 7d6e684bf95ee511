"""Spots by the moments of their windows: what a centroid or a phase means for a Gaussian.

A window is reduced to five sums over its kept pixels,

    sum u(x) d,   sum u(y) d,   sum d,   sum over the border d,   sum h(x) h(y) d ,

where u tells the position and h, a bell in the middle, the width. They are set equal to
the same sums of a pixel-integrated Gaussian on a flat background, and the five equations for x, y,
photons, background and width are solved by Newton's method. So neither the light that the window
cuts off, nor a masked pixel, nor the frame's border pulls the spot aside. u = x is the centroid;
u = sin(2 pi x / n - phase), with the phase of the data, is the phasor.

The errors follow from the same equations: for small changes the estimate is linear in the pixels,
so its variance is the weighted sum of the pixels' Poisson and read variances.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.flags import FitFlag
from rotortrack.kernels import kernel
from rotortrack.localise.gaussian import BACKGROUND, PARAMETERS, PHOTONS, SIGMA, X, Y
from rotortrack.localise.moment_sums import (
    axis_sums,
    hold,
    invert,
    leave_out,
    model_sums,
    phase_weights,
    residual_sums,
)
from rotortrack.localise.vectors import (
    all_lanes,
    bits,
    larger,
    load,
    select,
    smaller,
    sqrt,
    store,
)
from rotortrack.localise.windows import LANES

CENTROID, PHASOR, GIVEN = range(3)
"""What tells the position.

GIVEN leaves x and y of `results` and their errors as they are, except in windows with masked or
clipped pixels, which the phasor's equations treat."""

ITERATIONS: Final = 4
SIGMA_FACTOR: Final = 2.5
"""A width further off the given one than by this factor is noise: the given one is used."""

WIDEST_BELL: Final = 0.4
"""The bell is no wider than this part of the radius."""

_LEFT_WINDOW = int(FitFlag.LEFT_WINDOW)
_SINGULAR = int(FitFlag.SINGULAR)
_NOT_FINITE = int(FitFlag.NOT_FINITE)
_ITERATION_LIMIT = int(FitFlag.ITERATION_LIMIT)
_SETTLED_PX = 0.01


@kernel
def match_moments(
    photons: NDArray[np.float32],
    variance: NDArray[np.float32],
    radius: int,
    kind: int,
    start_sigma: float,
    free_sigma: bool,
    results: NDArray[np.float64],
    flags: NDArray[np.int32],
) -> None:
    """Solve the moment equations of every window.

    Parameters
    ----------
    photons, variance
        (batch, pixel, LANES) of Windows.
    radius
        Windows are 2 * radius + 1 pixels wide.
    kind
        CENTROID, PHASOR, or GIVEN: x and y, with their errors, stand in `results`.
    start_sigma
        Width at which the equations start, pixels.
    free_sigma
        Whether the width is solved for or stays as given.
    results
        (10, n) receives RESULT_COLUMNS; x and y from the window's centre, pixels.
    flags
        (n,) bits of FitFlag, to which those of this step are added.
    """
    n = 2 * radius + 1
    profiles_x = np.ones((4, n, LANES), np.float32)
    profiles_y = np.ones((4, n, LANES), np.float32)
    along_x = np.empty((4, 4, LANES), np.float32)
    along_y = np.empty((4, 4, LANES), np.float32)
    weights_x = np.empty((n, LANES), np.float32)
    weights_y = np.empty((n, LANES), np.float32)
    columns = np.empty((n, LANES), np.float32)
    rows = np.empty((n, LANES), np.float32)
    data = np.empty((PARAMETERS, LANES), np.float32)
    step = np.empty((PARAMETERS, LANES), np.float32)
    jacobian = np.empty((PARAMETERS, PARAMETERS, LANES), np.float32)
    place = np.zeros((2, LANES), np.float32)
    outcome = np.empty((10, LANES), np.float32)
    holes = np.empty(n * n, np.int64)
    waves = np.empty((2, n), np.float32)
    bell = np.empty(n, np.float32)
    # A bell as wide as the window would weigh all pixels alike.
    bell_sigma = min(start_sigma, WIDEST_BELL * radius)
    for k in range(n):
        waves[0, k] = math.cos(2.0 * math.pi * (k - radius) / n)
        waves[1, k] = math.sin(2.0 * math.pi * (k - radius) / n)
        bell[k] = math.exp(-0.5 * ((k - radius) / bell_sigma) ** 2)
    reach = 0.5 * n + 0.5
    lower: Any = np.float32(start_sigma / SIGMA_FACTOR)
    upper: Any = np.float32(start_sigma * SIGMA_FACTOR)
    for batch in range(photons.shape[0]):
        light = photons[batch]
        noise = variance[batch]
        first = batch * LANES
        count = min(LANES, flags.shape[0] - first)

        for k in range(n):
            store(columns, k, 0.0)
        kept = all_lanes(0.0)
        core = all_lanes(0.0)
        total = all_lanes(0.0)
        found = 0
        for i in range(n):
            row = all_lanes(0.0)
            for j in range(n):
                value = load(light, i * n + j)
                counts = load(noise, i * n + j) < np.inf
                kept += select(counts, 1.0, 0.0)
                row += value
                core += value * (bell[i] * bell[j])
                store(columns, j, load(columns, j) + value)
                if bits(~counts) != 0:
                    holes[found] = i * n + j
                    found += 1
            store(rows, i, row)
            total += row
        whole = kept == n * n
        if kind == CENTROID:
            for k in range(n):
                store(weights_x, k, k - radius)
                store(weights_y, k, k - radius)
        else:
            phase_weights(columns, whole, waves, weights_x)
            phase_weights(rows, whole, waves, weights_y)
        placed_x = all_lanes(0.0)
        placed_y = all_lanes(0.0)
        for k in range(n):
            placed_x += load(weights_x, k) * load(columns, k)
            placed_y += load(weights_y, k) * load(rows, k)
        border = load(columns, 0) + load(columns, n - 1) + load(rows, 0) + load(rows, n - 1)
        border -= load(light, 0) + load(light, n - 1)
        border -= load(light, n * n - n) + load(light, n * n - 1)
        store(data, X, placed_x)
        store(data, Y, placed_y)
        store(data, PHOTONS, total)
        store(data, BACKGROUND, border)
        store(data, SIGMA, core)

        if kind == GIVEN:
            for lane in range(count):
                place[0, lane] = results[0, first + lane]
                place[1, lane] = results[1, first + lane]
        x = select(whole, larger(smaller(load(place, 0), reach), -reach), 0.0)
        y = select(whole, larger(smaller(load(place, 1), reach), -reach), 0.0)
        sigma = all_lanes(start_sigma)
        held = sigma < (0.0 if free_sigma else np.inf)
        given = whole & (sigma < (np.inf if kind == GIVEN else 0.0))
        spot = all_lanes(0.0)
        flat = all_lanes(0.0)
        move = all_lanes(0.0)
        for iteration in range(ITERATIONS + 1):
            axis_sums(x, sigma, weights_x, bell, profiles_x, along_x)
            axis_sums(y, sigma, weights_y, bell, profiles_y, along_y)
            model_sums(along_x, along_y, jacobian)
            if found > 0:
                leave_out(
                    noise,
                    holes[:found],
                    weights_x,
                    weights_y,
                    bell,
                    profiles_x,
                    profiles_y,
                    jacobian,
                )
            # Photons and background are linear: two of the equations give them at once.
            whole_light = load(jacobian, PARAMETERS * PHOTONS + PHOTONS)
            whole_count = load(jacobian, PARAMETERS * PHOTONS + BACKGROUND)
            border_light = load(jacobian, PARAMETERS * BACKGROUND + PHOTONS)
            border_count = load(jacobian, PARAMETERS * BACKGROUND + BACKGROUND)
            spot = (total * border_count - border * whole_count) / (
                whole_light * border_count - border_light * whole_count
            )
            flat = (border - spot * border_light) / border_count
            for a in range(PARAMETERS):
                at = PARAMETERS * a
                model = spot * load(jacobian, at + PHOTONS) + flat * load(jacobian, at + BACKGROUND)
                store(step, a, load(data, a) - model)
                store(jacobian, at + X, load(jacobian, at + X) * spot)
                store(jacobian, at + Y, load(jacobian, at + Y) * spot)
                store(jacobian, at + SIGMA, load(jacobian, at + SIGMA) * spot)
            hold(jacobian, step, SIGMA, held)
            hold(jacobian, step, X, given)
            hold(jacobian, step, Y, given)
            invert(jacobian)
            step_x = all_lanes(0.0)
            step_y = all_lanes(0.0)
            step_sigma = all_lanes(0.0)
            for a in range(PARAMETERS):
                rest = load(step, a)
                step_x += load(jacobian, PARAMETERS * X + a) * rest
                step_y += load(jacobian, PARAMETERS * Y + a) * rest
                step_sigma += load(jacobian, PARAMETERS * SIGMA + a) * rest
            move = abs(step_x) + abs(step_y)
            if iteration < ITERATIONS:
                x = larger(smaller(x + larger(smaller(step_x, 1.0), -1.0), reach), -reach)
                y = larger(smaller(y + larger(smaller(step_y, 1.0), -1.0), reach), -reach)
                # Newton's steps down are too long; the ratio shortens them.
                ratio = larger(smaller(step_sigma / sigma, 0.5), -1.0)
                grown = sigma * select(ratio > 0.0, 1.0 + ratio, 1.0 / (1.0 - ratio))
                sigma = select(held, sigma, larger(smaller(grown, upper), lower))
                if iteration == ITERATIONS - 2:
                    held = held | (sigma <= lower) | (sigma >= upper)
                    sigma = select(held, start_sigma, sigma)

        # The width's weights go when its equation was put aside.
        for a in (X, Y):
            by_core = load(jacobian, PARAMETERS * a + SIGMA)
            store(jacobian, PARAMETERS * a + SIGMA, select(held, 0.0, by_core))
        x_variance, y_variance, sum_residuals, sum_squares, pearson = residual_sums(
            light,
            noise,
            spot,
            flat,
            jacobian,
            weights_x,
            weights_y,
            bell,
            profiles_x,
            profiles_y,
        )
        mean = sum_residuals / kept
        store(outcome, 0, x)
        store(outcome, 1, y)
        store(outcome, 2, spot)
        store(outcome, 3, flat)
        store(outcome, 4, sigma)
        store(outcome, 5, sqrt(x_variance))
        store(outcome, 6, sqrt(y_variance))
        store(outcome, 7, sqrt(larger(sum_squares / kept - mean * mean, 0.0)))
        store(outcome, 8, pearson)
        store(outcome, 9, np.nan)
        empty = bits(kept <= PARAMETERS)
        settled = bits(move < _SETTLED_PX)
        is_given = bits(given)
        for lane in range(count):
            k = first + lane
            for c in range(10):
                if not (is_given >> lane & 1 and c in (0, 1, 5, 6)):
                    results[c, k] = outcome[c, lane]
            if empty >> lane & 1:
                results[:, k] = np.nan
                flags[k] |= _NOT_FINITE
                continue
            if not settled >> lane & 1:
                flags[k] |= _ITERATION_LIMIT
            if not (abs(results[0, k]) <= radius and abs(results[1, k]) <= radius):
                flags[k] |= _LEFT_WINDOW
            if not (results[2, k] > 0.0 and results[5, k] + results[6, k] < np.inf):
                flags[k] |= _SINGULAR
