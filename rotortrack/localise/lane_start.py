"""What lane fits begin with: data and weights of a batch, and parameters from a template."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.fit import METHODS
from rotortrack.localise.lane_math import SMALLEST_EXPECTATION, Scratch
from rotortrack.localise.least_squares import SMALLEST_VALUE_OF_LARGEST
from rotortrack.localise.vectors import (
    LANES,
    Vector,
    all_lanes,
    bits,
    larger,
    load,
    select,
    smaller,
    store,
)

WLSQ: Final = METHODS["wlsq"]
MLE: Final = METHODS["mle"]


@kernel
def prepare(
    raw: Scratch, spread: Scratch, pixels: int, method: int, data: Scratch, noise: Scratch
) -> Vector:
    """Fill data and noise such that weights are 1 / (share mu + noise); count usable pixels."""
    count = all_lanes(0.0)
    if method == MLE:
        for p in range(pixels):
            v = load(spread, p)
            count += select(v < np.inf, 1.0, 0.0)
            store(data, p, larger(load(raw, p), -v))
            store(noise, p, larger(v, SMALLEST_EXPECTATION))
        return count
    largest = all_lanes(0.0)
    level = all_lanes(0.0)
    for p in range(pixels):
        v = load(spread, p)
        d = load(raw, p)
        good = v < np.inf
        count += select(good, 1.0, 0.0)
        largest = larger(select(good, d, 0.0), largest)
        level += select(good, larger(d, 0.0) + v, 0.0)
        store(data, p, d)
    floor = largest * SMALLEST_VALUE_OF_LARGEST
    # A constant does not move the optimum; this one makes steps count in standard deviations.
    level = larger(level / count, 1e-3)
    for p in range(pixels):
        good = load(spread, p) < np.inf
        own = select(floor > 0.0, larger(load(raw, p), floor), np.inf)
        store(noise, p, select(good, own if method == WLSQ else level, np.inf))
    return count


@kernel
def start_from_template(
    raw: Scratch,
    spread: Scratch,
    pixels: int,
    count: Vector,
    filters: NDArray[np.float32],
    curves: NDArray[np.float32],
    least_ratio: float,
    largest_ratio: float,
    state: Scratch,
) -> None:
    """Apply the template; a pixel that does not count is taken from opposite the middle."""
    zero = all_lanes(0.0)
    t_x = t_y = t_n = t_b = t_s = zero
    whole = bits(count == float(pixels)) == (1 << LANES) - 1
    mean = zero
    if not whole:
        for p in range(pixels):
            mean += load(raw, p)
        mean = mean / count
    for p in range(pixels):
        d = load(raw, p)
        if not whole:
            opposite = pixels - 1 - p
            other = select(load(spread, opposite) < np.inf, load(raw, opposite), mean)
            d = select(load(spread, p) < np.inf, d, other)
        t_x += d * filters[0, p]
        t_y += d * filters[1, p]
        t_n += d * filters[2, p]
        t_b += d * filters[3, p]
        t_s += d * filters[4, p]
    t_n = larger(t_n, 1.0)
    ratio = smaller(larger(t_s / t_n, least_ratio), largest_ratio)
    z = ratio / (abs(ratio) + 1.0)
    sigma = per_photon = per_shift = lift = zero
    for k in range(curves.shape[1]):
        power = curves.shape[1] - 1 - k
        sigma = sigma * z + curves[0, power]
        per_photon = per_photon * z + curves[1, power]
        per_shift = per_shift * z + curves[2, power]
        lift = lift * z + curves[3, power]
    light = larger(t_n * per_photon, 1.0)
    store(state, 0, smaller(larger(t_x * per_shift / light, -1.0), 1.0))
    store(state, 1, smaller(larger(t_y * per_shift / light, -1.0), 1.0))
    store(state, 2, light)
    store(state, 3, larger(t_b - lift * t_n, 0.0))
    store(state, 4, sigma)
