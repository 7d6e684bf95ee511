"""Random motion along one coordinate: mean over each segment of time, drawn with its end.

The path from period to period has a stream of its own, and what lies within a period is a bridge
drawn from another one. So a rotor is in the same place at the beginning of every frame whatever
the segments, with and without motion blur or a rolling shutter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.rotor import Rotor
from rotortrack.simulate.film.streams import Effect, stream

Floats = NDArray[np.float64]

_SMALL = 1e-2
"""Below this ratio of time to relaxation time a series is better than the formula."""


class Wander:
    """No motion; the base of those that are.

    Parameters
    ----------
    length_s
        Lengths of the segments of a period, shape (segments,).
    """

    def __init__(self, length_s: Floats) -> None:
        self._length_s = length_s

    def advance(self, n: int) -> Floats:
        """Give the mean over each segment of the next n periods, shape (n, segments)."""
        return np.zeros((n, self._length_s.size))


@dataclass(frozen=True)
class Streams:
    """Random numbers of a path: from period to period, and within periods."""

    periods: np.random.Generator
    within: np.random.Generator

    @classmethod
    def of(cls, seed: int, effect: Effect, *numbers: int) -> Streams:
        """Give those of an effect, and of one rotor by its number."""
        return cls(stream(seed, effect, *numbers), stream(seed, effect, *numbers, 1))


class _Walk(Wander):
    """A Gaussian process that goes on from period to period, bridged within each one."""

    def __init__(
        self, start: float, laws: Floats, period: Floats, length_s: Floats, streams: Streams
    ) -> None:
        super().__init__(length_s)
        self._laws = laws
        self._period = np.array([period[0, 2], np.hypot(period[0, 3], period[0, 4])])
        self._pulls = _pulls(laws)
        self._streams = streams
        self._reached = start

    def advance(self, n: int) -> Floats:
        """Give the mean over each segment of the next n periods, shape (n, segments)."""
        kicks = self._streams.periods.standard_normal(n)
        normal = self._streams.within.standard_normal((n, self._length_s.size, 2))
        means = np.empty(normal.shape[:2])
        self._reached = walk_means(
            self._reached, self._period, kicks, self._laws, self._pulls, normal, means
        )
        return means


class Brownian(_Walk):
    """Brownian motion from 0.

    Parameters
    ----------
    diffusion
        D, rad^2/s.
    length_s
        Lengths of the segments of a period.
    streams
        One number a period, and two a segment, are drawn.
    arc_rad
        Reflecting walls this far apart, 0 in the middle; 0 for none. A folded Brownian path is a
        reflected one, so that its ends are exact; the mean over a segment that meets a wall is the
        folded mean, wrong by less than the spread within the segment.
    """

    def __init__(
        self, diffusion: float, length_s: Floats, streams: Streams, arc_rad: float = 0.0
    ) -> None:
        period = brownian(length_s.sum(keepdims=True), diffusion)
        super().__init__(0.0, brownian(length_s, diffusion), period, length_s, streams)
        self._arc = arc_rad

    def advance(self, n: int) -> Floats:
        """Give the mean over each segment of the next n periods, shape (n, segments)."""
        means = super().advance(n)
        if self._arc:
            half = 0.5 * self._arc
            means = np.abs((means + half) % (2.0 * self._arc) - self._arc) - half
        return means


class Wobble(_Walk):
    """A stationary Ornstein-Uhlenbeck process about 0.

    Parameters
    ----------
    sd
        Standard deviation.
    diffusion
        D at short times: the relaxation time is sd^2 / D.
    length_s
        Lengths of the segments of a period.
    streams
        One number, then one a period, and two a segment, are drawn.
    """

    def __init__(self, sd: float, diffusion: float, length_s: Floats, streams: Streams) -> None:
        rate = diffusion / sd**2
        laws = ornstein_uhlenbeck(length_s * rate, sd)
        period = ornstein_uhlenbeck(length_s.sum(keepdims=True) * rate, sd)
        start = sd * float(streams.periods.standard_normal())
        super().__init__(start, laws, period, length_s, streams)


class Breathing:
    """How far the ends of a rotor stand out, one value a frame: a stationary process about 0.

    Parameters
    ----------
    rotor
        Breathes with breathing_sd_nm and breathing_time_s.
    clock
        When frames are exposed.
    seed
        Of the film.
    """

    def __init__(self, rotor: Rotor, clock: Clock, seed: int) -> None:
        sd_nm = rotor.breathing_sd_nm
        streams = Streams.of(seed, Effect.BREATHING, rotor.number)
        dead_s = max(clock.frame_interval_s - clock.exposure_s, 0.0)
        lengths_s = np.array([clock.exposure_s, dead_s])
        self._process = Wobble(sd_nm, sd_nm**2 / rotor.breathing_time_s, lengths_s, streams)

    def advance(self, n: int) -> Floats:
        """Give the mean over each exposure of the next n frames, nm."""
        return self._process.advance(n)[:, 0]


def brownian(length_s: Floats, diffusion: float) -> Floats:
    """Give the joint law of mean and end of a segment of Brownian motion, given its start.

    Over a length h the end has the variance 2 D h, the mean a third of it, and their covariance is
    half of it. See :func:`ornstein_uhlenbeck` for what is given.
    """
    sd = np.sqrt(2.0 * diffusion * length_s)
    one = np.ones_like(sd)
    return np.stack([one, sd / np.sqrt(3.0), one, sd * np.sqrt(0.75), sd * 0.5], axis=1)


def ornstein_uhlenbeck(ratio: Floats, sd: float) -> Floats:
    """Give the joint law of mean and end of a segment, given its start.

    mean = c0 start + c1 z0; end = c2 start + c3 z0 + c4 z1, with z0 and z1 standard normal.

    Parameters
    ----------
    ratio
        Lengths over the relaxation time, shape (segments,).
    sd
        Stationary standard deviation.

    Returns
    -------
    (c0, ..., c4) of each segment, shape (segments, 5).
    """
    a = np.maximum(ratio, 1e-300)
    keep = np.exp(-a)
    gone = -np.expm1(-a)
    # 2 (a - 3/2 + 2 exp(-a) - exp(-2 a) / 2) / a^2 loses all digits for small a.
    series = a * (
        2.0 / 3.0 - a * (1.0 / 2.0 - a * (7.0 / 30.0 - a * (1.0 / 12.0 - a * 31.0 / 1260.0)))
    )
    large = np.maximum(a, _SMALL)
    full = 2.0 * (large - gone - 0.5 * gone**2) / large**2
    var_mean = np.where(a < _SMALL, series, full)
    var_end = -np.expm1(-2.0 * a)
    cov = gone**2 / a
    of_mean = np.sqrt(var_mean)
    shared = cov / of_mean
    own = np.sqrt(np.maximum(var_end - shared**2, 0.0))
    return np.stack([gone / a, sd * of_mean, keep, sd * shared, sd * own], axis=1)


def _pulls(laws: Floats) -> Floats:
    """How much the mean over each segment moves with the end of the period, given its start.

    A Gaussian path becomes one with a given end, of the right law, by adding the regression on what
    its own end lacks.
    """
    covariances = np.empty(len(laws))
    variance = 0.0
    for at, (c0, c1, c2, c3, c4) in enumerate(laws.tolist()):
        covariances[:at] *= c2
        covariances[at] = c0 * c2 * variance + c1 * c3
        variance = c2**2 * variance + c3**2 + c4**2
    pulls: Floats = covariances / variance
    return pulls


@kernel
def walk_means(
    start: float,
    period: Floats,
    kicks: Floats,
    laws: Floats,
    pulls: Floats,
    normal: Floats,
    means: Floats,
) -> float:
    """Follow a Gaussian process from period to period, and from segment to segment within.

    Parameters
    ----------
    start
        Its value at the beginning.
    period
        What is kept of a value over a period, and the standard deviation of what is new.
    kicks
        Standard normal numbers, one a period, (n,).
    laws
        Of :func:`ornstein_uhlenbeck` or :func:`brownian`, (segments, 5).
    pulls
        How much the means move with the end of the period, (segments,).
    normal
        Standard normal numbers, (n, segments, 2).
    means
        Filled with the mean over each segment, (n, segments).

    Returns
    -------
    Its value at the end.
    """
    n, segments = means.shape
    for at in range(n):
        value = start
        for segment in range(segments):
            z0, z1 = normal[at, segment, 0], normal[at, segment, 1]
            means[at, segment] = laws[segment, 0] * value + laws[segment, 1] * z0
            value = laws[segment, 2] * value + laws[segment, 3] * z0 + laws[segment, 4] * z1
        start = period[0] * start + period[1] * kicks[at]
        for segment in range(segments):
            means[at, segment] += pulls[segment] * (start - value)
    return start
