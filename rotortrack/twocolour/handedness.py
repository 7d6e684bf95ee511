"""Which way rotors turn: the share that turns counter-clockwise, measured and simulated.

Optics that flip an image swap both ways, so that nothing is compared where that is not known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from rotortrack.motion.population import binomial_share
from rotortrack.twocolour.measured import MeasuredGroup
from rotortrack.twocolour.population import RodPopulation
from rotortrack.twocolour.resampling import GRID_REFUSED, Interval

UNKNOWN: Final = (
    "{name}: whether the optics flip the image is not known, so that handedness is not compared: "
    "say so with movie.mirrored = true or false and make the run again"
)
ONE_SIDED: Final = (
    "the starts of {name} lie to one side without their mirror images, so that its share of "
    "counter-clockwise rods tells of the starts: simulate with [scan] mirrored = true"
)

_SURE_SD: Final = 1.959963984540054


@dataclass(frozen=True)
class Hands:
    """How many driven rotors of a group turn counter-clockwise in the specimen, seen from cis.

    Attributes
    ----------
    ccw, n
        Counts.
    share
        With Clopper and Pearson's interval.
    """

    ccw: int
    n: int
    share: Interval


@dataclass(frozen=True)
class HandsCompared:
    """Difference of two shares, first less second.

    Attributes
    ----------
    first, second
        The shares; that of a scan has no interval.
    difference
        Its interval is Newcombe's, of the intervals of the shares.
    p
        Probability of such a difference if rotors changed groups; nan where there is none.
    reason
        Why there is no p, empty where there is.
    """

    first: Interval
    second: Interval
    difference: Interval
    p: float
    reason: str


def hands(group: MeasuredGroup) -> Hands | None:
    """Count a measured group; None where it is not known whether the image is flipped."""
    if group.film.mirrored is None:
        return None
    on_screen = _signs(group)
    signs = -on_screen if group.film.mirrored else on_screen
    ccw, n = int((signs > 0).sum()), int((signs != 0).sum())
    share = binomial_share(ccw, n)
    return Hands(ccw, n, Interval(share.value, share.low, share.high))


def compare_hands(first: Hands, second: Hands) -> HandsCompared:
    """Compare two measured groups; p is Fisher's, which is that of all permutations of rotors."""
    if not (first.n and second.n):
        p, reason = math.nan, "a group has no driven rotor"
    else:
        table = np.array([[one.ccw, one.n - one.ccw] for one in (first, second)])
        p, reason = float(stats.fisher_exact(table)[1]), ""
    return HandsCompared(
        first.share, second.share, _difference(first.share, second.share), p, reason
    )


def compare_hands_with_rods(first: Hands, rods: RodPopulation) -> HandsCompared:
    """Compare a measured group with a scan; p is binomial, and there for a declared prior alone."""
    share = float(rods.weight[rods.rate_rev_s > 0].sum())
    second = Interval(share, share, share)
    p, reason = math.nan, "" if rods.declared else GRID_REFUSED
    if not first.n:
        reason = "no rotor is driven"
    elif rods.declared:
        p = float(stats.binomtest(first.ccw, first.n, min(share, 1.0)).pvalue)
    return HandsCompared(first.share, second, _difference(first.share, second), p, reason)


def _signs(group: MeasuredGroup) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Give +1 for rotors driven counter-clockwise on the screen, -1 clockwise, 0 for others."""
    if any(group.behaviour):
        known = {"driven_ccw": 1.0, "driven_cw": -1.0}
        return np.array([known.get(name, 0.0) for name in group.behaviour])
    sure = np.abs(group.speed_deg_s) > _SURE_SD * group.speed_sd_deg_s
    return np.where(sure, np.sign(group.speed_deg_s), 0.0)


def _difference(first: Interval, second: Interval) -> Interval:
    value = first.value - second.value
    below = math.hypot(first.value - first.low, second.high - second.value)
    above = math.hypot(first.high - first.value, second.value - second.low)
    return Interval(value, value - below, value + above)
