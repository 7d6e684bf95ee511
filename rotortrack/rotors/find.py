"""From localisations to rotors: clusters, one spot a frame, circles."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.errors import PercolationWarning, TableError
from rotortrack.rotors.circle import CircleFit, fit_circle
from rotortrack.rotors.cluster import (
    background_density,
    choose_distance,
    cluster,
    percolation_margin,
    smallest_distance,
)
from rotortrack.rotors.options import CircleOptions, ClusterOptions
from rotortrack.rotors.per_frame import duplicates, flag_duplicates
from rotortrack.tables import ROTORS, conform

_NEEDED = ("frame", "x_nm", "y_nm")


@dataclass(frozen=True)
class FoundRotors:
    """Rotors and their localisations.

    Attributes
    ----------
    localisations
        The given table, rows and order kept, with `rotor` (-1: none) and `fit_flags`, where
        FitFlag.DUPLICATE marks all but one localisation of a rotor and frame.
    rotors
        One row a rotor, numbered from the top of the field; centre (mean position where there is no
        circle), radius, arc, counts, and `circle`, how its fit ended (CircleEnd).
    distance_nm, distance_reason
        Clustering distance and the sentence on where it came from.
    percolation_margin
        How many times denser the background could be before all clusters join.
    small_clusters, small_cluster_localisations
        What was dropped because of min_localisations.
    duplicates
        Localisations flagged as second in their rotor and frame.
    """

    localisations: pd.DataFrame
    rotors: pd.DataFrame
    distance_nm: float
    distance_reason: str
    percolation_margin: float
    small_clusters: int
    small_cluster_localisations: int
    duplicates: int


def find_rotors(
    localisations: pd.DataFrame,
    cluster_options: ClusterOptions | None = None,
    circle_options: CircleOptions | None = None,
) -> FoundRotors:
    """Group localisations into rotors and fit a circle to each.

    Every cluster is fitted twice: with all its localisations to choose one a frame, then with those
    chosen. Background spots that hang on to a cluster by a long link take no part in either fit.

    Parameters
    ----------
    localisations
        Table with frame, x_nm and y_nm; uncertainty_nm, photons and fit_flags are used where
        present.
    cluster_options, circle_options
        Default: ClusterOptions() and CircleOptions().

    Raises
    ------
    TableError
        A needed column is missing.

    Warns
    -----
    PercolationWarning
        The background is within a factor 2 of linking the whole field.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> import rotortrack as rt
    >>> turn = 0.08 * np.arange(200)
    >>> noise = np.random.default_rng(1).normal(0.0, 8.0, (2, 200))
    >>> spots = pd.DataFrame(
    ...     {
    ...         "frame": np.arange(200),
    ...         "x_nm": 500.0 + 120.0 * np.cos(turn) + noise[0],
    ...         "y_nm": 500.0 - 120.0 * np.sin(turn) + noise[1],
    ...     }
    ... ).assign(uncertainty_nm=8.0, x_sd_nm=8.0, y_sd_nm=8.0, photons=500.0)
    >>> found = rt.find_rotors(spots)
    >>> found.rotors[["x_nm", "y_nm", "radius_nm"]].round(-1).to_numpy().tolist()
    [[500.0, 500.0, 120.0]]
    """
    clustering = cluster_options or ClusterOptions()
    circle = circle_options or CircleOptions()
    missing = [name for name in _NEEDED if name not in localisations]
    if missing:
        raise TableError(f"the localisations lack the column(s) {', '.join(missing)}")
    x = localisations["x_nm"].to_numpy(dtype=np.float64)
    y = localisations["y_nm"].to_numpy(dtype=np.float64)
    if clustering.distance_nm is None:
        choice = choose_distance(localisations, min_localisations=clustering.min_localisations)
        distance, reason, density = choice.distance_nm, choice.reason, choice.density_per_nm2
    else:
        distance, density = clustering.distance_nm, background_density(x, y)
        reason = f"distance_nm = {distance:g} was given"
    margin = percolation_margin(density, distance)
    if margin < 2.0:
        warnings.warn(
            f"the background of {density:.2g} localisations per nm^2 is {100.0 / margin:.0f} % of "
            f"what links the whole field at distance_nm = {distance:.0f}, so separate rotors may "
            "be joined: filter by density first, or lower distance_nm",
            PercolationWarning,
            stacklevel=2,
        )
    rotor, small_clusters = _keep_large(cluster(x, y, distance), clustering.min_localisations)
    table = localisations.assign(rotor=rotor)
    stray = _strays(rotor, cluster(x, y, min(distance, smallest_distance(table))))
    first = _fits(table, ~stray, circle)
    marked = duplicates(table, _distance_from_circle(x, y, rotor, first))
    second = _fits(table, ~stray & ~marked, circle)
    return FoundRotors(
        localisations=flag_duplicates(table, marked),
        rotors=_rotor_table(table[~marked], second),
        distance_nm=distance,
        distance_reason=reason,
        percolation_margin=margin,
        small_clusters=small_clusters,
        small_cluster_localisations=int(
            np.count_nonzero((rotor < 0) & np.isfinite(x) & np.isfinite(y))
        ),
        duplicates=int(np.count_nonzero(marked)),
    )


def _keep_large(labels: NDArray[np.int64], min_localisations: int) -> tuple[NDArray[np.int64], int]:
    """Renumber the clusters that are large enough, in their order; the others become -1."""
    sizes = np.bincount(labels[labels >= 0])
    large = sizes >= min_localisations
    number = np.where(large, np.cumsum(large) - 1, -1)
    kept = np.full(labels.size, -1, dtype=np.int64)
    kept[labels >= 0] = number[labels[labels >= 0]]
    return kept, int(np.count_nonzero(~large))


def _strays(rotor: NDArray[np.int64], pieces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Members of a rotor in a piece, joined at the smallest distance, of less than 2 % of it.

    They pull the circle of a short arc to twice its radius, before any residual can betray them;
    the poles of a toggling rotor are larger pieces.
    """
    piece_size = np.bincount(pieces[pieces >= 0], minlength=1)[pieces]
    rotor_size = np.bincount(rotor[rotor >= 0], minlength=1)
    # The last entry of an empty or short array is harmless: rows with -1 are never used.
    stray: NDArray[np.bool_] = (rotor >= 0) & (piece_size < np.maximum(3, 0.02 * rotor_size[rotor]))
    # A rotor that is nothing but small pieces keeps them all: it has no larger one to stray from.
    left = np.bincount(rotor[(rotor >= 0) & ~stray], minlength=rotor_size.size)
    return stray & (left[rotor] > 0)


