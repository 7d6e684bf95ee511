"""Which found spot is which true one, and which found rotor is which true one."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

GATE_NM = 250.0
"""Spots farther apart than this are never one; about two widths of a spot."""

_FRAME_APART_NM = 1e6


def match_spots(found: pd.DataFrame, true: pd.DataFrame) -> NDArray[np.int64]:
    """Match spots frame by frame: two are one where each is the other's nearest within the gate.

    Parameters
    ----------
    found, true
        Columns frame, x_nm and y_nm.

    Returns
    -------
    For each found spot the row of the true one, -1 for none.
    """
    matched = np.full(len(found), -1, np.int64)
    if found.empty or true.empty:
        return matched
    # Frames are planes so far apart that no neighbour is sought across them.
    planes = [
        np.column_stack([t["x_nm"], t["y_nm"], t["frame"].to_numpy(float) * _FRAME_APART_NM])
        for t in (found, true)
    ]
    near, nearest = map(
        np.asarray, cKDTree(planes[1]).query(planes[0], distance_upper_bound=GATE_NM)
    )
    back = np.asarray(cKDTree(planes[0]).query(planes[1])[1])
    rows = np.flatnonzero(np.isfinite(near))
    mutual = rows[back[nearest[rows]] == rows]
    matched[mutual] = nearest[mutual]
    return matched


def match_rotors(
    found_rotor: NDArray[np.int64], true_rotor: NDArray[np.int64]
) -> dict[int, tuple[int, int]]:
    """Match rotors by the spots that they share.

    Parameters
    ----------
    found_rotor, true_rotor
        Of every matched spot: the rotor to which the analysis gave it (-1 for none) and the true
        one.

    Returns
    -------
    By found rotor: the true rotor of most of its spots, and how many those are.
    """
    inside = found_rotor >= 0
    pairs, counts = np.unique(
        np.stack([found_rotor[inside], true_rotor[inside]]), axis=1, return_counts=True
    )
    best: dict[int, tuple[int, int]] = {}
    for (found, true), count in zip(pairs.T.tolist(), counts.tolist(), strict=True):
        if count > best.get(found, (-1, 0))[1]:
            best[found] = (true, count)
    return best
