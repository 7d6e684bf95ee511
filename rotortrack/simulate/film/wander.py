"""Random motion along one coordinate: mean over each segment of time, drawn with its end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
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


class Brownian(Wander):
    """Brownian motion from 0.

    Over a segment of length h that starts at W the end is W + w with w ~ N(0, 2 D h), and the mean
    W + w / 2 + N(0, 2 D h / 12), the last independent of w: the area under a Brownian bridge.

    Parameters
    ----------
    diffusion
        D, rad^2/s.
    length_s
        Lengths of the segments of a period.
    rng
        Two numbers a segment are drawn.
    arc_rad
        Reflecting walls this far apart, 0 in the middle; 0 for none. A folded Brownian path is a
        reflected one; the mean over a segment that meets a wall is that of the unfolded one, which
        is wrong by less than the spread within a segment.
    """

    def __init__(
        self, diffusion: float, length_s: Floats, rng: np.random.Generator, arc_rad: float = 0.0
    ) -> None:
        super().__init__(length_s)
        self._scale = np.sqrt(2.0 * diffusion * length_s)
        self._rng = rng
        self._arc = arc_rad
        self._reached = np.zeros(1)

    def advance(self, n: int) -> Floats:
        """Give the mean over each segment of the next n periods, shape (n, segments)."""
        normal = self._rng.standard_normal((n, self._scale.size, 2))
        steps = self._scale * normal[..., 0]
        ends = np.cumsum(np.concatenate([self._reached, steps.ravel()]))
        self._reached = ends[-1:]
        means = ends[:-1].reshape(steps.shape) + 0.5 * steps
        means += self._scale / np.sqrt(12.0) * normal[..., 1]
        if self._arc:
            half = 0.5 * self._arc
            means = np.abs((means + half) % (2.0 * self._arc) - self._arc) - half
        return means


class Wobble(Wander):
    """A stationary Ornstein-Uhlenbeck process about 0, mean and end of each segment jointly exact.

    Parameters
    ----------
    sd
        Standard deviation.
    diffusion
        D at short times: the relaxation time is sd^2 / D.
    length_s
        Lengths of the segments of a period.
    rng
        One number, and two a segment, are drawn.
    """

    def __init__(
        self, sd: float, diffusion: float, length_s: Floats, rng: np.random.Generator
    ) -> None:
        super().__init__(length_s)
        self._laws = ornstein_uhlenbeck(length_s * (diffusion / sd**2), sd)
        self._rng = rng
        self._reached = sd * float(rng.standard_normal())

    def advance(self, n: int) -> Floats:
        """Give the mean over each segment of the next n periods, shape (n, segments)."""
        normal = self._rng.standard_normal((n, self._length_s.size, 2))
        means = np.empty(normal.shape[:2])
        self._reached = wobble_means(self._reached, self._laws, normal, means)
        return means


class Breathing:
    """How far the ends of a rotor stand out, one value a frame: a stationary process about 0.

    Parameters
    ----------
    rotor
        Breathes with breathing_sd_nm and breathing_time_s.
    frame_interval_s
        Time from value to value.
    seed
        Of the film.
    """

    def __init__(self, rotor: Rotor, frame_interval_s: float, seed: int) -> None:
        sd_nm = rotor.breathing_sd_nm
        rng = stream(seed, Effect.BREATHING, rotor.number)
        periods = np.array([frame_interval_s])
        self._process = Wobble(sd_nm, sd_nm**2 / rotor.breathing_time_s, periods, rng)

    def advance(self, n: int) -> Floats:
        """Give the mean over each of the next n frame periods, nm."""
        return self._process.advance(n)[:, 0]


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


@kernel
def wobble_means(start: float, laws: Floats, normal: Floats, means: Floats) -> float:
    """Follow an Ornstein-Uhlenbeck process from segment to segment.

    Parameters
    ----------
    start
        Its value at the beginning.
    laws
        Of :func:`ornstein_uhlenbeck`, (segments, 5).
    normal
        Standard normal numbers, (n, segments, 2).
    means
        Filled with the mean over each segment, (n, segments).

    Returns
    -------
    Its value at the end.
    """
    for period in range(normal.shape[0]):
        for segment in range(normal.shape[1]):
            z0, z1 = normal[period, segment, 0], normal[period, segment, 1]
            means[period, segment] = laws[segment, 0] * start + laws[segment, 1] * z0
            start = laws[segment, 2] * start + laws[segment, 3] * z0 + laws[segment, 4] * z1
    return start