def _fits(table: pd.DataFrame, use: NDArray[np.bool_], options: CircleOptions) -> list[CircleFit]:
    """Circle of every rotor, in the order of their numbers, from the rows in `use`."""
    rotor = table["rotor"].to_numpy()
    x, y = table["x_nm"].to_numpy(), table["y_nm"].to_numpy()
    rows = np.flatnonzero(use & (rotor >= 0))
    # Positions enter sums in one order whatever the order of rows.
    rows = rows[np.lexsort((x[rows], y[rows], rotor[rows]))]
    ends = np.cumsum(np.bincount(rotor[rows]))
    return [
        fit_circle(x[part], y[part], options.method, outlier_sd=options.outlier_sd)
        for part in np.split(rows, ends[:-1])
        if part.size
    ]


def _distance_from_circle(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    rotor: NDArray[np.int64],
    fits: list[CircleFit],
) -> NDArray[np.float64]:
    """Distance from the circle, or from the mean position where there is none; 0 without rotor."""
    distance = np.zeros(x.size)
    member = rotor >= 0
    if member.any():
        centre_x, centre_y, radius = np.array(
            [
                (fit.x_nm, fit.y_nm, 0.0 if math.isnan(fit.radius_nm) else fit.radius_nm)
                for fit in fits
            ]
        ).T
        own = rotor[member]
        r = np.hypot(x[member] - centre_x[own], y[member] - centre_y[own])
        distance[member] = np.abs(r - radius[own])
    return distance


def _rotor_table(used: pd.DataFrame, fits: list[CircleFit]) -> pd.DataFrame:
    """One row a rotor."""
    members = used[used["rotor"] >= 0].groupby("rotor")
    numbers = pd.RangeIndex(len(fits))
    counts = members.size().reindex(numbers).to_numpy(dtype=np.int64)
    uncertainty = np.full(len(fits), np.nan)
    if "uncertainty_nm" in used:
        uncertainty = members["uncertainty_nm"].median().reindex(numbers).to_numpy()
    table = pd.DataFrame(
        {
            "rotor": np.arange(len(fits)),
            "x_nm": [fit.x_nm for fit in fits],
            "y_nm": [fit.y_nm for fit in fits],
            "radius_nm": [fit.radius_nm for fit in fits],
            "radius_fit_nm": [fit.radius_nm for fit in fits],
            "radius_sd_nm": [fit.radius_sd_nm for fit in fits],
            "x_sd_nm": [fit.x_sd_nm for fit in fits],
            "y_sd_nm": [fit.y_sd_nm for fit in fits],
            "axis_ratio": [fit.axis_ratio for fit in fits],
            "axis_ratio_sd": [fit.axis_ratio_sd for fit in fits],
            "arc_deg": [fit.arc_deg for fit in fits],
            "n_localisations": counts,
            "residual_sd_nm": [fit.residual_sd_nm for fit in fits],
            "localisation_sd_nm": uncertainty,
            "circle": [fit.end.value for fit in fits],
        }
    )
    return conform(table, ROTORS, "rotors")
