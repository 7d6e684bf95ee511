"""Clusters that are pieces of one rotor, which the clustering distance did not bridge."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from rotortrack.rotors.circle import CircleEnd, fit_circle

REACH_NM = 500.0
"""Middles of the pieces of a circle lie within its diameter; that of the largest rods is 450 nm."""

MAX_SHARED = 0.2
"""Part of the frames that two independent emitters would share; the pieces of one share none."""

MIN_EXPECTED = 10.0
"""Shared frames expected of independent emitters below which none tells nothing: of 10 there are
two or fewer by chance in 0.3 % of pairs."""

MAX_WIDENING = 1.5
"""Scatter about a common circle over the localisation uncertainty."""

_BLOCKS = 20

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def find_fragments(spots: pd.DataFrame, noise_nm: float) -> dict[int, int]:
    """Find the clusters that are pieces of one rotor.

    Two neighbouring clusters are when they take turns (within twentieths of the movie they share
    less than a fifth of the frames that two independent emitters would) and all their positions
    together do not contradict one circle. One emitter after another is no such pair, nor are two
    that are seen together.

    Parameters
    ----------
    spots
        One row a rotor and frame: rotor, frame, x_nm, y_nm; rows with rotor -1 are ignored.
    noise_nm
        Localisation uncertainty per axis, nm; nan where it is not known, so that only the circle's
        being determined counts.

    Returns
    -------
    dict
        For every cluster that is a piece: the smallest number among its rotor's pieces.

    Notes
    -----
    O(n log n), and a circle fit (1.5 ms) for each pair that takes turns.
    """
    members = spots[spots["rotor"] >= 0]
    groups = members.groupby("rotor").indices
    numbers = np.unique(members["rotor"].to_numpy(dtype=np.int64))
    if numbers.size < 2:
        return {}
    frame = members["frame"].to_numpy(dtype=np.int64)
    x, y = (members[name].to_numpy(dtype=np.float64) for name in ("x_nm", "y_nm"))
    rows = [groups[number] for number in numbers]
    middles = np.array([(np.median(x[own]), np.median(y[own])) for own in rows])
    edges = np.linspace(frame.min(), frame.max() + 1.0, _BLOCKS + 1)
    pairs = [
        (a, b)
        for a, b in sorted(KDTree(middles).query_pairs(REACH_NM))
        if take_turns(frame[rows[a]], frame[rows[b]], edges)
        and _on_one_circle(x[np.r_[rows[a], rows[b]]], y[np.r_[rows[a], rows[b]]], noise_nm)
    ]
    if not pairs:
        return {}
    first, second = np.array(pairs).T
    graph = coo_array((np.ones(first.size), (first, second)), shape=(numbers.size,) * 2)
    label = connected_components(graph, directed=False)[1]
    sizes = np.bincount(label)
    # Numbers ascend, so a label's first is its smallest.
    smallest = numbers[np.unique(label, return_index=True)[1]]
    return {
        int(number): int(smallest[own])
        for number, own in zip(numbers, label, strict=True)
        if sizes[own] > 1
    }


def take_turns(frame: Integers, other: Integers, edges: Floats) -> bool:
    """Whether two clusters are seen in the same parts of a movie, but not in the same frames.

    Parameters
    ----------
    frame, other
        Frames in which each is seen.
    edges
        Borders of the parts of the movie, shape (parts + 1,).
    """
    seen, seen_other = np.histogram(frame, edges)[0], np.histogram(other, edges)[0]
    each = seen * seen_other / np.diff(edges)
    # One that replaces another has one such part, in which it comes.
    expected = float(each.sum() - each.max())
    shared = np.intersect1d(frame, other).size
    return expected >= MIN_EXPECTED and shared <= MAX_SHARED * expected


def _on_one_circle(x: Floats, y: Floats, noise_nm: float) -> bool:
    """Whether positions lie on a circle, or are too few places to tell (two poles, one line)."""
    fit = fit_circle(x, y, outlier_sd=4.0)
    if fit.end is CircleEnd.FITTED:
        return 2.0 * fit.radius_nm <= REACH_NM and not (
            fit.residual_sd_nm > MAX_WIDENING * noise_nm if math.isfinite(noise_nm) else False
        )
    return fit.end in (CircleEnd.ARC_TOO_SHORT, CircleEnd.COLLINEAR)
