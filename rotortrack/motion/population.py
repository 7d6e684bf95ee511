"""What a population of rotors does: classes, and the part that is driven."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]

PaperClass = Literal["fast", "slow", "none", "between", ""]

FAST_DEG_S = 720.0
SLOW_DEG_S = 100.0
DRIVEN_P = 0.05
_TAIL = 0.5


def paper_class(msd_speed_deg_s: float) -> PaperClass:
    """Class of the published speed (`MSDFit`): the paper's three, and what lies between.

    fast above 720 deg/s, slow from 100 to 720, none at 0, where the fit ends at its bound; speeds
    between 0 and 100 are missing from the published counts. Empty where there is no fit.
    """
    if not math.isfinite(msd_speed_deg_s):
        return ""
    if msd_speed_deg_s > FAST_DEG_S:
        return "fast"
    if msd_speed_deg_s >= SLOW_DEG_S:
        return "slow"
    return "between" if msd_speed_deg_s > 0.0 else "none"


@dataclass(frozen=True)
class Share:
    """Share of a population with an interval of 95 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class DrivenShare:
    """Part of the rotors that is driven, however slowly.

    Attributes
    ----------
    n
        Rotors with a p.
    estimate
        One minus Storey's share of the null: ``1 - #{p > 1/2} / (n / 2)``. Its lower end holds
        whatever the speeds are. Its upper end counts rotors so slow that their p exceeds 1/2 as
        often as not as undriven: no movie tells them.
    at_least
        ``(#{p < alpha} / n - alpha) / (1 - alpha)``, rotors below alpha less those expected by
        chance, and a lower limit (97.5 %) for it: the sharper where all driven rotors are fast.
    """

    n: int
    estimate: Share
    at_least: Share


def driven_share(p: Floats, alpha: float = DRIVEN_P) -> DrivenShare:
    """Estimate the part of driven rotors from the p of no drift of each.

    Rotors without drift have p spread evenly over 0 to 1, so those above 1/2 count twice as the
    undriven ones. Both counts are binomial, hence the intervals are Clopper and Pearson's, and they
    are for the population that the rotors are a sample of.

    Parameters
    ----------
    p
        Of each rotor; nan where there is none.
    alpha
        p below which a rotor counts as driven in `at_least`.

    Notes
    -----
    Source: Storey, J. R. Stat. Soc. B 64, 479 (2002).
    """
    known = p[np.isfinite(p)]
    n = int(known.size)
    if n == 0:
        nothing = Share(math.nan, math.nan, math.nan)
        return DrivenShare(0, nothing, nothing)
    null = binomial_share(int(np.count_nonzero(known > _TAIL)), n)
    small = binomial_share(int(np.count_nonzero(known < alpha)), n)

    def not_null(share: float) -> float:
        return min(max(1.0 - share / (1.0 - _TAIL), 0.0), 1.0)

    def corrected(share: float) -> float:
        return min(max((share - alpha) / (1.0 - alpha), 0.0), 1.0)

    return DrivenShare(
        n=n,
        estimate=Share(not_null(null.value), not_null(null.high), not_null(null.low)),
        at_least=Share(corrected(small.value), corrected(small.low), 1.0),
    )


def false_discovery_rate(p: Floats) -> Floats:
    """Benjamini and Hochberg's q of the rotors that have a p, nan for the others."""
    known = np.isfinite(p)
    q = np.full(p.size, math.nan)
    if known.any():
        q[known] = stats.false_discovery_control(p[known])
    return q


def binomial_share(count: int, n: int) -> Share:
    """Share `count / n` with Clopper and Pearson's interval of 95 %."""
    if n == 0:
        return Share(math.nan, math.nan, math.nan)
    low = float(stats.beta.ppf(0.025, count, n - count + 1)) if count else 0.0
    high = float(stats.beta.ppf(0.975, count + 1, n - count)) if count < n else 1.0
    return Share(count / n, low, high)


@dataclass(frozen=True)
class Population:
    """Counts and shares of the kept rotors of a movie.

    Attributes
    ----------
    n_rotors
        Kept rotors.
    behaviours, paper_classes
        How many of them have each behaviour and each class of the paper.
    n_driven_q
        Rotors called driven at a false-discovery rate of 5 %.
    driven
        Part that is driven, by their p.
    counter_clockwise
        Share of driven_ccw among driven_ccw and driven_cw.
    """

    n_rotors: int
    behaviours: dict[str, int]
    paper_classes: dict[str, int]
    n_driven_q: int
    driven: DrivenShare
    counter_clockwise: Share

    def plain(self) -> dict[str, object]:
        """Nested dict for JSON; nan, where nothing is known, becomes None."""
        return {name: _plain(value) for name, value in asdict(self).items()}


def summarise(
    behaviours: Iterable[str], paper_classes: Iterable[str], p: Floats, q: Floats
) -> Population:
    """Summarise the kept rotors.

    Parameters
    ----------
    behaviours, paper_classes, p, q
        Columns behaviour, paper_class, drift_p and drift_q of those rotors.
    """
    named = Counter(behaviours)
    ccw, cw = named["driven_ccw"], named["driven_cw"]
    return Population(
        n_rotors=sum(named.values()),
        behaviours={name: count for name, count in named.most_common() if count},
        paper_classes={name: count for name, count in Counter(paper_classes).most_common() if name},
        n_driven_q=int(np.count_nonzero(q < DRIVEN_P)),
        driven=driven_share(p),
        counter_clockwise=binomial_share(ccw, ccw + cw),
    )


def of_rotors(rotors: pd.DataFrame) -> Population:
    """Summarise the kept rotors of a table that `measure_motion` filled.

    Parameters
    ----------
    rotors
        Columns of `tables.ROTORS`; texts and numbers that are missing count as unknown.
    """
    kept = rotors[rotors["verdict"] == "kept"] if "verdict" in rotors else rotors

    def texts(name: str) -> list[str]:
        return kept[name].fillna("").tolist() if name in kept else []

    def numbers(name: str) -> Floats:
        return kept[name].to_numpy("float64") if name in kept else np.empty(0)

    return summarise(
        texts("behaviour"), texts("paper_class"), numbers("drift_p"), numbers("drift_q")
    )


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value
