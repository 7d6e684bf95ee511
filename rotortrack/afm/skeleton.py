"""Skeletons as graphs: single lines, and what is no single line.

A skeleton's pixels are the vertices; orthogonal neighbours are joined, and diagonal ones where no
orthogonal detour exists. An end has one neighbour, a junction three or more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.morphology import skeletonize

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Pixel = tuple[int, int]

_ORTHOGONAL = ((0, 1), (1, 0), (0, -1), (-1, 0))
_DIAGONAL = ((1, 1), (1, -1), (-1, 1), (-1, -1))


@dataclass(frozen=True)
class Piece:
    """A connected part of a skeleton.

    Attributes
    ----------
    lines
        Its branches (n, 2), x and y in pixels, a pixel's middle at one half; one for a single line.
    junctions
        Number of places where branches meet.
    closed
        Whether it is a ring.
    pruned_px
        Lengths of the side branches that were taken off.
    at_border
        Whether its ridge reaches the border of the image.
    """

    lines: list[Floats]
    junctions: int
    closed: bool
    pruned_px: list[float]
    at_border: bool


def pieces_of(mask: Bools, skeleton: Bools, *, max_branch_px: float) -> list[Piece]:
    """Take a skeleton apart into its connected pieces, without short side branches.

    The shortest side branch goes first, so that of a fork at a rod's end the longer arm stays.

    Parameters
    ----------
    mask, skeleton
        Pixels of ridges, and their middle lines.
    max_branch_px
        Branches from an end to a junction up to this length are taken off.
    """
    labels, _ = ndimage.label(mask, np.ones((3, 3)))
    found = []
    for number, where in enumerate(ndimage.find_objects(labels), 1):
        own = skeleton[where] & (labels[where] == number)
        if not own.any():
            continue
        top, left = where[0].start, where[1].start
        stops = (where[0].stop, where[1].stop)
        at_border = top == 0 or left == 0 or stops[0] == mask.shape[0] or stops[1] == mask.shape[1]
        thin, pruned = _prune(np.pad(own, 1), max_branch_px)
        branches = _branches(thin)
        lines = [np.array(branch, float)[:, ::-1] + (left - 0.5, top - 0.5) for branch in branches]
        joined = _neighbours(thin)
        degrees = [len(near) for near in joined.values()]
        junctions = np.zeros_like(thin)
        for pixel, near in joined.items():
            junctions[pixel] = len(near) > 2
        count = int(ndimage.label(junctions, np.ones((3, 3)))[1])
        closed = bool(degrees) and min(degrees) >= 2 and count == 0
        found.append(Piece(lines, count, closed, pruned, at_border))
    return found


def _neighbours(thin: Bools) -> dict[Pixel, list[Pixel]]:
    """Join pixels; the array has an empty margin."""
    joined: dict[Pixel, list[Pixel]] = {}
    for y, x in np.argwhere(thin).tolist():
        near = [(y + dy, x + dx) for dy, dx in _ORTHOGONAL if thin[y + dy, x + dx]]
        near += [
            (y + dy, x + dx)
            for dy, dx in _DIAGONAL
            if thin[y + dy, x + dx] and not thin[y + dy, x] and not thin[y, x + dx]
        ]
        joined[y, x] = near
    return joined


def _walk(joined: dict[Pixel, list[Pixel]], start: Pixel, second: Pixel) -> list[Pixel]:
    """Follow a branch to its other end or junction, or around a ring to its start."""
    path = [start, second]
    while len(joined[path[-1]]) == 2 and path[-1] != start:
        before = path[-2]
        path.append(next(pixel for pixel in joined[path[-1]] if pixel != before))
    return path


def _branches(thin: Bools) -> list[list[Pixel]]:
    """List all branches once: between ends and junctions, and rings."""
    joined = _neighbours(thin)
    nodes = [pixel for pixel, near in joined.items() if len(near) != 2]
    seen: set[tuple[Pixel, Pixel]] = set()
    branches: list[list[Pixel]] = []
    for start in nodes:
        if not joined[start]:
            branches.append([start])
        for second in joined[start]:
            if (start, second) not in seen:
                branches.append(_walk(joined, start, second))
                seen |= {(start, second), (branches[-1][-1], branches[-1][-2])}
    if not nodes and joined:
        start = next(iter(joined))
        branches.append(_walk(joined, start, joined[start][0]))
    return branches


def _length(path: list[Pixel]) -> float:
    return float(np.hypot(*np.diff(np.array(path), axis=0).T).sum()) if len(path) > 1 else 0.0


def _prune(thin: Bools, longest_px: float) -> tuple[Bools, list[float]]:
    """Take off side branches, the shortest first, as long as there is a junction."""
    thin = thin.copy()
    lengths: list[float] = []
    while True:
        joined = _neighbours(thin)
        if all(len(near) < 3 for near in joined.values()):
            return thin, lengths
        sides = [
            _walk(joined, end, near[0])
            for end, near in joined.items()
            if len(near) == 1 and len(joined[near[0]]) > 0
        ]
        sides = [side for side in sides if len(joined[side[-1]]) > 2]
        short = min(sides, key=_length, default=None)
        if short is None or _length(short) > longest_px:
            return thin, lengths
        lengths.append(_length(short))
        for pixel in short[:-1]:
            thin[pixel] = False
        thin = np.asarray(skeletonize(thin), np.bool_)
