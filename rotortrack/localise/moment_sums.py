"""Sums over the pixels of a window and of the model that its moments are matched to.

All functions treat LANES windows at once. Arrays hold one vector of lanes for every entry: the five
equations and the five parameters are ordered x, y, photons, background, sigma, and entry (a, b) of
the system is number 5 a + b.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.gaussian import BACKGROUND, PARAMETERS, PHOTONS, SIGMA, X, Y
from rotortrack.localise.likelihood import SMALLEST_EXPECTATION
from rotortrack.localise.vectors import all_lanes, larger, load, select, smaller, sqrt, store

_LIGHT, _BY_PLACE, _BY_SIGMA, _FLAT = range(4)
"""Fields of a profile: a unit Gaussian, its derivatives by position and by sigma, and ones."""

_SUM, _PLACE, _CORE, _ENDS = range(4)

_SQRT_HALF = math.sqrt(0.5)
_INVERSE_SQRT_2PI = 1.0 / math.sqrt(2.0 * math.pi)


@kernel
def axis_sums(
    position: Any,
    sigma: Any,
    weights: NDArray[np.float32],
    bell: NDArray[np.float32],
    profiles: NDArray[np.float32],
    sums: NDArray[np.float32],
) -> None:
    """Integrate unit Gaussians over the pixels of one axis, with derivatives and weighted sums.

    `profiles` receives (4, n) vectors, light, by position, by sigma and flat, `sums` (4, 4): of
    each profile its sum, the sums weighted by u and by h, and its two ends.
    """
    n = bell.shape[0]
    inverse = 1.0 / sigma
    below_erf = all_lanes(0.0)
    below_density = all_lanes(0.0)
    below_moment = all_lanes(0.0)
    for k in range(n + 1):
        scaled = (k - 0.5 * n - position) * inverse
        # exp(-scaled^2 / 2) as 16th power of a near-minimax polynomial, relative error 1e-6.
        t = smaller(0.5 * scaled * scaled, 16.0) * 0.0625
        e = 0.000849007873 * t - 0.007654325102
        e = e * t + 0.041223317672
        e = e * t - 0.166515167041
        e = e * t + 0.499975091240
        e = e * t - 0.999998453808
        e = e * t + 0.999999984244
        e = e * e
        e = e * e
        e = e * e
        e = e * e
        # Abramowitz and Stegun 7.1.26: erf from the exponential, absolute error 1.5e-7.
        s = 1.0 / (1.0 + 0.3275911 * _SQRT_HALF * abs(scaled))
        tail = 1.061405429 * s - 1.453152027
        tail = tail * s + 1.421413741
        tail = tail * s - 0.284496736
        tail = (tail * s + 0.254829592) * s * e
        erf = select(scaled < 0.0, tail - 1.0, 1.0 - tail)
        density = e * inverse * _INVERSE_SQRT_2PI
        moment = scaled * density
        if k > 0:
            store(profiles, _LIGHT * n + k - 1, 0.5 * (erf - below_erf))
            store(profiles, _BY_PLACE * n + k - 1, below_density - density)
            store(profiles, _BY_SIGMA * n + k - 1, below_moment - moment)
        below_erf = erf
        below_density = density
        below_moment = moment
    for field in range(_FLAT + 1):
        total = all_lanes(0.0)
        placed = all_lanes(0.0)
        core = all_lanes(0.0)
        for k in range(n):
            value = load(profiles, field * n + k)
            total += value
            placed += value * load(weights, k)
            core += value * bell[k]
        store(sums, 4 * field + _SUM, total)
        store(sums, 4 * field + _PLACE, placed)
        store(sums, 4 * field + _CORE, core)
        ends = load(profiles, field * n) + load(profiles, field * n + n - 1)
        store(sums, 4 * field + _ENDS, ends)


@kernel
def _product(
    along_x: NDArray[np.float32],
    field_x: int,
    along_y: NDArray[np.float32],
    field_y: int,
    equation: int,
) -> Any:
    """Give one of the five sums of the window that is the product of two profiles."""
    sum_x = load(along_x, 4 * field_x + _SUM)
    sum_y = load(along_y, 4 * field_y + _SUM)
    if equation == X:
        return load(along_x, 4 * field_x + _PLACE) * sum_y
    if equation == Y:
        return sum_x * load(along_y, 4 * field_y + _PLACE)
    if equation == PHOTONS:
        return sum_x * sum_y
    if equation == BACKGROUND:
        ends_x = load(along_x, 4 * field_x + _ENDS)
        return ends_x * sum_y + (sum_x - ends_x) * load(along_y, 4 * field_y + _ENDS)
    return load(along_x, 4 * field_x + _CORE) * load(along_y, 4 * field_y + _CORE)


@kernel
def model_sums(
    along_x: NDArray[np.float32], along_y: NDArray[np.float32], jacobian: NDArray[np.float32]
) -> None:
    """Fill (5, 5): row by row the sums of the model's derivatives, light for one photon."""
    for a in range(PARAMETERS):
        at = PARAMETERS * a
        store(jacobian, at + X, _product(along_x, _BY_PLACE, along_y, _LIGHT, a))
        store(jacobian, at + Y, _product(along_x, _LIGHT, along_y, _BY_PLACE, a))
        store(jacobian, at + PHOTONS, _product(along_x, _LIGHT, along_y, _LIGHT, a))
        store(jacobian, at + BACKGROUND, _product(along_x, _FLAT, along_y, _FLAT, a))
        wider_x = _product(along_x, _BY_SIGMA, along_y, _LIGHT, a)
        wider_y = _product(along_x, _LIGHT, along_y, _BY_SIGMA, a)
        store(jacobian, at + SIGMA, wider_x + wider_y)


