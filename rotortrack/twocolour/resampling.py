"""Distances between groups of rotors: intervals and p-values by resampling whole rotors.

Every rotor is a distribution function on one grid, a row of a matrix. A group's distribution is a
weighted mean of rows, so that thousands of resamples are one product of matrices, whether a rotor
is one number or thousands of frames.

Frames of one rotor are not independent: two groups of 45 rotors from one population differ by a
Kolmogorov-Smirnov test on frames every time. Rotors are therefore drawn, and permuted, whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Size = Callable[[Floats], Floats]

GRID_REFUSED: Final = (
    "a grid of parameters is not a population: declare how probable its cells are with --prior"
)
"""Why there is no p-value against a scan."""

_ROWS: Final = 512
_HALVINGS: Final = 9
_CI: Final = (0.025, 0.975)


@dataclass(frozen=True)
class Curves:
    """Distribution functions of rotors on a common grid.

    Attributes
    ----------
    grid
        Increasing values, shape (points,).
    step
        What each point of the grid stands for in an integral, shape (points,).
    cdf
        Part of each rotor's values up to each point, shape (rotors, points).
    """

    grid: Floats
    step: Floats
    cdf: Floats


@dataclass(frozen=True)
class Interval:
    """A number with an interval of 95 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Effects:
    """How far two distributions are apart.

    Attributes
    ----------
    difference
        Mean of the first less that of the second.
    wasserstein
        Wasserstein-1, int |F - G| dx: how far values must be moved on average.
    energy
        Energy distance 2 E|X - Y| - E|X - X'| - E|Y - Y'| = 2 int (F - G)^2 dx.
    ks
        Kolmogorov and Smirnov's largest |F - G|; a size, not a test.
    """

    difference: Interval
    wasserstein: Interval
    energy: Interval
    ks: Interval


def curves_of_values(values: Floats) -> Curves:
    """Make step functions of one value a rotor, shape (rotors,)."""
    grid = np.unique(values)
    step = np.append(np.diff(grid), 0.0)
    return Curves(grid, step, (values[:, None] <= grid[None, :]).astype(np.float64))


def curves_of_counts(counts: NDArray[np.integer], edges: Floats) -> Curves:
    """Make distribution functions of histograms, (rotors, bins), over bins of one width.

    A bin's values count as spread evenly over it, which changes a distance by less than its width.
    """
    totals = counts.sum(axis=1, keepdims=True)
    cdf = np.cumsum(counts, axis=1) / np.maximum(totals, 1)
    # Trapezia over the edges: the lowest edge has a value of 0 and adds nothing.
    step = np.diff(edges)
    step[-1] *= 0.5
    return Curves(edges[1:], step, cdf)


def gaps(curves: Curves, first: Floats, second: Floats) -> Floats:
    """Give F - G of weighted groups of rotors.

    Parameters
    ----------
    curves
        Of all rotors of both groups.
    first, second
        Weights of the rotors in each group, shape (resamples, rotors); rows need not sum to 1.

    Returns
    -------
    ndarray
        Shape (resamples, points).
    """
    gap: Floats = (_shares(first) - _shares(second)) @ curves.cdf
    return gap


def sizes(curves: Curves) -> dict[str, Size]:
    """Give the distances as functions of gaps, (resamples, points) -> (resamples,)."""
    return {
        "wasserstein": lambda gap: np.abs(gap) @ curves.step,
        "energy": lambda gap: 2.0 * (gap**2 @ curves.step),
        "ks": lambda gap: np.abs(gap).max(axis=1),
    }


def effects(curves: Curves, first: Floats, second: Floats, drawn: NDArray[np.int64]) -> Effects:
    """Compare two weighted groups of rotors.

    Parameters
    ----------
    curves
        Of all rotors of both groups.
    first, second
        Weights of the rotors in each group, shape (rotors,).
    drawn
        How often each rotor is drawn, (resamples, rotors).
    """
    one = gaps(curves, first[None], second[None])[0]
    many = gaps(curves, drawn * first, drawn * second)
    # The mean is minus the integral of F, up to a constant that both groups share.
    difference = plain_interval(float(-one @ curves.step), -many @ curves.step)
    found = {name: size_interval(size, one, many) for name, size in sizes(curves).items()}
    return Effects(difference, **found)


