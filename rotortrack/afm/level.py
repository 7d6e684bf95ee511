"""Levelling of scan lines that rods, which only ever rise above the ground, do not pull along."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Floats = NDArray[np.float64]

_PASSES = 4
_RAISED_SD = 3.0
_LEAST_SHARE = 0.15
_PER_SD = 1.4826


def level_lines(height_nm: Floats, *, order: int, grown_px: int) -> tuple[Floats, float]:
    """Take a plane off an image, and a polynomial off each row, both of the bare ground alone.

    The first offset of a row is its lower quartile, which a rod along the row does not reach. Then
    what is raised by three standard deviations, and its surroundings, no longer counts. A row with
    too little bare ground takes the mean of the polynomials of the rows around it.

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
    rows, columns = height_nm.shape
    x, y = np.linspace(-1.0, 1.0, columns), np.linspace(-1.0, 1.0, rows)
    flat = height_nm - _plane(height_nm, x, y)
    flat = flat - np.quantile(flat, 0.25, axis=1, keepdims=True)
    noise = _noise_of(flat)
    powers = np.stack([x**power for power in range(order + 1)], axis=1)
    for _ in range(_PASSES):
        # Smoothing along the row tells rods that single pixels hide in their noise.
        smooth = ndimage.uniform_filter1d(flat, 3, axis=1)
        raised = (smooth - np.median(smooth) > _RAISED_SD * noise) | (flat > 5.0 * noise)
        ground = ~ndimage.binary_dilation(raised, iterations=max(grown_px, 1))
        flat = flat - _row_polynomials(flat, ground, powers)
        if np.count_nonzero(ground) > 100:
            noise = _spread(flat[ground])
    return flat, noise


def _plane(height: Floats, x: Floats, y: Floats) -> Floats:
    """Fit a plane by the medians of differences, which few edges of rods do not move."""
    slope_x = np.median(np.diff(height, axis=1)) if len(x) > 1 else 0.0
    slope_y = np.median(np.diff(height, axis=0)) if len(y) > 1 else 0.0
    across = slope_x * np.arange(len(x)) + slope_y * np.arange(len(y))[:, None]
    return np.asarray(across + np.median(height - across))


def _noise_of(flat: Floats) -> float:
    """Estimate the noise of a pixel from differences along the rows."""
    difference = np.diff(flat, axis=1)
    return float(_PER_SD * np.median(np.abs(difference)) / np.sqrt(2.0)) or 1e-12


def _spread(values: Floats) -> float:
    return float(_PER_SD * np.median(np.abs(values - np.median(values)))) or 1e-12


def _row_polynomials(flat: Floats, ground: NDArray[np.bool_], powers: Floats) -> Floats:
    """Fit a polynomial to the bare ground of each row."""
    columns, terms = powers.shape
    weight = ground.astype(np.float64)
    normal = np.einsum("rc,ci,cj->rij", weight, powers, powers)
    # A whisker of ridge keeps rows without any ground solvable; they are replaced below.
    normal += 1e-9 * columns * np.eye(terms)
    right = np.einsum("rc,ci->ri", weight * flat, powers)
    found = np.linalg.solve(normal, right[..., None])[..., 0]
    trusted = _is_trusted(ground, powers)
    if trusted.any() and not trusted.all():
        rows = np.arange(len(found))
        for term in range(terms):
            found[~trusted, term] = np.interp(rows[~trusted], rows[trusted], found[trusted, term])
    return np.asarray(found @ powers.T)


def _is_trusted(ground: NDArray[np.bool_], powers: Floats) -> NDArray[np.bool_]:
    """Whether a row has ground enough, and on both sides when a slope is asked for."""
    third = max(powers.shape[0] // 3, 1)
    enough = ground.mean(axis=1) >= _LEAST_SHARE
    if powers.shape[1] == 1:
        return np.asarray(enough)
    both = ground[:, :third].any(axis=1) & ground[:, -third:].any(axis=1)
    return np.asarray(enough & both)
