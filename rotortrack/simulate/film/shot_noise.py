"""Poisson numbers, exact in law, for the many pixels of a frame whose means are small.

A Poisson number of mean m is the sum of one of mean floor(m), looked up in a table, and one of the
mean that remains, found by inversion. Where m is above the table numpy draws it.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtr

from rotortrack.kernels import kernel

Floats = NDArray[np.float64]

LARGEST_MEAN = 64
"""Means of the table: 0, 1, ... up to this."""

_GUIDES = 256
"""Equal parts of [0, 1) for each of which the table tells where to begin the search."""


def draw_electrons(photons: Floats, rng: np.random.Generator, electrons: Floats) -> None:
    """Draw a Poisson number for every pixel of a frame.

    Parameters
    ----------
    photons
        Means, finite and not negative, shape (h, w), C-contiguous.
    rng
        A uniform number a pixel is drawn, and what numpy needs where means are large.
    electrons
        Filled with the numbers, shape (h, w).

    Raises
    ------
    ValueError
        A mean is negative or not finite.
    """
    uniform = rng.random(photons.shape)
    cumulative, guides = _tables()
    large = small_numbers(photons, uniform, cumulative, guides, electrons)
    if large < 0:
        raise ValueError("expected photons must be finite and not negative")
    if large:
        where = photons >= LARGEST_MEAN
        electrons[where] = rng.poisson(photons[where])


@kernel
def small_numbers(
    means: Floats,
    uniform: Floats,
    cumulative: Floats,
    guides: NDArray[np.int64],
    numbers: Floats,
) -> int:
    """Draw the numbers whose means are in the table.

    Parameters
    ----------
    means, numbers
        Means and results, shape (h, w); results of large means are left alone.
    uniform
        A number in [0, 1) for each, shape (h, w). Where it stands between two values of the table
        is uniform again, and serves for the rest.
    cumulative, guides
        For each whole mean the distribution function, and the least number whose distribution
        function is above each guide.

    Returns
    -------
    How many means are too large for the table, -1 if one is negative or not finite.
    """
    height, width = means.shape
    parts = guides.shape[1]
    large = 0
    for row in range(height):
        for column in range(width):
            mean = means[row, column]
            if not 0.0 <= mean < math.inf:
                return -1
            if mean >= cumulative.shape[0]:
                large += 1
                continue
            whole = int(mean)
            u = uniform[row, column]
            number = guides[whole, int(u * parts)]
            while cumulative[whole, number] <= u:
                number += 1
            rest = mean - whole
            below = cumulative[whole, number - 1] if number > 0 else 0.0
            u = (u - below) / (cumulative[whole, number] - below)
            probability = math.exp(-rest)
            reached = probability
            more = 0
            while reached <= u and probability > 0.0:
                more += 1
                probability *= rest / more
                reached += probability
            numbers[row, column] = number + more
    return large


@functools.cache
def _tables() -> tuple[Floats, NDArray[np.int64]]:
    means = np.arange(LARGEST_MEAN)
    # Above four times the largest mean lies less than 1e-60.
    cumulative = pdtr(np.arange(4 * LARGEST_MEAN), means[:, np.newaxis].astype(np.float64))
    # A uniform number is below 1, so that a search always ends.
    cumulative[:, -1] = 1.0
    starts = np.arange(_GUIDES) / _GUIDES
    guides = np.stack([np.searchsorted(row, starts, side="right") for row in cumulative])
    return np.ascontiguousarray(cumulative), guides.astype(np.int64)
