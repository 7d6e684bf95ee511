"""Filter and smoother of an angle on a grid of the circle, compiled.

The density of the angle at the ends of a frame's interval is kept at M angles a cell h apart. A
frame in which the rotor was seen takes it from a to b = a + d h by

    p'(b) = sum_d  w(d) g(a + d h / 2) p(a),

where w is the normal density of a turn and g the density of the reading about the exposure
average, which lies midway between a and b (`readings.Timing`); hence g at half cells: `whole` at
the angles, `half` half a cell further. Turns of more than half a circle keep their own midway.
Sums of smooth functions over a full circle converge exponentially.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

UNIFORM_SHARE = 1e-4
"""Share of readings that are taken to come from anywhere, so that a false spot does no harm."""

_NEGLIGIBLE = -24.0
_BLOCK = 1024


@kernel
def _reading(
    theta: float,
    concentration: float,
    norm: float,
    cosine: Floats,
    sine: Floats,
    whole: Floats,
    half: Floats,
) -> None:
    """Density of a reading at all angles of the grid, repeated beyond both ends.

    exp(x) is the 32nd power of its series at x / 32, good to 1e-8 and, other than the library's,
    computed for several angles at once.
    """
    size = whole.size // 3
    along, across = concentration * np.cos(theta), concentration * np.sin(theta)
    uniform = UNIFORM_SHARE / (2.0 * np.pi)
    for part in range(2):
        values = whole if part == 0 else half
        for j in range(size):
            exponent = along * cosine[part, j] + across * sine[part, j] - concentration
            x = max(exponent, _NEGLIGIBLE) / 32.0
            power = 1.0 + x / 9.0 * (1.0 + x / 10.0)
            power = 1.0 + x / 7.0 * (1.0 + x / 8.0 * power)
            power = 1.0 + x / 5.0 * (1.0 + x / 6.0 * power)
            power = 1.0 + x / 3.0 * (1.0 + x / 4.0 * power)
            power = 1.0 + x * (1.0 + x / 2.0 * power)
            power *= power
            power *= power
            power *= power
            power *= power
            values[size + j] = uniform + norm * power * power
    _repeat(whole)
    _repeat(half)


@kernel
def _circle(size: int) -> tuple[Floats, Floats]:
    """Cosine and sine of the angles of the grid and, in a second row, half a cell further."""
    cosine, sine = np.empty((2, size)), np.empty((2, size))
    for part in range(2):
        for j in range(size):
            angle = 2.0 * np.pi / size * (j + 0.5 * part)
            cosine[part, j], sine[part, j] = np.cos(angle), np.sin(angle)
    return cosine, sine


@kernel
def _repeat(values: Floats) -> None:
    size = values.size // 3
    for j in range(size):
        values[j] = values[size + j]
        values[2 * size + j] = values[size + j]


@kernel
def _seen_step(before: Floats, after: Floats, turns: Floats, whole: Floats, half: Floats) -> None:
    """Write the densities after a frame with a reading; `before` is repeated beyond both ends.

    `turns` holds a multiple of four weights, from an even number of cells backwards on.
    """
    size = after.size
    first = -(turns.size // 4) * 2
    after[:] = 0.0
    for i in range(0, turns.size, 4):
        w0, w1, w2, w3 = turns[i], turns[i + 1], turns[i + 2], turns[i + 3]
        # Views, since an index that might be negative is not computed several at once.
        source = size - first - i
        p0, p1 = before[source : source + size], before[source - 1 : source - 1 + size]
        p2, p3 = before[source - 2 : source - 2 + size], before[source - 3 : source - 3 + size]
        middle = size - (first + i) // 2
        g0, g1 = whole[middle : middle + size], half[middle - 1 : middle - 1 + size]
        g2, g3 = whole[middle - 1 : middle - 1 + size], half[middle - 2 : middle - 2 + size]
        for b in range(size):
            after[b] += (
                w0 * p0[b] * g0[b] + w1 * p1[b] * g1[b] + w2 * p2[b] * g2[b] + w3 * p3[b] * g3[b]
            )


@kernel
def _blind_step(before: Floats, after: Floats, turns: Floats, reach: int) -> None:
    """Write the densities after frames without a reading."""
    size = after.size
    after[:] = 0.0
    centre = turns.size // 2
    for d in range(-reach, reach + 1):
        weight = turns[d + centre]
        earlier = before[size - d : 2 * size - d]
        for b in range(size):
            after[b] += weight * earlier[b]


@kernel
def _normalise(after: Floats, into: Floats) -> float:
    """Copy a density scaled to a sum of one, repeated beyond both ends; return the sum."""
    size = after.size
    total, second, third, fourth = 0.0, 0.0, 0.0, 0.0
    for b in range(0, size, 4):
        total += after[b]
        second += after[b + 1]
        third += after[b + 2]
        fourth += after[b + 3]
    total += second + third + fourth
    scale = 1.0 / total
    for b in range(size):
        into[size + b] = after[b] * scale
    _repeat(into)
    return total


@kernel
def filter_densities(
    theta: Floats,
    missed: Integers,
    concentration: Floats,
    norm: Floats,
    turns: Floats,
    gap_turns: Floats,
    gap_reach: Integers,
    size: int,
) -> tuple[Floats, Floats]:
    """Log density of each reading given those before it, and where the rotor was before it.

    Parameters
    ----------
    theta, missed, concentration, norm
        Reading, frames without one since the last, sharpness and its norm, a row a reading.
    turns
        Weights of turns by cells in one frame, a multiple of four, as many forth as back.
    gap_turns, gap_reach
        Weights of turns in 1, 2, ... frames on the circle, -size/2..size/2, and how far they reach.
    size
        Angles of the grid, a multiple of four.

    Returns
    -------
    ndarray, shape (n,)
        Log densities.
    ndarray, shape (4, n)
        Mean of cos, sin, cos of twice and sin of twice the angle at the start of the interval.
    """
    before = np.full(3 * size, 1.0 / size)
    after = np.empty(size)
    whole, half = np.empty(3 * size), np.empty(3 * size)
    cosine, sine = _circle(size)
    found = np.empty(theta.size)
    moments = np.zeros((4, theta.size))
    for k in range(theta.size):
        left = missed[k]
        while left > 0:
            now = min(left, gap_reach.size)
            left -= now
            _blind_step(before, after, gap_turns[now - 1], gap_reach[now - 1])
            _normalise(after, before)
        for a in range(size):
            p, c, s = before[size + a], cosine[0, a], sine[0, a]
            moments[0, k] += p * c
            moments[1, k] += p * s
            moments[2, k] += p * (c * c - s * s)
            moments[3, k] += p * 2.0 * c * s
        _reading(theta[k], concentration[k], norm[k], cosine, sine, whole, half)
        _seen_step(before, after, turns, whole, half)
        found[k] = np.log(_normalise(after, before))
    return found, moments


@kernel
def _midway(before: Floats, later: Floats, turns: Floats, whole: Floats, half: Floats) -> None:
    """Write the weight of each exposure average's middle, at the angles and half a cell further."""
    size = whole.size // 3
    first = -(turns.size // 4) * 2
    whole[:size] = 0.0
    half[:size] = 0.0
    for i in range(0, turns.size, 2):
        w0, w1 = turns[i], turns[i + 1]
        e = (first + i) // 2
        start = before[size - e : 2 * size - e]
        end, next_end = later[size + e : 2 * size + e], later[size + e + 1 : 2 * size + e + 1]
        for j in range(size):
            whole[j] += w0 * start[j] * end[j]
            half[j] += w1 * start[j] * next_end[j]


@kernel
def _readings_of(
    k: int,
    theta: Floats,
    seen: NDArray[np.bool_],
    concentration: Floats,
    norm: Floats,
    cosine: Floats,
    sine: Floats,
    whole: Floats,
    half: Floats,
) -> None:
    """Write the density of a frame's reading, ones where it has none."""
    if seen[k]:
        _reading(theta[k], concentration[k], norm[k], cosine, sine, whole, half)
    else:
        whole[:] = 1.0
        half[:] = 1.0


@kernel
def smooth_moments(
    theta: Floats,
    seen: NDArray[np.bool_],
    concentration: Floats,
    norm: Floats,
    gain: Floats,
    turns: Floats,
    size: int,
) -> Floats:
    """First and second circular moment of every frame's exposure average, given all readings.

    Parameters
    ----------
    theta, seen, concentration, norm
        As for `filter_densities`, but a row a frame; where `seen` is false they do not count.
    gain
        Part of the way from the middle of both ends to the reading at which the average lies.
    turns, size
        As for `filter_densities`.

    Returns
    -------
    ndarray, shape (4, frames)
        Mean of cos, sin, cos of twice and sin of twice the middle, pulled to the reading.
    """
    frames = theta.size
    cosine, sine = _circle(size)
    whole, half = np.ones(3 * size), np.ones(3 * size)
    density = np.full(3 * size, 1.0 / size)
    after = np.empty(size)
    # Densities of all frames would fill the memory of a long movie: those of a block are kept, and
    # of each block the first, from which the others are made again.
    blocks = -(-frames // _BLOCK)
    begun = np.empty((blocks, size))
    kept = np.empty((min(_BLOCK, frames), size))
    later = np.full(3 * size, 1.0 / size)
    middle, between = np.empty(3 * size), np.empty(3 * size)
    moments = np.zeros((4, frames))
    for k in range(frames):
        if k % _BLOCK == 0:
            begun[k // _BLOCK] = density[size : 2 * size]
        _readings_of(k, theta, seen, concentration, norm, cosine, sine, whole, half)
        _seen_step(density, after, turns, whole, half)
        _normalise(after, density)
    for k in range(frames - 1, -1, -1):
        if k == frames - 1 or k % _BLOCK == _BLOCK - 1:
            first = k // _BLOCK * _BLOCK
            density[size : 2 * size] = begun[k // _BLOCK]
            _repeat(density)
            for earlier in range(first, k + 1):
                kept[earlier - first] = density[size : 2 * size]
                _readings_of(earlier, theta, seen, concentration, norm, cosine, sine, whole, half)
                _seen_step(density, after, turns, whole, half)
                _normalise(after, density)
        density[size : 2 * size] = kept[k % _BLOCK]
        _repeat(density)
        _readings_of(k, theta, seen, concentration, norm, cosine, sine, whole, half)
        _midway(density, later, turns, middle, between)
        # Past and future may hardly overlap, so a weight is small beside the largest alone.
        largest = 0.0
        for j in range(size):
            largest = max(largest, middle[j] * whole[size + j], between[j] * half[size + j])
        total = 0.0
        for part in range(2):
            weights, readings = (middle, whole) if part == 0 else (between, half)
            for j in range(size):
                weight = weights[j] * readings[size + j]
                total += weight
                if weight < 1e-14 * largest:
                    continue
                angle = 2.0 * np.pi / size * (j + 0.5 * part)
                off = theta[k] - angle
                off -= 2.0 * np.pi * np.round(off / (2.0 * np.pi))
                angle += gain[k] * off
                c, s = np.cos(angle), np.sin(angle)
                moments[0, k] += weight * c
                moments[1, k] += weight * s
                moments[2, k] += weight * (c * c - s * s)
                moments[3, k] += weight * 2.0 * c * s
        for i in range(4):
            moments[i, k] /= total
        _seen_step(later, after, turns, whole, half)
        _normalise(after, later)
    return moments
