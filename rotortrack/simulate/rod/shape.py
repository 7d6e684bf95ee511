"""What a bent rod looks like from above, from the cis side: S, its mirror image, U or loop."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHAPES: Final = ("straight", "S", "mirrored_S", "U", "loop")

_BENT_RAD: Final = 0.3
"""A rod that turns by less than this in each half is straight."""

_BALANCED: Final = 0.25
"""The weaker turn of an S has at least this part of the stronger one."""

_LOOP_RAD: Final = 1.5 * math.pi
"""A rod that turns by more than this one way is a loop, even where it does not cross itself."""


def turns_rad(x: Array) -> tuple[float, float]:
    """Angles by which the rod, seen from above, turns in its first and second half.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).

    Returns
    -------
    first, second
        Counter-clockwise positive, whichever end one starts from: reversing the rod swaps them
        and their signs.
    """
    edges = np.diff(x[:, :2], axis=0)
    cross = edges[:-1, 0] * edges[1:, 1] - edges[:-1, 1] * edges[1:, 0]
    along = np.sum(edges[:-1] * edges[1:], axis=1)
    joints = np.arctan2(cross, along)
    half = joints.size // 2
    middle = float(joints[half]) / 2.0 if joints.size % 2 else 0.0
    return float(joints[:half].sum()) + middle, float(joints[-half:].sum()) + middle


def crosses_itself(x: Array) -> bool:
    """Whether two segments cross as seen from above."""
    start, stop = x[:-1, :2], x[1:, :2]
    first, second = np.triu_indices(len(start), 2)
    sides = [
        _side(start[first], stop[first], start[second]),
        _side(start[first], stop[first], stop[second]),
        _side(start[second], stop[second], start[first]),
        _side(start[second], stop[second], stop[first]),
    ]
    return bool(np.any((sides[0] * sides[1] < 0.0) & (sides[2] * sides[3] < 0.0)))


def shape_class(x: Array) -> str:
    """Name the shape that a rod has seen from the cis side.

    Returns
    -------
    str
        One of ``SHAPES``: ``loop`` where it crosses itself or turns by more than 270 degrees one
        way; ``S`` where it turns left first and right after, from either end, ``mirrored_S`` the
        other way round, each turn at least a quarter of the other; ``straight`` where neither half
        turns by 0.3 rad; ``U`` otherwise.
    """
    first, second = turns_rad(x)
    if crosses_itself(x) or abs(first + second) > _LOOP_RAD:
        return "loop"
    weaker, stronger = sorted((abs(first), abs(second)))
    if stronger < _BENT_RAD:
        return "straight"
    if first * second < 0.0 and weaker >= _BALANCED * stronger:
        return "S" if first > 0.0 else "mirrored_S"
    return "U"


def chirality(x: Array) -> float:
    """Mean of -(t . e_r)(t . e_phi) along the rod: how far a flow from the axis turns it.

    A flow away from the pore drives the rod counter-clockwise seen from cis where it is positive,
    since drag across the rod is greater than along it. It changes sign in a mirror, and neither by
    turning the rod about the axis nor by reversing it.
    """
    edges = np.diff(x, axis=0)
    length = np.linalg.norm(edges, axis=1)
    middle = (x[1:, :2] + x[:-1, :2]) / 2.0
    distance = np.hypot(*middle.T)
    safe = np.where(distance > 0.0, distance, 1.0)[:, np.newaxis]
    outward = middle / safe
    around = np.stack((-outward[:, 1], outward[:, 0]), axis=1)
    tangent = edges[:, :2] / length[:, np.newaxis]
    product = np.sum(tangent * outward, axis=1) * np.sum(tangent * around, axis=1)
    return float(-np.sum(product * length) / np.sum(length))


def _side(start: Array, stop: Array, point: Array) -> Array:
    along, to = stop - start, point - start
    return np.asarray(along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0], np.float64)
