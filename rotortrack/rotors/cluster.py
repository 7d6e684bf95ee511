"""Grouping of localisations into rotors by Euclidean distance, and the choice of that distance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.errors import TableError
from rotortrack.rotors.linkage import join_cells

Labels = NDArray[np.int64]
Positions = NDArray[np.float64]

PERCOLATION_NEIGHBOURS = 4.51
"""Mean number of neighbours within d at which randomly spread points join across a plane."""

LARGEST_CHOICE_NM = 250.0
"""Joins the two ends of a toggling 450-nm rod, keeps rings of radius 200 nm apart at 1 um."""

SMALLEST_CHOICE_NM = 60.0
"""Bridges the gaps of 99 of 100 rings of radius 200 nm sampled by 200 localisations."""

_MAX_CELLS_PER_AXIS = 2.0**31
# A cell must hold only points within d of each other although x / side is rounded: 2**31 cells
# round by at most 5e-7 of a cell.
_CELL_SHRINK = 1e-6


def cluster(x_nm: Positions, y_nm: Positions, distance_nm: float) -> Labels:
    """Join points by single linkage: two belong together when a chain of steps <= d links them.

    Square cells of side d / sqrt(2) hold only points within d of each other; cells are joined by
    union-find with the 24 around them, looking at points only where cells are still separate.

    Parameters
    ----------
    x_nm, y_nm
        Positions, shape (n,), nm.
    distance_nm
        d, nm; a distance of exactly d joins.

    Returns
    -------
    Labels, shape (n,): -1 where a position is not finite, else 0, 1, ... in the order of the
    clusters' topmost points (smallest y, then smallest x), whatever the order of rows.

    Raises
    ------
    TableError
        The positions span more than 2e9 distances.

    Notes
    -----
    Exact; O(n) memory, O(n log n) time (1e6 points: 0.2 to 0.9 s). Connected components of the
    graph of distances <= d are the single-linkage clusters cut at d, as MATLAB's pcsegdist makes.

    Examples
    --------
    >>> import numpy as np
    >>> import rotortrack as rt
    >>> rt.cluster(np.array([0.0, 30.0, 500.0]), np.zeros(3), 50.0).tolist()
    [0, 0, 1]
    """
    x_nm = np.asarray(x_nm, dtype=np.float64)
    y_nm = np.asarray(y_nm, dtype=np.float64)
    labels = np.full(x_nm.size, -1, dtype=np.int64)
    finite = np.flatnonzero(np.isfinite(x_nm) & np.isfinite(y_nm))
    if not finite.size:
        return labels
    x, y = x_nm[finite], y_nm[finite]
    side = distance_nm / math.sqrt(2.0) * (1.0 - _CELL_SHRINK)
    columns, rows = (x - x.min()) / side, (y - y.min()) / side
    if max(columns.max(), rows.max()) > _MAX_CELLS_PER_AXIS:
        raise TableError(
            f"the positions span more than 2e9 times distance_nm = {distance_nm:g}: remove "
            "localisations that lie far outside the field, or raise distance_nm"
        )
    width = int(columns.max()) + 5
    key = rows.astype(np.int64) * width + columns.astype(np.int64)
    order = np.argsort(key)
    key, x, y = key[order], x[order], y[order]
    starts = np.flatnonzero(np.r_[True, key[1:] != key[:-1], True])
    roots = join_cells(x, y, starts, key[starts[:-1]], width, _largest_square(distance_nm))
    labels[finite[order]] = _number_from_the_top(np.repeat(roots, np.diff(starts)), x, y)
    return labels


def percolation_margin(density_per_nm2: float, distance_nm: float) -> float:
    """How many times denser the background could be before single linkage joins the whole field.

    (4.51 / (pi d^2)) / density; below about 2 separate rotors are joined by chance.

    Parameters
    ----------
    density_per_nm2
        Localisations that belong to no rotor, per nm^2, over the whole movie.
    distance_nm
        d, nm.
    """
    threshold = PERCOLATION_NEIGHBOURS / (math.pi * distance_nm**2)
    return threshold / density_per_nm2 if density_per_nm2 > 0.0 else math.inf


def background_density(x_nm: Positions, y_nm: Positions) -> float:
    """Density of localisations between the rotors, per nm^2.

    Counts in 200-nm cells over the bounding box (widened by 500 nm, so that a box that holds only a
    rotor is not all rotor), averaged after the cells too full for a Poisson background are removed.

    Parameters
    ----------
    x_nm, y_nm
        Positions, shape (n,), nm; those that are not finite are ignored.
    """
    side, rim = 200.0, 500.0
    finite = np.isfinite(x_nm) & np.isfinite(y_nm)
    if not finite.any():
        return 0.0
    x, y = x_nm[finite], y_nm[finite]
    columns = ((x - x.min() + rim) / side).astype(np.int64)
    rows = ((y - y.min() + rim) / side).astype(np.int64)
    width, height = (1 + int((np.ptp(v) + 2.0 * rim) / side) for v in (x, y))
    _, occupied = np.unique(rows * width + columns, return_counts=True)
    cells = float(width) * height
    # Median of all cells without holding the empty ones.
    empty = cells - occupied.size
    mean = 0.0 if empty >= cells / 2 else float(np.sort(occupied)[int(cells / 2 - empty)])
    for _ in range(20):
        kept = occupied <= mean + 3.0 * math.sqrt(mean) + 2.0
        mean = float(occupied[kept].sum()) / max(1.0, empty + np.count_nonzero(kept))
    return mean / side**2


@dataclass(frozen=True)
class DistanceChoice:
    """An automatically chosen clustering distance.

    `reason` is the sentence shown to the user.
    """

    distance_nm: float
    reason: str
    density_per_nm2: float


def choose_distance(localisations: pd.DataFrame, *, min_localisations: int = 30) -> DistanceChoice:
    """Choose the clustering distance: the largest that joins no two rotors, from 250 nm down.

    A large distance keeps a rotor that toggles between two places whole; it is lowered in steps of
    0.8 while the percolation margin is below 4, or while more than 5 % of the clusters found at the
    smallest distance would be joined with another of them that is seen in the same frames (the
    spots of one rotor never are). The smallest distance is five localisation uncertainties, at
    least 60 and at most 120 nm.

    Parameters
    ----------
    localisations
        Table with frame, x_nm, y_nm and, where known, uncertainty_nm.
    min_localisations
        Smaller clusters are background.

    Notes
    -----
    Costs one clustering for every distance tried, two in a clean field.
    """
    x = localisations["x_nm"].to_numpy(dtype=np.float64)
    y = localisations["y_nm"].to_numpy(dtype=np.float64)
    frame = localisations["frame"].to_numpy()
    density = background_density(x, y)
    smallest = smallest_distance(localisations)
    fine = _without_small(cluster(x, y, smallest), min_localisations)
    distance = LARGEST_CHOICE_NM
    obstacle = "nothing in the field asks for less"
    while distance > smallest:
        margin = percolation_margin(density, distance)
        if margin < 4.0:
            obstacle = "at larger distances background spots would link rotors"
        elif _wrongly_joined(fine, cluster(x, y, distance), frame) > 0.05:
            obstacle = "at larger distances rotors seen in the same frames would be joined"
        else:
            break
        distance *= 0.8
    distance = max(distance, smallest)
    margin = percolation_margin(density, distance)
    background = (
        f"{margin:.3g} times more background would link the field"
        if np.isfinite(margin)
        else "the field has no background"
    )
    return DistanceChoice(
        distance_nm=distance,
        density_per_nm2=density,
        reason=(
            f"spots closer than distance_nm = {distance:.0f} were joined, chosen from "
            f"{LARGEST_CHOICE_NM:.0f} down to {smallest:.0f} nm: {obstacle}; {background}"
        ),
    )


def smallest_distance(localisations: pd.DataFrame) -> float:
    """Distance below which even one rotor's ring may break: five uncertainties, 60 to 120 nm."""
    if "uncertainty_nm" not in localisations:
        return SMALLEST_CHOICE_NM
    uncertainty = float(localisations["uncertainty_nm"].median())
    if not math.isfinite(uncertainty):
        return SMALLEST_CHOICE_NM
    return min(max(SMALLEST_CHOICE_NM, 5.0 * uncertainty), 2.0 * SMALLEST_CHOICE_NM)