def bootstrap(
    n: int, groups: Sequence[NDArray[np.intp]], resamples: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Count how often each rotor is drawn, with replacement within each group.

    Returns
    -------
    ndarray
        Shape (resamples, n).
    """
    drawn = np.zeros((resamples, n), np.int64)
    for members in groups:
        even = np.full(len(members), 1.0 / len(members))
        drawn[:, members] = rng.multinomial(len(members), even, size=resamples)
    return drawn


def size_interval(size: Size, measured: Floats, resampled: Floats) -> Interval:
    """Give the interval of a distance, which is never negative and reads too much.

    Resampling adds to a distance what sampling added to it. The upper end is the quantile of the
    resampled distances, which that makes wide enough. Their lower quantile would miss a distance of
    zero every time, so the lower end is the largest part l of the measured gap F - G for which
    l (F - G) plus what resampling adds still gives so large a distance in 1 of 40 resamples.

    Parameters
    ----------
    size
        The distance as a function of gaps.
    measured, resampled
        F - G, shapes (points,) and (resamples, points).
    """
    value = float(size(measured[None])[0])
    high = float(np.quantile(size(resampled), _CI[1]))
    added = resampled - measured

    def reaches(part: float) -> float:
        return float(np.mean(size(part * measured + added) >= value * (1.0 - 1e-12)))

    low, above = 0.0, 1.0
    if value == 0.0 or reaches(0.0) >= _CI[0]:
        above = 0.0
    for _ in range(_HALVINGS if above else 0):
        middle = 0.5 * (low + above)
        low, above = (low, middle) if reaches(middle) >= _CI[0] else (middle, above)
    lowest = float(size(low * measured[None])[0])
    return Interval(value, lowest, max(high, value))


def plain_interval(value: float, resampled: Floats) -> Interval:
    """Give the interval between quantiles of the resampled values that are finite."""
    known = resampled[np.isfinite(resampled)]
    if not known.size:
        return Interval(value, np.nan, np.nan)
    low, high = np.quantile(known, _CI)
    return Interval(value, float(low), float(high))


def permutation_p(
    curves: Curves,
    weights: Floats,
    is_first: NDArray[np.bool_],
    permutations: int,
    rng: np.random.Generator,
) -> float:
    """Give the probability of a Wasserstein-1 distance this large if labels meant nothing.

    Parameters
    ----------
    curves
        Of the rotors of both groups.
    weights
        Of each rotor, shape (rotors,): 1, or its number of frames. A rotor takes it along.
    is_first
        Which rotors are of the first group.
    permutations
        How often whole rotors change groups; the measured labels count as one more, so that p is
        never 0 and its rate of false alarms is exact.
    """
    found: list[Floats] = []
    for rows in _blocks(permutations):
        labels = np.tile(is_first, (rows, 1))
        labels[0 if found else 1 :] = rng.permuted(labels[0 if found else 1 :], axis=1)
        chosen = labels * weights
        found.append(_distances(curves, weights, chosen @ curves.cdf, chosen.sum(axis=1)))
    return _share_as_far(np.concatenate(found))


def matched_p(
    curves: Curves, weights: Floats, sets: int, permutations: int, rng: np.random.Generator
) -> float:
    """Give that probability where each rotor stands in a set with simulated twins of its own.

    If the rotors were drawn from the simulated population, each of a set could have been the
    measured one, so that is chosen anew in every set.

    Parameters
    ----------
    curves
        Rows by set: measured rotors first, then the first twin of each, and so on.
    weights
        Of each row.
    sets
        Number of measured rotors.
    permutations
        As for :func:`permutation_p`.
    """
    each = len(weights) // sets
    cdf = curves.cdf.reshape(each, sets, -1)
    weight = weights.reshape(each, sets)
    found: list[Floats] = []
    for rows in _blocks(permutations):
        chosen = rng.integers(0, each, (rows, sets))
        if not found:
            chosen[0] = 0
        whole = np.zeros((rows, cdf.shape[2]))
        for number in range(sets):
            member = chosen[:, number]
            whole += weight[member, number, None] * cdf[member, number]
        own = weight[chosen, np.arange(sets)].sum(axis=1)
        found.append(_distances(curves, weights, whole, own))
    return _share_as_far(np.concatenate(found))


def _blocks(permutations: int) -> list[int]:
    """Split the measured labels and their permutations into parts that fit into memory."""
    whole, rest = divmod(permutations + 1, _ROWS)
    return [_ROWS] * whole + [rest] * (rest > 0)


def _distances(curves: Curves, weights: Floats, first: Floats, first_weight: Floats) -> Floats:
    """Give Wasserstein-1 of weighted sums of rows, (labellings, points), to the rest."""
    rest = weights @ curves.cdf - first
    rest_weight = weights.sum() - first_weight
    gap = first / first_weight[:, None] - rest / rest_weight[:, None]
    return sizes(curves)["wasserstein"](gap)


def _share_as_far(found: Floats) -> float:
    """Give the part of the labellings that are as far apart as the first one, which counts."""
    # Equal labels in another order of summation are equal distances.
    return float(np.count_nonzero(found >= found[0] * (1.0 - 1e-9))) / len(found)


def _shares(weights: Floats) -> Floats:
    total = weights.sum(axis=1, keepdims=True)
    empty = np.zeros(weights.shape, np.float64)
    shares: Floats = np.divide(weights, total, out=empty, where=total > 0)
    return shares
