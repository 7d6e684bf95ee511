"""Poisson numbers, exact in law, for the many pixels of a frame whose means are small.

A Poisson number of mean m is the sum of one whose mean is the next lower of a table, found by
inversion, and one of the little mean that remains, which is 0 nearly always. Where m is above the
table numpy draws it.
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
"""Means of the table are below this."""

_STEPS = 8
"""Means of the table from one whole number to the next."""

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
        Filled with the numbers, shape (h, w), C-contiguous.

    Raises
    ------
    ValueError
        A mean is negative or not finite.
    """
    # New memory for each frame would cost as much as the draws.
    rng.random(out=electrons)
    cumulative, guides = _tables()
    large = small_numbers(photons, electrons, cumulative, guides, electrons)
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
    guides: NDArray[np.uint8],
    numbers: Floats,
) -> int:
    """Draw the numbers whose means are in the table.

    Parameters
    ----------
    means, numbers
        Means and results, shape (h, w); results of large means are left alone.
    uniform
        A number in [0, 1) for each, shape (h, w); may be the array of the results. Where it stands
        between two values of the table is uniform again, and serves for the rest.
    cumulative, guides
        For each mean of the table the distribution function, and the least number whose
        distribution function is above each guide.

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
            if mean >= LARGEST_MEAN:
                large += 1
                continue
            entry = int(mean * _STEPS)
            u = uniform[row, column]
            number = int(guides[entry, int(u * parts)])
            while cumulative[entry, number] <= u:
                number += 1
            rest = mean - entry / _STEPS
            below = cumulative[entry, number - 1] if number > 0 else 0.0
            share = cumulative[entry, number] - below
            # No more come with probability exp(-rest), which is above 1 - rest.
            if u - below > share * (1.0 - rest):
                number += more_numbers((u - below) / share, rest)
            numbers[row, column] = number
    return large


@kernel
def more_numbers(u: float, mean: float) -> int:
    """Invert the distribution function of a Poisson number of small mean at `u`."""
    probability = math.exp(-mean)
    reached = probability
    number = 0
    while reached <= u and probability > 0.0:
        number += 1
        probability *= mean / number
        reached += probability
    return number


@functools.cache
def _tables() -> tuple[Floats, NDArray[np.uint8]]:
    means = np.arange(LARGEST_MEAN * _STEPS) / _STEPS
    # Above four times the largest mean lies less than 1e-60.
    cumulative = pdtr(np.arange(4 * LARGEST_MEAN), means[:, np.newaxis])
    # A uniform number is below 1, so that a search always ends.
    cumulative[:, -1] = 1.0
    starts = np.arange(_GUIDES) / _GUIDES
    guides = np.stack([np.searchsorted(row, starts, side="right") for row in cumulative])
    return np.ascontiguousarray(cumulative), guides.astype(np.uint8)
