"""Which candidates share a window, and which of their rows stand for the same emitter."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.flags import FIT_FAILED, FitFlag
from rotortrack.kernels import kernel
from rotortrack.localise.fit import RESULT_COLUMNS
from rotortrack.localise.overlap import SMALLEST_SEPARATION

MOST_NEIGHBOURS: Final = 8

_FAILED = int(FIT_FAILED)
_LEFT_WINDOW = int(FitFlag.LEFT_WINDOW)
_SIGMA = RESULT_COLUMNS.index("sigma_px")


@kernel
def list_neighbours(candidates: NDArray[np.int32], reach: int, near: NDArray[np.int32]) -> None:
    """List the other candidates of the frame within reach of each along both axes.

    Parameters
    ----------
    candidates
        (n, 3) frame, row, column; sorted.
    reach
        Pixels.
    near
        (n, MOST_NEIGHBOURS) of -1; receives indices of candidates, the nearest first and those
        of equal distance in their order. The farthest are left out where there are too many.
    """
    n, places = near.shape
    distances = np.empty(places, np.int64)
    for k in range(n):
        held = 0
        for direction in (-1, 1):
            other = k + direction
            while (
                0 <= other < n
                and candidates[other, 0] == candidates[k, 0]
                and abs(candidates[other, 1] - candidates[k, 1]) <= reach
            ):
                rows = candidates[other, 1] - candidates[k, 1]
                columns = candidates[other, 2] - candidates[k, 2]
                if abs(columns) <= reach:
                    distance = rows * rows + columns * columns
                    place = held
                    while place > 0 and (
                        distance < distances[place - 1]
                        or (distance == distances[place - 1] and other < near[k, place - 1])
                    ):
                        place -= 1
                    held = min(held + 1, places)
                    for behind in range(held - 1, place, -1):
                        near[k, behind] = near[k, behind - 1]
                        distances[behind] = distances[behind - 1]
                    if place < places:
                        near[k, place] = other
                        distances[place] = distance
                other += direction


@kernel
def drop_repeated(
    owners: NDArray[np.intp],
    candidates: NDArray[np.int32],
    near: NDArray[np.int32],
    rows: NDArray[np.float64],
    flags: NDArray[np.int32],
) -> None:
    """Flag the rows that stand for an emitter that a neighbour's row tells better.

    Of two rows of neighbours closer than separate emitters can be, the one farther from its own
    candidate goes, of equals the later one.

    Parameters
    ----------
    owners
        (m,) candidate of each row; ascending.
    candidates, near
        (n, 3) and (n, MOST_NEIGHBOURS), see :func:`list_neighbours`.
    rows
        (10, m) RESULT_COLUMNS, positions relative to the owner's pixel.
    flags
        (m,) bits of FitFlag; LEFT_WINDOW is set for rows to drop.
    """
    m = owners.shape[0]
    for first in range(m):
        k = owners[first]
        if near[k, 0] < 0 or flags[first] & _FAILED:
            continue
        for other in near[k]:
            if other < k:
                continue
            second = first + 1
            while second < m and owners[second] < other:
                second += 1
            while second < m and owners[second] == other:
                dx = rows[0, second] - rows[0, first] + candidates[other, 2] - candidates[k, 2]
                dy = rows[1, second] - rows[1, first] + candidates[other, 1] - candidates[k, 1]
                apart = SMALLEST_SEPARATION * min(rows[_SIGMA, first], rows[_SIGMA, second])
                if not flags[second] & _FAILED and dx * dx + dy * dy < apart * apart:
                    own = rows[0, first] ** 2 + rows[1, first] ** 2
                    others = rows[0, second] ** 2 + rows[1, second] ** 2
                    if own > others:
                        flags[first] = flags[first] | _LEFT_WINDOW
                    else:
                        flags[second] = flags[second] | _LEFT_WINDOW
                second += 1