@kernel
def leave_out(
    noise: NDArray[np.float32],
    holes: NDArray[np.int64],
    weights_x: NDArray[np.float32],
    weights_y: NDArray[np.float32],
    bell: NDArray[np.float32],
    profiles_x: NDArray[np.float32],
    profiles_y: NDArray[np.float32],
    jacobian: NDArray[np.float32],
) -> None:
    """Take masked pixels out of the model's sums; lanes without any stay as they are."""
    n = bell.shape[0]
    for p in holes:
        i = p // n
        j = p % n
        border = 1.0 if i == 0 or j == 0 or i == n - 1 or j == n - 1 else 0.0
        masked = select(load(noise, p) < np.inf, 0.0, 1.0)
        light_x = load(profiles_x, _LIGHT * n + j) * masked
        light_y = load(profiles_y, _LIGHT * n + i)
        by_x = load(profiles_x, _BY_PLACE * n + j) * masked * light_y
        by_y = light_x * load(profiles_y, _BY_PLACE * n + i)
        by_sigma = load(profiles_x, _BY_SIGMA * n + j) * masked * light_y
        by_sigma += light_x * load(profiles_y, _BY_SIGMA * n + i)
        for a in range(PARAMETERS):
            weight = all_lanes(1.0)
            if a == X:
                weight = load(weights_x, j)
            elif a == Y:
                weight = load(weights_y, i)
            elif a == BACKGROUND:
                weight = all_lanes(border)
            elif a == SIGMA:
                weight = all_lanes(bell[i] * bell[j])
            at = PARAMETERS * a
            store(jacobian, at + X, load(jacobian, at + X) - weight * by_x)
            store(jacobian, at + Y, load(jacobian, at + Y) - weight * by_y)
            lit = load(jacobian, at + PHOTONS) - weight * light_x * light_y
            store(jacobian, at + PHOTONS, lit)
            store(jacobian, at + BACKGROUND, load(jacobian, at + BACKGROUND) - weight * masked)
            store(jacobian, at + SIGMA, load(jacobian, at + SIGMA) - weight * by_sigma)


@kernel
def hold(jacobian: NDArray[np.float32], step: NDArray[np.float32], a: int, where: Any) -> None:
    """Put the equation of a parameter aside: the parameter stays where it is."""
    for b in range(PARAMETERS):
        entry = load(jacobian, PARAMETERS * a + b)
        store(jacobian, PARAMETERS * a + b, select(where, 1.0 if a == b else 0.0, entry))
    store(step, a, select(where, 0.0, load(step, a)))


