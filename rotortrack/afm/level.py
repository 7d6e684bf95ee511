"""Levelling of scan lines that rods, which only ever rise above the ground, do not pull along."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Floats = NDArray[np.float64]

_PASSES = 5
_RAISED_SD = 3.0
_QUANTILE, _REWEIGHTED = 0.25, 12
_LOW = 0.1
_LEAST_SHARE, _LEAST_PIXELS = 0.3, 4
_BENT_ALIKE = 31
"""Rows over which slope and bow are taken for alike: several times what a rod along them covers."""

_PER_SD = 1.4826


def level_lines(height_nm: Floats, *, order: int, grown_px: int) -> tuple[Floats, float]:
    """Take a plane off an image, and a polynomial off each row, both of the bare ground alone.

    The offset is each row's own. Its slope and bow are the median over the rows around: scanners
    change them slowly, and a rod along a row must not be taken for a slope. At first the polynomial
    follows the lower part of a row, which rods leave free unless they cover nearly all of it. Then
    what is raised by three standard deviations, and its surroundings, no longer counts. A row with
    hardly any bare ground takes its offset from the rows around it.

    Parameters
    ----------
    height_nm
        Heights, rows being scan lines.
    order
        Order of the polynomials.
    grown_px
        How far the surroundings of a raised pixel reach: about the width of a rod (pixels).

    Returns
    -------
    Floats, float
        Heights above the ground, and the standard deviation of a pixel of bare ground (nm).
    """
    powers = np.linspace(-1.0, 1.0, height_nm.shape[1])[:, None] ** np.arange(order + 1)
    flat = height_nm - _plane(height_nm)
    noise = _noise_of(flat)
    flat = flat - np.median(flat, axis=1, keepdims=True)
    flat = flat - _alike(_quantile_fits(flat, powers, noise)) @ powers.T
    flat = flat - np.quantile(flat, _LOW, axis=1, keepdims=True)
    flat -= float(np.median(flat))
    for _ in range(_PASSES):
        # Smoothing along the row tells rods that single pixels hide in their noise.
        smooth = ndimage.uniform_filter1d(flat, 3, axis=1)
        raised = (smooth > _RAISED_SD * noise) | (flat > 5.0 * noise)
        ground = ~ndimage.binary_dilation(raised, iterations=max(grown_px, 1))
        flat = flat - _row_polynomials(flat, ground, powers)
        if np.count_nonzero(ground) > 100:
            noise = _spread(flat[ground])
    return flat, noise


def _plane(height: Floats) -> Floats:
    """Fit a plane by the medians of differences, which few edges of rods do not move."""
    rows, columns = height.shape
    slope_x = float(np.median(np.diff(height, axis=1)))
    slope_y = float(np.median(np.diff(height, axis=0)))
    plane = slope_x * np.arange(columns) + slope_y * np.arange(rows)[:, None]
    return np.asarray(plane + np.median(height - plane))


def _noise_of(flat: Floats) -> float:
    """Estimate the noise of a pixel from differences along the rows."""
    difference = np.diff(flat, axis=1)
    return float(_PER_SD * np.median(np.abs(difference)) / np.sqrt(2.0)) or 1e-12


def _spread(values: Floats) -> float:
    return float(_PER_SD * np.median(np.abs(values - np.median(values)))) or 1e-12


def _fits(weight: Floats, values: Floats, powers: Floats) -> Floats:
    """Fit polynomials (rows, terms) by weighted least squares."""
    normal = np.einsum("rc,ci,cj->rij", weight, powers, powers, optimize=True)
    # A whisker of ridge keeps rows without any weight solvable.
    scale = normal[:, :1, :1] + 1e-12
    normal = normal / scale + 1e-9 * np.eye(powers.shape[1])
    right = np.einsum("rc,ci->ri", weight * values, powers, optimize=True) / scale[:, 0]
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])


def _quantile_fits(flat: Floats, powers: Floats, noise: float) -> Floats:
    """Fit the lower quartile of each row: absolute deviations, dearer below than above."""
    found = np.zeros((len(flat), powers.shape[1]))
    for _ in range(_REWEIGHTED):
        off = flat - found @ powers.T
        weight = np.where(off > 0.0, _QUANTILE, 1.0 - _QUANTILE) / np.maximum(np.abs(off), noise)
        found = _fits(weight, flat, powers)
    return found


def _alike(terms: Floats) -> Floats:
    """Give rows the median slope and bow of those around them; offsets stay."""
    size = min(_BENT_ALIKE, len(terms))
    bent = ndimage.median_filter(terms, size=(size, 1), mode="nearest")
    return np.concatenate([terms[:, :1], bent[:, 1:]], axis=1)


def _row_polynomials(flat: Floats, ground: NDArray[np.bool_], powers: Floats) -> Floats:
    """Fit a polynomial to the bare ground of each row."""
    weight = ground.astype(np.float64)
    found = _fits(weight, flat, powers)
    third = max(powers.shape[0] // 3, 1)
    bent = ground[:, :third].any(axis=1) & ground[:, -third:].any(axis=1)
    bent &= ground.mean(axis=1) >= _LEAST_SHARE
    for term in range(1, powers.shape[1]):
        found[:, term] = _filled(found[:, term], bent)
    found = _alike(found)
    left = weight * (flat - found[:, 1:] @ powers[:, 1:].T)
    count = weight.sum(axis=1)
    found[:, 0] = _filled(left.sum(axis=1) / np.maximum(count, 1.0), count >= _LEAST_PIXELS)
    return np.asarray(found @ powers.T)


def _filled(values: Floats, known: NDArray[np.bool_]) -> Floats:
    """Take from the rows around what a row does not tell."""
    if not known.any():
        return values
    rows = np.arange(len(values))
    return np.asarray(np.where(known, values, np.interp(rows, rows[known], values[known])))
