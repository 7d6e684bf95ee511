"""How many neighbours a localisation has in the whole movie, counted without listing them."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.corrections.options import DensityOptions
from rotortrack.errors import ConfigurationError, TableError
from rotortrack.kernels import kernel

_BANDS_PER_RADIUS = 3
"""Narrower bands leave fewer distances to compute but more bands to visit."""
_FARTHEST_NM = 1e12
"""No position: a kilometre away, where rounding is no longer small against a radius."""


def neighbour_counts(
    x_nm: NDArray[np.float64], y_nm: NDArray[np.float64], radius_nm: float
) -> NDArray[np.int64]:
    """Count the other positions of the table that are strictly closer than a radius.

    Positions are pooled over frames. Rows with exactly the same coordinates are one position, so
    they are no neighbours of each other and count once for others, as in the plugin's k-d tree.

    Parameters
    ----------
    x_nm, y_nm
        Shape (n,), nm; rows that are nan, infinite or beyond 1 km have and are no neighbours.
    radius_nm
        Radius of the neighbourhood, nm, greater than 0.

    Returns
    -------
    Shape (n,).

    Raises
    ------
    ConfigurationError
        The radius is not a positive number.

    Notes
    -----
    Equal to counting ``hypot(dx, dy) < radius`` over all pairs of distinct positions. Positions
    are sorted by horizontal bands and by x inside them: the part of a band that surely lies
    inside the circle is counted as one difference of row numbers, and only its two ends are
    computed. Memory is linear in n however dense the rotors are.

    Examples
    --------
    >>> import numpy as np
    >>> import rotortrack as rt
    >>> rt.neighbour_counts(np.array([0.0, 30.0, 500.0]), np.zeros(3), 50.0).tolist()
    [1, 1, 0]
    """
    return _count(x_nm, y_nm, radius_nm, enough=np.iinfo(np.int64).max)


def dense_enough(localisations: pd.DataFrame, options: DensityOptions) -> NDArray[np.bool_]:
    """Tell for each row whether at least `min_neighbours` positions are within `radius_nm`.

    Counts as `neighbour_counts` does, but stops at `min_neighbours`.

    Parameters
    ----------
    localisations
        Columns x_nm and y_nm; rows without a position fail.
    options
        Radius and threshold.

    Returns
    -------
    Shape (n,).

    Raises
    ------
    TableError
        The positions are missing.
    """
    missing = [name for name in ("x_nm", "y_nm") if name not in localisations.columns]
    if missing:
        raise TableError(
            f"the localisations lack the column(s) {', '.join(missing)}, which the density filter "
            "needs"
        )
    x_nm = localisations["x_nm"].to_numpy(dtype=np.float64)
    y_nm = localisations["y_nm"].to_numpy(dtype=np.float64)
    counts = _count(x_nm, y_nm, options.radius_nm, enough=options.min_neighbours)
    return (counts >= options.min_neighbours) & _usable(x_nm, y_nm)


def _usable(x_nm: NDArray[np.float64], y_nm: NDArray[np.float64]) -> NDArray[np.bool_]:
    near: NDArray[np.bool_] = (np.abs(x_nm) < _FARTHEST_NM) & (np.abs(y_nm) < _FARTHEST_NM)
    return near


def _count(
    x_nm: NDArray[np.float64], y_nm: NDArray[np.float64], radius_nm: float, enough: int
) -> NDArray[np.int64]:
    """Count neighbours; a count may stop anywhere at or above `enough`."""
    if not (np.isfinite(radius_nm) and radius_nm > 0):
        raise ConfigurationError(f"radius_nm must be greater than 0, not {radius_nm:g}")
    x_all = np.asarray(x_nm, dtype=np.float64)
    y_all = np.asarray(y_nm, dtype=np.float64)
    counts = np.zeros(x_all.size, dtype=np.int64)
    usable = np.flatnonzero(_usable(x_all, y_all))
    if usable.size == 0:
        return counts
    x, y = x_all[usable], y_all[usable]
    # Band numbers must stay exact as floats whatever the span.
    band_height = max(radius_nm / _BANDS_PER_RADIUS, float(np.ptp(y)) * 1e-15)
    band = np.floor((y - y.min()) / band_height)
    order = np.lexsort((y, x, band))
    x, y, band = x[order], y[order], band[order]

    distinct = np.ones(x.size, dtype=np.bool_)
    distinct[1:] = (x[1:] != x[:-1]) | (y[1:] != y[:-1])
    x, y, band = x[distinct], y[distinct], band[distinct]
    starts = np.flatnonzero(np.append(True, band[1:] != band[:-1]))
    # Bands are named by the floats that floor gave: a stray far position costs no empty bands.
    distinct_counts = _count_in_bands(
        x, y, band[starts], np.append(starts, x.size), radius_nm, y.min(), band_height, enough
    )
    counts[usable[order]] = distinct_counts[np.cumsum(distinct) - 1]
    return counts


@kernel
def _count_in_bands(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    bands: NDArray[np.float64],
    starts: NDArray[np.int64],
    radius: float,
    lowest: float,
    band_height: float,
    enough: int,
) -> NDArray[np.int64]:
    """Count neighbours of distinct positions that are sorted by band, then by x."""
    counts = np.zeros(x.size, dtype=np.int64)
    squared = radius * radius
    # Beyond rounding: these distances from the radius are left to the exact test.
    slack = 1e-6 * radius + 1e-12 * (np.abs(x).max() + np.abs(y).max())
    reach = np.int64(np.ceil((radius + slack) / band_height)) + 1
    # Nearest bands first, so that a count that may stop does so early.
    for step in range(2 * reach + 1):
        shift = (step + 1) // 2 if step % 2 else -(step // 2)
        for b in range(bands.size):
            other = np.searchsorted(bands, bands[b] + shift)
            if other == bands.size or bands[other] != bands[b] + shift:
                continue
            bottom = lowest + bands[other] * band_height
            top = bottom + band_height
            end = starts[other + 1]
            begin = starts[other]
            for i in range(starts[b], starts[b + 1]):
                if counts[i] >= enough:
                    continue
                nearest = max(bottom - y[i], y[i] - top, 0.0) - slack
                farthest = max(y[i] - bottom, top - y[i]) + slack
                if nearest >= radius:
                    continue
                # Positions between `inner` are neighbours, those beyond `outer` are not.
                outer = np.sqrt(squared - max(nearest, 0.0) ** 2) + slack
                inner = np.sqrt(max(squared - farthest**2, 0.0)) - slack
                # x[i] ascends but `outer` does not, so only the whole radius moves `begin` on.
                while begin < end and x[begin] < x[i] - radius - slack:
                    begin += 1
                outer_low = _first(x, begin, end, x[i] - outer)
                outer_high = _first(x, outer_low, end, x[i] + outer)
                inner_low, inner_high = outer_high, outer_high
                if inner > 0:
                    inner_low = _first(x, outer_low, outer_high, x[i] - inner)
                    inner_high = _first(x, inner_low, outer_high, x[i] + inner)
                count = inner_high - inner_low
                for j in range(outer_low, inner_low):
                    count += (x[j] - x[i]) ** 2 + (y[j] - y[i]) ** 2 < squared
                for j in range(inner_high, outer_high):
                    count += (x[j] - x[i]) ** 2 + (y[j] - y[i]) ** 2 < squared
                # The own band holds the position itself.
                counts[i] += count - (1 if shift == 0 else 0)
    return counts


@kernel
def _first(x: NDArray[np.float64], low: int, high: int, value: float) -> int:
    """First index from `low` to `high` whose x is at least `value`; x ascends there."""
    while low < high:
        middle = (low + high) // 2
        if x[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low