@kernel
def invert(matrix: NDArray[np.float32]) -> None:
    """Invert (5, 5) in place by Gauss-Jordan; every equation leads in its own unknown."""
    for a in range(PARAMETERS):
        pivot = 1.0 / load(matrix, PARAMETERS * a + a)
        store(matrix, PARAMETERS * a + a, 1.0)
        for c in range(PARAMETERS):
            store(matrix, PARAMETERS * a + c, load(matrix, PARAMETERS * a + c) * pivot)
        for b in range(PARAMETERS):
            if b != a:
                factor = load(matrix, PARAMETERS * b + a)
                store(matrix, PARAMETERS * b + a, 0.0)
                for c in range(PARAMETERS):
                    row = load(matrix, PARAMETERS * a + c)
                    entry = load(matrix, PARAMETERS * b + c) - factor * row
                    store(matrix, PARAMETERS * b + c, entry)


@kernel
def phase_weights(
    sums: NDArray[np.float32],
    whole: Any,
    waves: NDArray[np.float32],
    weights: NDArray[np.float32],
) -> None:
    """Fill the n weights sin(2 pi k / n - phase) of one axis.

    `sums` are those of the data along the other axis, `waves` (2, n) cosine and sine. Lanes that
    are not `whole` get the phase 0, for a window with holes has no phase of its own.
    """
    n = waves.shape[1]
    real = all_lanes(0.0)
    imaginary = all_lanes(0.0)
    for k in range(n):
        real += waves[0, k] * load(sums, k)
        imaginary += waves[1, k] * load(sums, k)
    scale = 1.0 / sqrt(real * real + imaginary * imaginary)
    cosine = select(whole, real * scale, 1.0)
    sine = select(whole, imaginary * scale, 0.0)
    for k in range(n):
        store(weights, k, waves[1, k] * cosine - waves[0, k] * sine)


@kernel
def residual_sums(
    light: NDArray[np.float32],
    noise: NDArray[np.float32],
    spot: Any,
    flat: Any,
    inverse: NDArray[np.float32],
    weights_x: NDArray[np.float32],
    weights_y: NDArray[np.float32],
    bell: NDArray[np.float32],
    profiles_x: NDArray[np.float32],
    profiles_y: NDArray[np.float32],
) -> Any:
    """Compare pixels with the model, and carry their noise to x and y by the inverse system.

    Returns
    -------
    tuple
        Variances of x and y, the residuals' sum, their squares' sum, and Pearson's chi-square.
    """
    n = bell.shape[0]
    x_variance = all_lanes(0.0)
    y_variance = all_lanes(0.0)
    sum_residuals = all_lanes(0.0)
    sum_squares = all_lanes(0.0)
    pearson = all_lanes(0.0)
    for i in range(n):
        for j in range(n):
            read = load(noise, i * n + j)
            counts = read < np.inf
            lit = load(profiles_x, _LIGHT * n + j) * load(profiles_y, _LIGHT * n + i)
            model = flat + spot * lit
            expected = larger(model + select(counts, read, 0.0), SMALLEST_EXPECTATION)
            residual = select(counts, load(light, i * n + j) - model, 0.0)
            ux = load(weights_x, j)
            uy = load(weights_y, i)
            core = bell[i] * bell[j]
            by_x = load(inverse, PARAMETERS * X + X) * ux
            by_x += load(inverse, PARAMETERS * X + Y) * uy
            by_x += load(inverse, PARAMETERS * X + PHOTONS)
            by_x += load(inverse, PARAMETERS * X + SIGMA) * core
            by_y = load(inverse, PARAMETERS * Y + X) * ux
            by_y += load(inverse, PARAMETERS * Y + Y) * uy
            by_y += load(inverse, PARAMETERS * Y + PHOTONS)
            by_y += load(inverse, PARAMETERS * Y + SIGMA) * core
            if i == 0 or j == 0 or i == n - 1 or j == n - 1:
                by_x += load(inverse, PARAMETERS * X + BACKGROUND)
                by_y += load(inverse, PARAMETERS * Y + BACKGROUND)
            spread = select(counts, expected, 0.0)
            x_variance += spread * by_x * by_x
            y_variance += spread * by_y * by_y
            sum_residuals += residual
            sum_squares += residual * residual
            pearson += residual * residual / expected
    return x_variance, y_variance, sum_residuals, sum_squares, pearson
