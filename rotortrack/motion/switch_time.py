"""When exactly a rotor switched, between two times at which it did not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from rotortrack.motion.timed_steps import TimedSteps

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SwitchTime:
    """Time of a switch.

    Attributes
    ----------
    time_s, low_s, high_s
        Middle of the shortest interval that holds half of its distribution, and the ends of the
        central 95 %, s.
    """

    time_s: float
    low_s: float
    high_s: float


def place_switch(steps: TimedSteps, min_segment_s: float) -> SwitchTime:
    """Weigh all frames at which these steps may change their speed, once, by their likelihood.

    The likelihood is exact, both speeds at their best values for each place; the prior is flat.
    The middle of the likelier half is near the truth more often than the peak of the likelihood is,
    and does not stray as far.

    Parameters
    ----------
    steps
        Steps with one switch among them.
    min_segment_s
        Least time from either end.

    Notes
    -----
    Cost: O(N). With y = U^-T t for the steps before a place and the damped remainder of y after it,
    the information on the speed before is a running sum plus one term.
    """
    gain = _explained(steps)
    away = np.minimum(steps.start_s[1:] - steps.start_s[0], steps.stop_s[-1] - steps.start_s[1:])
    weight = np.where(away >= min_segment_s * (1.0 - 1e-9), gain, -np.inf)
    if not np.isfinite(weight).any():
        weight = np.where(away == away.max(), gain, -np.inf)
    chance = np.exp(0.5 * (weight - weight.max()))
    # Places are unevenly spaced where frames are missing.
    room_s = np.gradient(steps.start_s)[1:] if len(steps) > 2 else np.ones(chance.size)
    grown = np.cumsum(chance * room_s)
    grown /= grown[-1]
    time_s = steps.start_s[1:]
    low, high = np.minimum(np.searchsorted(grown, [0.025, 0.975]), time_s.size - 1)
    # Ends of the interval from each place on that holds half, where there is as much left.
    from_ = np.flatnonzero(grown - chance * room_s <= grown[-1] - 0.5)
    ends = np.searchsorted(grown, np.concatenate([[0.0], grown])[from_] + 0.5 - 1e-12)
    ends = np.minimum(ends, time_s.size - 1)
    shortest = int(np.argmin(time_s[ends] - time_s[from_]))
    middle_s = 0.5 * float(time_s[from_[shortest]] + time_s[ends[shortest]])
    return SwitchTime(middle_s, float(time_s[low]), float(time_s[high]))


def _explained(steps: TimedSteps) -> Floats:
    """Give what two speeds explain, for a switch before each step but the first."""
    lasted = steps.stop_s - steps.start_s
    white = steps.whitened(lasted)
    kept = (steps.factor[0, 1:] / steps.factor[1, 1:]) ** 2
    # rest[k]: squares of the remainder after place k, which shrinks by `kept` from step to step.
    band = np.stack([np.append(0.0, -kept[:-1]), np.ones(kept.size)])
    rest = linalg.solve_banded((0, 1), band, kept, check_finite=False)
    before = np.cumsum(white**2)[:-1] + white[:-1] ** 2 * rest
    shares = np.cumsum(lasted * steps.over_covariance(lasted))
    told = np.cumsum(lasted * steps.over_covariance(steps.step_rad))
    both = shares[:-1] - before
    after = shares[-1] - before - 2.0 * both
    left, right = told[:-1], told[-1] - told[:-1]
    squares = after * left**2 - 2.0 * both * left * right + before * right**2
    explained: Floats = squares / (before * after - both**2)
    return explained
