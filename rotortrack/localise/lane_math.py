"""The model and its sums for sixteen windows at once: what :mod:`gaussian` is for one.

Parameters stand in the order x, y, photons N, background b, sigma. Derivatives by x, y and sigma
are taken per photon, so matrices and gradients belong to (N x, N y, N, b, N sigma), whose rows
have nearly the same size. Sums over the window are separable: a row is summed with the functions
of x, and the row's sums are weighted with those of y.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.vectors import (
    LANES,
    Vector,
    all_lanes,
    exp2_parts,
    larger,
    load,
    log2_parts,
    select,
    smaller,
    store,
)

Scratch = NDArray[np.float32]

ENTRIES: Final = 15
"""Lower triangle of a symmetric 5 x 5 matrix, row by row: entry (a, b) is a (a + 1) / 2 + b."""

PROFILE_ROWS: Final = 11
"""Rows of a profile: g, its derivatives by x, sigma, x sigma and sigma sigma (called d, s, ds and
ss below), then the products gg, gd, dd, gs, d*s, s*s."""

FIXED: Final = 1e30
"""Added to its diagonal element, it keeps a parameter where it is."""

LEAST_PIVOT: Final = 1e-4
"""A pivot smaller than this part of its diagonal leaves too little of float32: not by lanes."""

SMALLEST_EXPECTATION: Final = 1e-6
"""Expected variance of a pixel is kept above this (electrons^2)."""

_LOG2_E = 1.0 / math.log(2.0)
_LN_2 = math.log(2.0)
_INVERSE_SQRT_2PI = 1.0 / math.sqrt(2.0 * math.pi)


@kernel
def exp_minus(x: Vector) -> Vector:
    """Compute exp(-x) for x >= 0, to 1e-7 of itself; below 1e-38 it stays there."""
    power, rest = exp2_parts(larger(x * -_LOG2_E, -126.0))
    value = rest * 0.0013276457 + 0.009675541
    value = value * rest + 0.055507135
    value = value * rest + 0.2402212
    value = value * rest + 0.69314694
    return power * (value * rest + 1.0)


@kernel
def profile(position: Vector, inverse: Vector, size: int, along: Scratch) -> None:
    """Integrate a unit Gaussian over the pixels of one axis, with its derivatives.

    One exponential an edge gives both the density and the error function, the latter to 1.5e-7
    (Abramowitz and Stegun 7.1.26).

    Parameters
    ----------
    position, inverse
        Centre (pixels from the middle pixel's centre) and 1 / sigma.
    size
        Pixels of the axis.
    along
        Rows of `size` vectors; the first five of PROFILE_ROWS are filled.
    """
    edge = -0.5 * size - position
    scale = inverse * _INVERSE_SQRT_2PI
    below = slope_below = width_below = mixed_below = bend_below = all_lanes(0.0)
    for k in range(size + 1):
        u = edge * inverse
        square = u * u
        bell = exp_minus(square * 0.5)
        t = 1.0 / (abs(u) * (0.3275911 * math.sqrt(0.5)) + 1.0)
        tail = t * 0.5307027145 - 0.7265760135
        tail = tail * t + 0.7107068705
        tail = tail * t - 0.142248368
        tail = (tail * t + 0.127414796) * t * bell
        above = select(u < 0.0, tail - 0.5, 0.5 - tail)
        slope = bell * scale
        width = u * slope
        mixed = (slope - u * width) * inverse
        bend = (2.0 - square) * width * inverse
        if k > 0:
            store(along, k - 1, above - below)
            store(along, size + k - 1, slope_below - slope)
            store(along, 2 * size + k - 1, width_below - width)
            store(along, 3 * size + k - 1, mixed - mixed_below)
            store(along, 4 * size + k - 1, bend - bend_below)
        below = above
        slope_below = slope
        width_below = width
        mixed_below = mixed
        bend_below = bend
        edge = edge + 1.0


@kernel
def products(along: Scratch, size: int) -> None:
    """Fill the last six of PROFILE_ROWS from the first three."""
    for k in range(size):
        g = load(along, k)
        d = load(along, size + k)
        s = load(along, 2 * size + k)
        store(along, 5 * size + k, g * g)
        store(along, 6 * size + k, g * d)
        store(along, 7 * size + k, d * d)
        store(along, 8 * size + k, g * s)
        store(along, 9 * size + k, d * s)
        store(along, 10 * size + k, s * s)


@kernel
def score(
    data: Scratch,
    noise: Scratch,
    share: float,
    newton: Vector,
    size: int,
    photons: Vector,
    background: Vector,
    inverse: Vector,
    along_x: Scratch,
    along_y: Scratch,
    weights: Scratch,
    system: Scratch,
) -> None:
    """Sum the gradient, and what the residuals add to the curvature.

    With weights w = 1 / (share mu + noise) and residuals r = d - mu the gradient is sum w r J and
    the full Newton matrix sum q J J^T - sum w r H with q = w (1 + share w r): for share 1 that of
    the likelihood, for share 0 that of the squares. Fisher scoring takes q = w and no H.

    Parameters
    ----------
    data, noise
        One vector a pixel; infinite noise makes a pixel weightless.
    share
        1 for the likelihood, 0 for squares.
    newton
        1 for Newton's matrix, 0 for Fisher's, lane by lane.
    size, photons, background, inverse
        Pixels of an axis, and the parameters with 1 / sigma.
    along_x, along_y
        Profiles.
    weights
        Receives q of every pixel, for :func:`information`.
    system
        ENTRIES + 5 vectors; receives - sum w r H and the gradient.
    """
    zero = all_lanes(0.0)
    xx = xy = yy = xs = ys = ss = zero
    by_x = by_y = by_n = by_b = by_s = zero
    extra = newton * share
    for i in range(size):
        g = load(along_y, i)
        d = load(along_y, size + i)
        s = load(along_y, 2 * size + i)
        light = photons * g
        r_1 = r_g = r_d = r_s = r_ds = r_ss = zero
        for j in range(size):
            pixel = i * size + j
            gx = load(along_x, j)
            expected = light * gx + background
            w = 1.0 / (expected * share + load(noise, pixel))
            r = w * (load(data, pixel) - expected)
            store(weights, pixel, w + (extra * w) * r)
            r_1 += r
            r_g += r * gx
            r_d += r * load(along_x, size + j)
            r_s += r * load(along_x, 2 * size + j)
            r_ds += r * load(along_x, 3 * size + j)
            r_ss += r * load(along_x, 4 * size + j)
        by_x += r_d * g
        by_y += r_g * d
        by_n += r_g * g
        by_b += r_1
        # The Gaussian obeys the heat equation: its second derivative by x is s / sigma.
        xx += r_s * g
        yy += r_g * s
        xy += r_d * d
        xs += r_ds * g + r_d * s
        ys += r_g * load(along_y, 3 * size + i) + r_s * d
        ss += r_ss * g + 2.0 * r_s * s + r_g * load(along_y, 4 * size + i)
    by_s = xx + yy
    part = -newton / photons
    store(system, 0, part * inverse * xx)
    store(system, 1, part * xy)
    store(system, 2, part * inverse * yy)
    store(system, 3, part * by_x)
    store(system, 4, part * by_y)
    for entry in range(5, 10):
        store(system, entry, 0.0)
    store(system, 10, part * xs)
    store(system, 11, part * ys)
    store(system, 12, part * by_s)
    store(system, 13, 0.0)
    store(system, 14, part * ss)
    store(system, ENTRIES, by_x)
    store(system, ENTRIES + 1, by_y)
    store(system, ENTRIES + 2, by_n)
    store(system, ENTRIES + 3, by_b)
    store(system, ENTRIES + 4, by_s)


@kernel
def information(
    weights: Scratch, size: int, along_x: Scratch, along_y: Scratch, system: Scratch
) -> None:
    """Add sum w J J^T of all pixels to the first ENTRIES vectors of a system."""
    zero = all_lanes(0.0)
    xx = yx = yy = nx = ny = nn = bx = by = bn = bb = sx = sy = sn = sb = ss = zero
    for i in range(size):
        g = load(along_y, i)
        d = load(along_y, size + i)
        s = load(along_y, 2 * size + i)
        gg = load(along_y, 5 * size + i)
        gd = load(along_y, 6 * size + i)
        gs = load(along_y, 8 * size + i)
        w_1 = w_g = w_d = w_s = w_gg = w_gd = w_dd = w_gs = w_ds = w_ss = zero
        for j in range(size):
            w = load(weights, i * size + j)
            w_1 += w
            w_g += w * load(along_x, j)
            w_d += w * load(along_x, size + j)
            w_s += w * load(along_x, 2 * size + j)
            w_gg += w * load(along_x, 5 * size + j)
            w_gd += w * load(along_x, 6 * size + j)
            w_dd += w * load(along_x, 7 * size + j)
            w_gs += w * load(along_x, 8 * size + j)
            w_ds += w * load(along_x, 9 * size + j)
            w_ss += w * load(along_x, 10 * size + j)
        xx += w_dd * gg
        yx += w_gd * gd
        yy += w_gg * load(along_y, 7 * size + i)
        nx += w_gd * gg
        ny += w_gg * gd
        nn += w_gg * gg
        bx += w_d * g
        by += w_g * d
        bn += w_g * g
        bb += w_1
        sx += w_ds * gg + w_gd * gs
        sy += w_gs * gd + w_gg * load(along_y, 9 * size + i)
        sn += w_gs * gg + w_gg * gs
        sb += w_s * g + w_g * s
        ss += w_ss * gg + 2.0 * w_gs * gs + w_gg * load(along_y, 10 * size + i)
    for entry, total in enumerate((xx, yx, yy, nx, ny, nn, bx, by, bn, bb, sx, sy, sn, sb, ss)):
        store(system, entry, load(system, entry) + total)


@kernel
def project(
    values: Scratch, size: int, along_x: Scratch, along_y: Scratch, result: Scratch
) -> None:
    """Sum values J over all pixels into 5 vectors."""
    zero = all_lanes(0.0)
    by_x = by_y = by_n = by_b = by_s = zero
    for i in range(size):
        g = load(along_y, i)
        v_1 = v_g = v_d = v_s = zero
        for j in range(size):
            value = load(values, i * size + j)
            v_1 += value
            v_g += value * load(along_x, j)
            v_d += value * load(along_x, size + j)
            v_s += value * load(along_x, 2 * size + j)
        by_x += v_d * g
        by_y += v_g * load(along_y, size + i)
        by_n += v_g * g
        by_b += v_1
        by_s += v_s * g + v_g * load(along_y, 2 * size + i)
    store(result, 0, by_x)
    store(result, 1, by_y)
    store(result, 2, by_n)
    store(result, 3, by_b)
    store(result, 4, by_s)


@kernel
def factor(matrix: Scratch) -> Vector:
    """Replace a matrix by its factors L D L^T, with 1 / D on the diagonal.

    Returns
    -------
    Vector
        The smallest pivot over its diagonal: 0 or less when not positive definite.
    """
    worst = all_lanes(1.0)
    for a in range(5):
        row = a * (a + 1) // 2
        diagonal = load(matrix, row + a)
        pivot = diagonal
        for b in range(a):
            other = b * (b + 1) // 2
            total = load(matrix, row + b)
            for c in range(b):
                total -= load(matrix, row + c) * load(matrix, other + c)
            store(matrix, row + b, total)
        for b in range(a):
            total = load(matrix, row + b)
            scaled = total * load(matrix, b * (b + 1) // 2 + b)
            pivot -= total * scaled
            store(matrix, row + b, scaled)
        worst = smaller(pivot / diagonal, worst)
        store(matrix, row + a, 1.0 / pivot)
    return worst


@kernel
def solve(factors: Scratch, right: Scratch) -> None:
    """Solve for 5 vectors in place."""
    for a in range(5):
        total = load(right, a)
        for b in range(a):
            total -= load(factors, a * (a + 1) // 2 + b) * load(right, b)
        store(right, a, total)
    for k in range(5):
        a = 4 - k
        total = load(right, a) * load(factors, a * (a + 1) // 2 + a)
        for b in range(a + 1, 5):
            total -= load(factors, b * (b + 1) // 2 + a) * load(right, b)
        store(right, a, total)


@kernel
def invert(factors: Scratch, inverse: Scratch) -> None:
    """Fill 25 vectors with the inverse of a factored matrix, row by row."""
    for a in range(5):
        column = inverse[a * 5 * LANES : (a + 1) * 5 * LANES]
        for b in range(5):
            store(column, b, 1.0 if a == b else 0.0)
        solve(factors, column)


@kernel
def deviance(excess: Vector, squared: Vector, expected: Vector) -> Vector:
    """Compute 2 [m - k + k ln(k / m)] of a pixel without cancellation.

    Parameters
    ----------
    excess
        u = k / m - 1, -1 or more.
    squared
        m u^2.
    expected
        m; where it is infinite and u is 0, the result is 0.
    """
    ratio = larger(excess + 1.0, 1e-30)
    exponent, mantissa = log2_parts(ratio)
    near = exponent == 0.0
    f = select(near, excess, mantissa - 1.0)
    # What ln(1 + f) has beyond f, over the square of f.
    rest = f * 0.08722295 - 0.14366814
    rest = rest * f + 0.14952275
    rest = rest * f - 0.16562398
    rest = rest * f + 0.19956833
    rest = rest * f - 0.25002074
    rest = rest * f + 0.33334187
    rest = rest * f - 0.49999988
    logarithm = exponent * _LN_2 + (f + f * f * rest)
    far = expected * (ratio * logarithm - excess)
    return 2.0 * select(near, squared * (1.0 + rest + f * rest), far)
