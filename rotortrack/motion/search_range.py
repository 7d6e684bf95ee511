"""How far to look for a particle in the next frame, told by the spots themselves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_CHANCE = 0.5
"""Strange spots within the search range, on average, above which it is cut."""

_FRAME_PAIRS = 2000
_LEAST_DISTANCES = 20
_SCALES = 24
_BINS = 300
_ROUNDS = 300
_RARE = 0.01
_LOST = 3e-4
_LOST_AFTER_GAP = 1e-2


@dataclass(frozen=True)
class SearchRange:
    """A search range and what it rests on.

    Attributes
    ----------
    range_nm
        The range.
    step_sd_nm
        Root-mean-square step of a particle per axis from one frame to the next, noise included.
    spots_per_um2
        Density of strange spots around a particle.
    false_share
        Chance that a strange spot lies nearer than the particle itself.
    cut
        Whether a range that holds all steps would hold too many strange spots.
    """

    range_nm: float
    step_sd_nm: float
    spots_per_um2: float
    false_share: float
    cut: bool


def choose_search_range(
    frame: Integers, x_nm: Floats, y_nm: Floats, *, memory_frames: int
) -> SearchRange | None:
    """Choose the search range that loses 3 in 10 000 steps, and 1 in 100 after the longest gap.

    The distance to the nearest spot of the next frame is that of the particle itself, which is
    Rayleigh distributed, or of a strange spot that lies nearer or remains when the particle is
    gone. With a density n of strange spots and steps of scale s it has the density

        (r / s^2 + 2 pi n r) exp(-r^2 / 2 s^2 - pi n r^2),

    and particles of many scales a mixture of these, whose weights are found by expectation
    maximisation; s -> infinity is the particle that is gone. n comes from the nearest
    spots within frames. Scales that hold less than 1 % of the steps are taken for chance.

    Parameters
    ----------
    frame, x_nm, y_nm
        Spots in any order, shape (n,), finite.
    memory_frames
        Frames that a particle may be missing.

    Returns
    -------
    SearchRange or None
        None with fewer than 20 distances between spots of adjacent frames.

    Notes
    -----
    Looks at 2000 pairs of frames at most, spread over the movie: below 0.5 s.
    """
    onwards, within = _distances(frame, np.stack([x_nm, y_nm], axis=1))
    if onwards.size < _LEAST_DISTANCES:
        return None
    area = float(np.ptp(x_nm) * np.ptp(y_nm))
    density = 1.0 / area if area > 0.0 else 0.0
    # Spots that lie on each other are one spot twice.
    within = within[within > 0.0]
    if within.size >= _LEAST_DISTANCES:
        density = max(density, math.log(2.0) / (math.pi * float(np.median(within)) ** 2))
    smallest = float(np.quantile(onwards, 0.05)) / 3.0
    smallest = max(smallest, 1e-9 * float(onwards.max()), 1e-6)
    largest = float(onwards.max())
    if density > 0.0:
        largest = min(largest, 0.5 / math.sqrt(2.0 * math.pi * density))
    scales = np.geomspace(smallest, max(largest, 1.1 * smallest), _SCALES)
    weights = _weights(onwards, scales, density)
    total = float(weights.sum())
    if not total > 0.0:
        return None
    weights = np.where(np.cumsum(weights[::-1])[::-1] > _RARE * total, weights, 0.0)
    weights /= weights.sum()

    def lost(radius: float) -> float:
        return float(weights @ np.exp(-0.5 * (radius / scales) ** 2))

    gap = math.sqrt(memory_frames + 1.0)
    wanted = max(
        _radius(lost, _LOST, scales),
        gap * _radius(lost, _LOST_AFTER_GAP, scales),
    )
    most = math.sqrt(MOST_CHANCE / (math.pi * density)) if density > 0.0 else math.inf
    square = float(weights @ scales**2)
    return SearchRange(
        range_nm=float(f"{min(wanted, most):.3g}"),
        step_sd_nm=math.sqrt(square),
        spots_per_um2=density * 1e6,
        false_share=min(2.0 * math.pi * density * square, 1.0),
        cut=wanted > most,
    )


def _radius(lost: Callable[[float], float], share: float, scales: Floats) -> float:
    """Radius that loses this share of the steps."""
    longest = 2.0 * math.sqrt(-2.0 * math.log(share)) * float(scales[-1])
    return float(optimize.brentq(lambda radius: lost(radius) - share, 0.0, longest))


def _distances(frame: Integers, place: Floats) -> tuple[Floats, Floats]:
    """Distances to the nearest spots of the next frame and of the same one."""
    order = np.argsort(frame, kind="stable")
    place = place[order]
    numbers, starts = np.unique(frame[order], return_index=True)
    ends = np.append(starts[1:], frame.size)
    pairs = np.flatnonzero(np.diff(numbers) == 1)
    pairs = pairs[:: -(-pairs.size // _FRAME_PAIRS) or 1]
    onwards: list[Floats] = [np.empty(0)]
    within: list[Floats] = [np.empty(0)]
    for k in pairs:
        here = place[starts[k] : ends[k]]
        onwards.append(_nearest(place[starts[k + 1] : ends[k + 1]], here, 1))
        if len(here) > 1:
            within.append(_nearest(here, here, 2))
    return np.concatenate(onwards), np.concatenate(within)


def _nearest(there: Floats, here: Floats, rank: int) -> Floats:
    """Distance from each place to the nearest of others, or to the second nearest."""
    distance, _ = cKDTree(there).query(here, k=[rank])
    return np.asarray(distance, np.float64)[:, 0]


def _weights(distance: Floats, scales: Floats, density: float) -> Floats:
    """Shares of the step scales by expectation maximisation, those that are gone left out."""
    chance = 2.0 * math.pi * density
    low = max(float(distance.min()), 0.1 * scales[0])
    edges = np.geomspace(low, max(float(distance.max()), 2.0 * low) * 1.001, _BINS + 1)
    counts = np.histogram(np.maximum(distance, low), edges)[0]
    middle = np.sqrt(edges[1:] * edges[:-1])[counts > 0]
    counts = counts[counts > 0] / distance.size
    inverse = np.append(1.0 / scales**2, 0.0)
    rate = inverse + chance
    likelihood = middle[:, np.newaxis] * rate * np.exp(-0.5 * np.outer(middle**2, rate))
    weights = np.full(inverse.size, 1.0 / inverse.size)
    for _ in range(_ROUNDS):
        part = likelihood * weights
        part /= np.maximum(part.sum(axis=1, keepdims=True), 1e-300)
        weights = counts @ part
    found: Floats = weights[:-1]
    return found
