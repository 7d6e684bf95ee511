"""One localisation per rotor and frame."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.flags import FIT_FAILED, FitFlag


def duplicates(localisations: pd.DataFrame, distance_nm: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark all but one localisation of every rotor and frame.

    A rotor's tip is in one place at a time, so a second spot is a background spot, another emitter
    or the same spot found twice. Kept is, in this order: a converged fit, the spot nearest to the
    rotor's circle, the brighter one, the upper one, the one further left; the order of rows plays
    no part.

    Parameters
    ----------
    localisations
        Table with frame, x_nm, y_nm and rotor; photons and fit_flags where known. Rows without a
        rotor (-1) are never marked.
    distance_nm
        Distance of every localisation from its rotor's circle, shape (n,), nm.
    """
    rows = len(localisations)
    rotor = localisations["rotor"].to_numpy()
    frame = localisations["frame"].to_numpy()
    failed = np.zeros(rows, dtype=bool)
    if "fit_flags" in localisations:
        failed = (localisations["fit_flags"].to_numpy() & int(FIT_FAILED)) != 0
    photons = np.zeros(rows)
    if "photons" in localisations:
        photons = localisations["photons"].to_numpy(dtype=np.float64)
    x = localisations["x_nm"].to_numpy()
    y = localisations["y_nm"].to_numpy()
    order = np.lexsort((x, y, -photons, distance_nm, failed, frame, rotor))
    repeats = np.zeros(rows, dtype=bool)
    repeats[order[1:]] = (np.diff(rotor[order]) == 0) & (np.diff(frame[order]) == 0)
    marked: NDArray[np.bool_] = repeats & (rotor >= 0)
    return marked


def flag_duplicates(localisations: pd.DataFrame, marked: NDArray[np.bool_]) -> pd.DataFrame:
    """Set FitFlag.DUPLICATE on the marked rows of a copy and clear it on all others."""
    flags = np.zeros(len(localisations), dtype=np.int32)
    if "fit_flags" in localisations:
        flags = localisations["fit_flags"].to_numpy(dtype=np.int32)
    bit = np.int32(FitFlag.DUPLICATE)
    return localisations.assign(fit_flags=np.where(marked, flags | bit, flags & ~bit))


def is_duplicate(localisations: pd.DataFrame) -> NDArray[np.bool_]:
    """Whether each row carries FitFlag.DUPLICATE; none does when fit_flags is absent."""
    if "fit_flags" not in localisations:
        return np.zeros(len(localisations), dtype=bool)
    flags: NDArray[np.int32] = localisations["fit_flags"].to_numpy(dtype=np.int32)
    flagged: NDArray[np.bool_] = (flags & np.int32(FitFlag.DUPLICATE)) != 0
    return flagged
