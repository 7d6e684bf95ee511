"""Images of an atomic force microscope, made of rods that are known.

A tip dilates what it touches: a rod appears as the height h exp(-r^2 / (2 s^2)) at the distance r
from its spine, beyond its ends as beside it. The spine of a rod of length L and diameter d with
rounded ends is L - d long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]

_STEP_NM = 0.5
_TRIES = 400


@dataclass(frozen=True, kw_only=True)
class Microscope:
    """How an image comes out.

    Attributes
    ----------
    shape
        Rows and columns.
    pixel_size_nm
        Size of a pixel (nm).
    width_nm
        Width of a rod in the image at half its height (nm).
    noise_nm
        Standard deviation of a pixel's height (nm).
    line_offset_nm
        Standard deviation of the offsets of scan lines (nm).
    tilt_nm_um
        Slope of the sample along x and y (nm per um).
    """

    shape: tuple[int, int] = (512, 512)
    pixel_size_nm: float = 5.0
    width_nm: float = 18.0
    noise_nm: float = 0.1
    line_offset_nm: float = 0.4
    tilt_nm_um: tuple[float, float] = (3.0, -2.0)


def worm_like_chain(rng: np.random.Generator, length_nm: float, persistence_nm: float) -> Floats:
    """Draw a chain that equilibrated in the plane, (n, 2) in nm, its middle at (0, 0).

    Its direction diffuses along it: <(d theta)^2> = s / P, so <cos d theta> = exp(-s / (2 P)).
    """
    steps = max(math.ceil(length_nm / _STEP_NM), 2)
    step_nm = length_nm / steps
    turns = rng.normal(0.0, math.sqrt(step_nm / persistence_nm), steps - 1)
    angle = np.concatenate([[rng.uniform(0.0, 2.0 * math.pi)], turns]).cumsum()
    moved = step_nm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    path = np.concatenate([np.zeros((1, 2)), moved.cumsum(axis=0)])
    return np.asarray(path - path[len(path) // 2])


def scatter_rods(
    rng: np.random.Generator,
    count: int,
    microscope: Microscope,
    *,
    contour_nm: float,
    persistence_nm: float,
    diameter_nm: float = 6.0,
    gap_nm: float = 70.0,
) -> list[Floats]:
    """Lay rods at random that keep apart from each other and from the border.

    Returns
    -------
    list of array
        Spines (n, 2) in nm; fewer than `count` where there is no room.
    """
    rows, columns = microscope.shape
    field_nm = microscope.pixel_size_nm * np.array([columns, rows])
    laid: list[Floats] = []
    for _ in range(_TRIES * count):
        if len(laid) == count:
            break
        path = worm_like_chain(rng, contour_nm - diameter_nm, persistence_nm)
        path = path + rng.uniform(0.0, field_nm)
        inside = bool((path > gap_nm).all() and (path < field_nm - gap_nm).all())
        thinned = path[::8]
        if inside and all(_distances(one[::8], thinned).min() > gap_nm for one in laid):
            laid.append(path)
    return laid


def image_rods(
    rng: np.random.Generator,
    microscope: Microscope,
    spines: Sequence[Floats],
    *,
    height_nm: float | Sequence[float] = 2.0,
    debris: Sequence[tuple[float, float, float, float]] = (),
) -> Floats:
    """Take an image of rods.

    Parameters
    ----------
    rng
        Noise and offsets of lines.
    microscope
        The microscope.
    spines
        One (n, 2) array a rod (nm).
    height_nm
        Height of all rods, or of each (nm). Where two cross, heights add.
    debris
        x, y, height and width at half height (nm) of round things.

    Returns
    -------
    Floats
        Heights (nm) of the microscope's shape.
    """
    rows, columns = microscope.shape
    size_nm = microscope.pixel_size_nm
    image = np.zeros(microscope.shape)
    heights = np.broadcast_to(height_nm, (len(spines),))
    # A spot of debris is a rod of one point.
    things = [
        *((spine, float(h), microscope.width_nm) for spine, h in zip(spines, heights, strict=True)),
        *((np.array([[x, y]]), h, width) for x, y, h, width in debris),
    ]
    for points, height, width_nm in things:
        sigma_nm = width_nm / math.sqrt(8.0 * math.log(2.0))
        low = np.floor((points.min(axis=0) - 5.0 * sigma_nm) / size_nm).astype(int)
        high = np.ceil((points.max(axis=0) + 5.0 * sigma_nm) / size_nm).astype(int)
        (left, top), (right, bottom) = np.maximum(low, 0), np.minimum(high, [columns, rows])
        if right <= left or bottom <= top:
            continue
        y, x = np.mgrid[top:bottom, left:right]
        pixels = size_nm * (np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
        distance = _distances(points, pixels).reshape(x.shape)
        image[top:bottom, left:right] += height * np.exp(-((distance / sigma_nm) ** 2) / 2.0)
    x_um, y_um = (1e-3 * size_nm * np.arange(n) for n in (columns, rows))
    image += microscope.tilt_nm_um[0] * x_um + microscope.tilt_nm_um[1] * y_um[:, None]
    image += rng.normal(0.0, 1.0, (rows, 1)) * microscope.line_offset_nm
    return image + rng.normal(0.0, 1.0, microscope.shape) * microscope.noise_nm


def _distances(points: Floats, of: Floats) -> Floats:
    """Distance of each of some places to the nearest of the points."""
    return np.asarray(cKDTree(points).query(of)[0])
