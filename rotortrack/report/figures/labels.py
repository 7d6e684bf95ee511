"""Where to put the numbers of many points so that no two overlap."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from rotortrack.report.figures.canvas import Floats

LABEL_SIZE = 6.0
MARK_SIZE = 9.0
"""Size of a digit's font and largest size of a point's marker (points)."""

_CHARACTER = 0.70 * LABEL_SIZE
_HEIGHT = 1.10 * LABEL_SIZE
"""Room of a digit in points, halo and spacing included (DejaVu Sans: 0.64 by 0.73 em)."""

Anchor = tuple[float, float]
Box = tuple[float, float, float, float]
"""Middle x and y, width, height in points."""


def points_per_unit(x: Floats, y: Floats, labels: list[str], resolved: float) -> float:
    """Return the least scale (points per unit of x and y) that keeps resolved labels apart.

    A label beside its point is clear of the next point's label and marker when they differ by
    both widths across or by a label's height down; the answer is the largest scale that any pair
    at least `resolved` apart needs. Pairs beyond 2.5 times that distance need less than nearer
    ones do.
    """
    if len(x) < 2:
        return 0.0
    pairs = cKDTree(np.stack([x, y], axis=1)).query_pairs(2.5 * resolved, output_type="ndarray")
    across = np.abs(x[pairs[:, 0]] - x[pairs[:, 1]])
    down = np.abs(y[pairs[:, 0]] - y[pairs[:, 1]])
    far = np.hypot(across, down) >= resolved * (1 - 1e-9)
    if not far.any():
        return 0.0
    widths = np.array([_width(label) for label in labels])
    width = (widths[pairs[far, 0]] + widths[pairs[far, 1]]) / 2 + MARK_SIZE + 2.0
    with np.errstate(divide="ignore"):
        needed = np.minimum(width / across[far], _HEIGHT / down[far])
    return float(needed.max())


def place_labels(
    x: Floats, y: Floats, labels: list[str], *, mark: float, page: tuple[float, float]
) -> list[Anchor | None]:
    """Choose the middle of each label, relative to its point; None where there is no room.

    Of eight sides, right first, a label takes the first that is clear of all markers, the labels
    before it and the page's edge; failing that, the first that is clear of labels.

    Parameters
    ----------
    x, y
        Points on the page (points, y down, from its upper left corner).
    labels
        Their texts.
    mark
        Size of the points' markers (points).
    page
        Width and height of the page (points).
    """
    marks, taken = _Boxes(), _Boxes()
    for i in range(len(labels)):
        marks.add((float(x[i]), float(y[i]), mark, mark))
    chosen: list[Anchor | None] = []
    for i, label in enumerate(labels):
        width = _width(label)
        aside, above = mark / 2 + 1 + width / 2, mark / 2 + 0.5 + _HEIGHT / 2
        sides = (
            (aside, 0.0), (-aside, 0.0), (0.0, -above), (0.0, above),
            (aside, -above), (aside, above), (-aside, -above), (-aside, above),
        )  # fmt: skip
        boxes = [(float(x[i]) + dx, float(y[i]) + dy, width, _HEIGHT) for dx, dy in sides]
        free = [k for k in range(len(sides)) if taken.clear(boxes[k])]
        best = [k for k in free if marks.clear(boxes[k]) and _inside(boxes[k], page)]
        place = next(iter(best or free), None)
        if place is not None:
            taken.add(boxes[place])
        chosen.append(None if place is None else sides[place])
    return chosen


def _width(label: str) -> float:
    return _CHARACTER * len(label) + 1.0


def _inside(box: Box, page: tuple[float, float]) -> bool:
    x, y, width, height = box
    across = width / 2 <= x <= page[0] - width / 2
    return across and height / 2 <= y <= page[1] - height / 2


class _Boxes:
    """Boxes in a hash grid, so that each question looks at a box's neighbours alone."""

    _CELL = 60.0
    """At least the widest box: labels of up to 14 characters."""

    def __init__(self) -> None:
        self._cells: dict[tuple[int, int], list[Box]] = {}

    def _cell(self, box: Box) -> tuple[int, int]:
        return int(box[0] // self._CELL), int(box[1] // self._CELL)

    def add(self, box: Box) -> None:
        """Put a box into the grid."""
        self._cells.setdefault(self._cell(box), []).append(box)

    def clear(self, box: Box) -> bool:
        """Whether a box touches none of the grid's."""
        column, row = self._cell(box)
        x, y, width, height = box
        return not any(
            abs(x - other[0]) < (width + other[2]) / 2
            and abs(y - other[1]) < (height + other[3]) / 2
            for i in (column - 1, column, column + 1)
            for j in (row - 1, row, row + 1)
            for other in self._cells.get((i, j), ())
        )
