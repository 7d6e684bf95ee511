"""Where to put the numbers of many points so that no two overlap."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from rotortrack.report.figures.canvas import Floats

LABEL_SIZE = 6.0
_CHARACTER = 0.70 * LABEL_SIZE
_HEIGHT = 1.10 * LABEL_SIZE
"""Size of a digit in points, halo and spacing included (DejaVu Sans: 0.64 by 0.73 em)."""

Anchor = tuple[float, float]


def points_per_unit(x: Floats, y: Floats, labels: list[str], resolved: float) -> float:
    """Return the least scale (points per unit of x and y) that keeps resolved labels apart.

    Two labels beside their points are clear when they differ by a label's width across or by its
    height down; the answer is the largest scale that any pair at least `resolved` apart needs.
    Pairs farther than 25 times that distance never set it on a page of useful size.
    """
    if len(x) < 2:
        return 0.0
    pairs = cKDTree(np.stack([x, y], axis=1)).query_pairs(2.5 * resolved, output_type="ndarray")
    across = np.abs(x[pairs[:, 0]] - x[pairs[:, 1]])
    down = np.abs(y[pairs[:, 0]] - y[pairs[:, 1]])
    far = np.hypot(across, down) >= resolved * (1 - 1e-9)
    if not far.any():
        return 0.0
    widths = np.array([_CHARACTER * len(label) + 1.0 for label in labels])
    width = (widths[pairs[far, 0]] + widths[pairs[far, 1]]) / 2
    with np.errstate(divide="ignore"):
        needed = np.minimum(width / across[far], _HEIGHT / down[far])
    return float(needed.max())


def place_labels(x: Floats, y: Floats, labels: list[str], gap: float) -> list[Anchor | None]:
    """Choose the middle of each label, relative to its point; None where there is no room.

    Each label first takes the place right of its point; those that then overlap try the seven
    other sides in turn.

    Parameters
    ----------
    x, y
        Points on the page (points, y down).
    labels
        Their texts.
    gap
        Clear distance from a point to its label (points).
    """
    widths = [_CHARACTER * len(label) + 1.0 for label in labels]
    boxes = _Boxes()
    chosen: list[Anchor | None] = [None] * len(labels)
    for i, width in enumerate(widths):
        aside, above = gap + width / 2, gap + _HEIGHT / 2
        sides = (
            (aside, 0.0), (-aside, 0.0), (0.0, -above), (0.0, above),
            (aside, -above), (aside, above), (-aside, -above), (-aside, above),
        )  # fmt: skip
        for across, down in sides:
            if boxes.claim(float(x[i]) + across, float(y[i]) + down, width):
                chosen[i] = (across, down)
                break
    return chosen


class _Boxes:
    """Claimed label boxes in a hash grid, so that each claim looks at its neighbours alone."""

    def __init__(self) -> None:
        self._cells: dict[tuple[int, int], list[tuple[float, float, float]]] = {}
        self._cell = 10 * _CHARACTER

    def claim(self, x: float, y: float, width: float) -> bool:
        """Take the box with this middle unless it overlaps one that is taken."""
        column, row = int(x // self._cell), int(y // self._cell)
        for i in (column - 1, column, column + 1):
            for j in (row - 1, row, row + 1):
                for other_x, other_y, other_width in self._cells.get((i, j), ()):
                    clear_across = abs(x - other_x) >= (width + other_width) / 2
                    if not clear_across and abs(y - other_y) < _HEIGHT:
                        return False
        self._cells.setdefault((column, row), []).append((x, y, width))
        return True
