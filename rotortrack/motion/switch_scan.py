"""Where among its steps a rotor may have switched: sums, best cut, calibrated threshold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from rotortrack.motion.timed_steps import TimedSteps

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_PLACES_PER_SEGMENT = 10
_REPLICATES = 400
_AT_ONCE = 50
_TAIL_SHARE = 0.2
_SCALES = 400


class Scan:
    """Sums over the steps that give the statistic of any segment at once.

    With C the covariance of the steps s and t their durations, a segment's share of ``t' C^-1 s``,
    squared and divided by its share of ``t' C^-1 t``, is how much its own speed explains. What
    segments share by correlation lies within some frames of their edges and is left out here.

    Parameters
    ----------
    steps
        Steps of one rotor.
    min_segment_s
        Least time between switches, and from the ends; a tenth of it is the distance of places.

    Attributes
    ----------
    time_s
        Places where a switch is looked for, and both ends, s.
    """

    def __init__(self, steps: TimedSteps, min_segment_s: float) -> None:
        self._steps = steps
        self._lasted_s = steps.stop_s - steps.start_s
        begin, end = float(steps.start_s[0]), float(steps.stop_s[-1])
        count = max(int((end - begin) / min_segment_s * _PLACES_PER_SEGMENT), 1)
        wanted = begin + (end - begin) * np.arange(1, count) / count
        inner = np.unique(np.searchsorted(steps.start_s, wanted))
        inner = inner[(inner > 0) & (inner < len(steps))]
        self._index = np.concatenate([[0], inner, [len(steps)]])
        self.time_s = np.append(steps.start_s[self._index[:-1]], end)
        self._least_s = min_segment_s * (1.0 - 1e-9)
        self._weight = self._summed(self._lasted_s * steps.over_covariance(self._lasted_s))
        self._told = self._summed(self._lasted_s * steps.over_covariance(steps.step_rad))
        away = np.minimum(self.time_s - begin, end - self.time_s)
        self._single = np.flatnonzero(away >= self._least_s)

    @property
    def has_room(self) -> bool:
        """Whether the track is long enough for a switch."""
        return self._single.size > 0

    def best_single(self) -> float:
        """Statistic of the best single switch."""
        return float(self._best_single(self._told[:, np.newaxis])[0])

    def partition(self, penalty: float) -> Floats:
        """Find the times of the switches that explain most at a penalty each, s.

        Optimal partitioning: the best cut up to each place follows from the best cuts up to all
        earlier ones. An earlier place that cannot become the last switch any more, whatever
        follows, is dropped; as a switch here needs its distance, so does the dropping.
        """
        time_s, told, weight = self.time_s, self._told, self._weight
        best = np.full(time_s.size, np.inf)
        best[0] = -penalty
        last = np.zeros(time_s.size, np.int64)
        useful_until_s = np.full(time_s.size, np.inf)
        for stop in range(1, time_s.size):
            open_ = useful_until_s[:stop] > time_s[stop]
            far = time_s[:stop] <= time_s[stop] - self._least_s
            starts = np.flatnonzero(open_ & far & np.isfinite(best[:stop]))
            if starts.size == 0:
                continue
            gain = (told[stop] - told[starts]) ** 2 / (weight[stop] - weight[starts])
            cost = best[starts] - gain
            chosen = int(np.argmin(cost))
            best[stop] = cost[chosen] + penalty
            last[stop] = starts[chosen]
            hopeless = starts[cost > best[stop]]
            until_s = time_s[stop] + self._least_s
            useful_until_s[hopeless] = np.minimum(useful_until_s[hopeless], until_s)
        found: list[int] = []
        stop = int(last[-1])
        while stop > 0:
            found.append(stop)
            stop = int(last[stop])
        return time_s[np.array(found[::-1], np.int64)]

    def threshold(self, false_alarm: float, freedom: float, seed: int) -> float:
        """Simulate the value that the best single switch exceeds by chance this often.

        Steps without a switch are drawn with the covariance of the steps. The far tail of their
        statistics falls like ``sqrt(x) exp(-x / 2)``; its height comes from the largest fifth of
        the draws, which steadies what 400 draws alone would leave to luck. As the covariance is
        estimated, too, the tail is averaged over chi-square draws of the variance.

        Parameters
        ----------
        false_alarm
            How often.
        freedom
            Degrees of freedom of the variance of a long displacement.
        seed
            Of the draws.
        """
        rng = np.random.default_rng(seed)
        drawn = []
        for _ in range(_REPLICATES // _AT_ONCE):
            white = rng.standard_normal((self._lasted_s.size, _AT_ONCE))
            told = self._steps.unwhitened_weights(white)
            told *= self._lasted_s[:, np.newaxis]
            drawn.append(self._best_single(self._summed(told)))
        largest = np.sort(np.concatenate(drawn))[-int(_TAIL_SHARE * _REPLICATES) :]
        share = _TAIL_SHARE * (1.0 - (np.arange(largest.size) + 0.5) / largest.size)
        height = float(np.mean(np.log(share) - 0.5 * np.log(largest) + 0.5 * largest))
        scale = np.ones(1)
        if np.isfinite(freedom):
            scale = stats.chi2.ppf((np.arange(_SCALES) + 0.5) / _SCALES, freedom) / freedom

        def excess(log_x: float) -> float:
            x = np.exp(log_x) * scale
            return (
                float(np.minimum(np.exp(height - 0.5 * x) * np.sqrt(x), 1.0).mean()) - false_alarm
            )

        most = np.log(1e6)
        if excess(most) > 0.0:
            # So little is known of D that any statistic may be chance.
            return np.inf
        return float(np.exp(optimize.brentq(excess, np.log(1.0), most)))

    def _best_single(self, told: Floats) -> Floats:
        """Give the best statistic of a single switch, for each column of sums."""
        if not self.has_room:
            return np.zeros(told.shape[1])
        at = self._single
        left, whole = self._weight[at, np.newaxis], self._weight[-1]
        strayed = told[at] - told[-1] * left / whole
        gain = strayed**2 / (left * (whole - left) / whole)
        best: Floats = gain.max(axis=0)
        return best

    def _summed(self, values: Floats) -> Floats:
        """Sum values of steps from the first one up to each place."""
        parts = np.add.reduceat(values, self._index[:-1], axis=0)
        zero = np.zeros((1, *parts.shape[1:]))
        summed: Floats = np.concatenate([zero, np.cumsum(parts, axis=0)])
        return summed