def _largest_square(distance: float) -> float:
    """Find the largest q with sqrt(q) <= distance: comparing squares is exact in a tie."""
    square = distance * distance
    while math.sqrt(square) > distance:
        square = math.nextafter(square, 0.0)
    while math.sqrt(math.nextafter(square, math.inf)) <= distance:
        square = math.nextafter(square, math.inf)
    return square


def _number_from_the_top(roots: Labels, x: Positions, y: Positions) -> Labels:
    """Renumber clusters by their topmost point; `roots` are cell numbers."""
    top = np.full(int(roots.max()) + 1, np.inf)
    np.minimum.at(top, roots, y)
    left = np.full(top.size, np.inf)
    at_top = y == top[roots]
    np.minimum.at(left, roots[at_top], x[at_top])
    used = np.unique(roots)
    ranked = used[np.lexsort((left[used], top[used]))]
    number = np.empty(top.size, dtype=np.int64)
    number[ranked] = np.arange(ranked.size)
    return number[roots]


def _without_small(labels: Labels, min_localisations: int) -> Labels:
    """Labels with -1 for the members of small clusters."""
    sizes = np.bincount(labels[labels >= 0], minlength=1)
    return np.where((labels >= 0) & (sizes[labels] >= min_localisations), labels, -1)


def _wrongly_joined(fine: Labels, coarse: Labels, frame: NDArray[np.int64]) -> float:
    """Fraction of fine clusters that a coarse one joins although they appear independently.

    Two independent emitters seen in a and b of T frames share a b / T of them, two fragments of one
    rotor none; a joint cluster is wrong when it shares more than half of the former.
    """
    member = fine >= 0
    if not member.any():
        return 0.0
    fine, coarse = fine[member], coarse[member]
    parents = np.full(int(fine.max()) + 1, -1, dtype=np.int64)
    parents[fine] = coarse
    pieces = np.bincount(parents[parents >= 0])
    if pieces.max() == 1:
        return 0.0
    joint = pieces[coarse] > 1
    fine, coarse = fine[joint], coarse[joint]
    moments, moment = np.unique(frame[member], return_inverse=True)
    moment, frames = moment[joint], moments.size
    fine_seen = np.unique(fine * frames + moment) // frames
    coarse_seen = np.unique(coarse * frames + moment) // frames
    seen = np.bincount(fine_seen, minlength=parents.size).astype(np.float64)
    # Small clusters have no parent and are never seen.
    of = np.maximum(parents, 0)
    total = np.bincount(of, seen, pieces.size)
    expected = (total**2 - np.bincount(of, seen**2, pieces.size)) / (2.0 * frames)
    shared = total - np.bincount(coarse_seen, minlength=pieces.size)
    wrong = shared > 0.5 * np.maximum(expected, 2.0)
    return float(pieces[wrong].sum() / pieces.sum())
