"""The Airy pattern of an ideal objective, integrated over pixels.

The pattern is tabulated as the light below and left of each point of a fine grid, from which the
light in any rectangle follows by four values: so no light is lost or counted twice, wherever the
spot stands between pixels. Between grid points the table is interpolated by cubic splines.

The pattern's rings reach far: beyond `REACH_NM` of the middle lie 2 to 3 % of the light. Spots are
drawn up to the last dark ring before and the light beyond is given to what is drawn.
"""

from __future__ import annotations

import functools
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, special

from rotortrack.kernels import kernel

Floats = NDArray[np.float64]

REACH_NM: Final = 2000.0
"""How far a spot is drawn at most."""

STEPS: Final = 16
"""Grid points a pixel."""

_MOST_RINGS: Final = 60
_PADDING: Final = 2 * STEPS
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


def airy_pattern(distance_nm: Floats, wavelength_nm: float, numerical_aperture: float) -> Floats:
    """Give the light at some distances from the middle, 1 in all: (k / (4 pi)) (2 J1(v) / v)^2.

    v = 2 pi NA r / wavelength and k = (2 pi NA / wavelength)^2.

    Parameters
    ----------
    distance_nm
        Distances, nm.
    wavelength_nm, numerical_aperture
        Of the light and the objective.

    Returns
    -------
    Light a nm^2.
    """
    scale = 2.0 * math.pi * numerical_aperture / wavelength_nm
    v = np.maximum(scale * distance_nm, 1e-6)
    light: Floats = scale**2 / (4.0 * math.pi) * (2.0 * special.j1(v) / v) ** 2
    return light


@functools.lru_cache(maxsize=8)
def airy_table(wavelength_nm: float, numerical_aperture: float, pixel_size_nm: float) -> Floats:
    """Tabulate the light below and left of the points of a grid.

    Parameters
    ----------
    wavelength_nm, numerical_aperture, pixel_size_nm
        Of the light, the objective and the camera.

    Returns
    -------
    Spline coefficients of a square grid of `STEPS` points a pixel with the spot's middle at its
    centre. Not to be changed.
    """
    pixels = math.ceil(REACH_NM / pixel_size_nm)
    step_nm = pixel_size_nm / STEPS
    m = pixels * STEPS
    # The cells of one quarter; the others are its mirror images.
    corner = (np.arange(m) * step_nm)[:, np.newaxis] + (_NODES + 1.0) / 2.0 * step_nm
    at = corner.ravel()
    distance_nm = np.hypot(at[:, np.newaxis], at)
    rings = special.jn_zeros(1, _MOST_RINGS) / (2.0 * math.pi * numerical_aperture / wavelength_nm)
    # Where it is dark the pattern ends without a step.
    last = rings[rings <= REACH_NM].max(initial=rings[0])
    light = airy_pattern(distance_nm, wavelength_nm, numerical_aperture) * (distance_nm < last)
    weights = np.tile(_WEIGHTS / 2.0 * step_nm, m)
    weighted = (light * weights * weights[:, np.newaxis]).reshape(m, 3, m, 3).sum(axis=(1, 3))
    cells = np.concatenate([weighted[::-1], weighted])
    cells = np.concatenate([cells[:, ::-1], cells], axis=1)
    below = np.zeros((2 * m + 1, 2 * m + 1))
    below[1:, 1:] = np.cumsum(np.cumsum(cells, axis=0), axis=1)
    below /= below[-1, -1]
    # Corners of the outermost pixels lie outside the grid, where nothing is added any more.
    below = np.pad(below, _PADDING, mode="edge")
    table = np.ascontiguousarray(ndimage.spline_filter(below, order=3, mode="mirror"))
    table.flags.writeable = False
    return table


@kernel
def add_tabulated(
    images: Floats, x_px: Floats, y_px: Floats, photons: Floats, table: Floats, steps: int
) -> None:
    """Add an emitter whose point spread function is tabulated.

    Parameters
    ----------
    images
        Photons, shape (n, h, w).
    x_px, y_px
        Places, shape (n, parts) or (1, parts), pixels from the outer corner of pixel (0, 0).
    photons
        Photons a frame, shape (n,) or (1,).
    table, steps
        Of :func:`airy_table`; grid points a pixel.
    """
    n, height, width = images.shape
    parts = x_px.shape[1]
    size = table.shape[0]
    reach = (size - 1) // (2 * steps) - 2
    edges = 2 * reach + 2
    light_below = np.zeros((edges, edges))
    for frame in range(n):
        light = photons[frame if photons.shape[0] > 1 else 0] / parts
        if light == 0.0:
            continue
        place = frame if x_px.shape[0] > 1 else 0
        for part in range(parts):
            x, y = x_px[place, part], y_px[place, part]
            left, top = math.floor(x) - reach, math.floor(y) - reach
            if left >= width or top >= height or left + edges <= 0 or top + edges <= 0:
                continue
            fill_below(light_below, (left - x) * steps, (top - y) * steps, table, steps)
            for i in range(max(0, -top), min(edges - 1, height - top)):
                for j in range(max(0, -left), min(edges - 1, width - left)):
                    inside = (
                        light_below[i + 1, j + 1]
                        - light_below[i, j + 1]
                        - light_below[i + 1, j]
                        + light_below[i, j]
                    )
                    # The spline swings below nothing in dark rings, by 3e-10 of the light.
                    images[frame, top + i, left + j] += light * max(inside, 0.0)


@kernel
def fill_below(
    light_below: Floats, first_x: float, first_y: float, table: Floats, steps: int
) -> None:
    """Fill the light below and left of the corners of pixels.

    Parameters
    ----------
    light_below
        Filled, shape (corners, corners), rows first.
    first_x, first_y
        First corner from the spot's middle, in steps of the grid.
    table, steps
        Of :func:`airy_table`; grid points a pixel.
    """
    size = table.shape[0]
    middle = (size - 1) // 2
    base_x, base_y = math.floor(first_x), math.floor(first_y)
    weights_x, weights_y = np.empty(4), np.empty(4)
    spline_weights(first_x - base_x, weights_x)
    spline_weights(first_y - base_y, weights_y)
    for i in range(light_below.shape[0]):
        row = base_y + middle + i * steps
        for j in range(light_below.shape[1]):
            column = base_x + middle + j * steps
            value = 0.0
            for a in range(4):
                at_row = min(max(row - 1 + a, 0), size - 1)
                line = 0.0
                for b in range(4):
                    line += weights_x[b] * table[at_row, min(max(column - 1 + b, 0), size - 1)]
                value += weights_y[a] * line
            light_below[i, j] = value


@kernel
def spline_weights(part: float, weights: Floats) -> None:
    """Fill the four weights of a cubic B-spline at a part of the way between two points."""
    rest = 1.0 - part
    weights[0] = rest * rest * rest / 6.0
    weights[1] = (4.0 - 6.0 * part * part + 3.0 * part * part * part) / 6.0
    weights[2] = (4.0 - 6.0 * rest * rest + 3.0 * rest * rest * rest) / 6.0
    weights[3] = part * part * part / 6.0
