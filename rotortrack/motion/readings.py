"""What the frames of one rotor tell about its angle, and a first guess of its motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from rotortrack.motion.angles import angle

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_LONGEST_LAG = 256
_COHERENT = 0.5
_LEAST_SD = 1e-4
_FACTOR_RANGE = (0.1, 20.0)
_WOBBLE = 0.3
_MEDIAN_VARIANCE = 6.4
_LEAST_CONCENTRATION = 1e-3


@dataclass(frozen=True)
class Circle:
    """Centre and radius, nm, of the circle through the positions, before correction for blur."""

    x_nm: float
    y_nm: float
    radius_nm: float


@dataclass(frozen=True)
class Readings:
    """Directions of one rotor in the frames in which it was seen, and how sharp they are.

    Given its distance from the centre, a position with normal noise of sd s per axis has a
    direction that is distributed by von Mises with concentration ``R r / s^2``, exactly. No
    angle is unwrapped and a position near the centre tells nothing.

    Attributes
    ----------
    frame
        Frames, ascending, shape (n,).
    theta_rad
        Directions, counter-clockwise on the displayed image.
    distance_nm
        Distances from the centre.
    concentration
        Of the direction about the true one, by the given standard deviations.
    """

    frame: Integers
    theta_rad: Floats
    distance_nm: Floats
    concentration: Floats

    def __len__(self) -> int:
        return self.frame.size

    @property
    def noise_rad2(self) -> Floats:
        """Variance of the wrapped normal distribution with the same mean resultant."""
        resultant = special.i1e(self.concentration) / special.i0e(self.concentration)
        variance: Floats = -2.0 * np.log(resultant)
        return variance


@dataclass(frozen=True)
class Pace:
    """Speed (rad/s), diffusion (rad^2/s) and the factor on the given noise variances."""

    omega_rad_s: float
    diffusion_rad2_s: float
    noise_factor: float


@dataclass(frozen=True)
class NoisePrior:
    """What the scatter of the radius tells about the factor on the given noise variances."""

    log_factor: float
    sd: float

    def deviance(self, log_factor: float | Floats) -> Floats:
        """Twice the negative log density, but for a constant."""
        return np.asarray(((log_factor - self.log_factor) / self.sd) ** 2)


@dataclass(frozen=True)
class Timing:
    """Time between frame starts and exposure within it, s.

    Intervals are counted from the middle of the dead time before an exposure to the middle of
    that after it. The exposure average then lies midway between the angles at both ends but for
    a deviation that is independent of them, whatever part of the interval is exposed.
    """

    frame_interval_s: float
    exposure_s: float

    def step_variance(self, diffusion_rad2_s: float) -> float:
        """Variance of the turn in one interval."""
        return 2.0 * diffusion_rad2_s * self.frame_interval_s

    def deviation_variance(self, diffusion_rad2_s: float) -> float:
        """Variance of the exposure average about the middle of both ends of its interval."""
        return 2.0 * diffusion_rad2_s * (self.frame_interval_s / 4.0 - self.exposure_s / 6.0)


def readings(
    frame: Integers,
    x_nm: Floats,
    y_nm: Floats,
    x_sd_nm: Floats,
    y_sd_nm: Floats,
    circle: Circle,
) -> Readings:
    """Turn positions into directions about a circle; rows that are not finite are left out.

    Where a standard deviation is missing the scatter of the radius stands for it.
    """
    usable = np.isfinite(x_nm) & np.isfinite(y_nm)
    x, y, x_sd, y_sd = (column[usable] for column in (x_nm, y_nm, x_sd_nm, y_sd_nm))
    theta = angle(x, y, np.full(x.size, circle.x_nm), np.full(x.size, circle.y_nm))
    distance = np.hypot(x - circle.x_nm, y - circle.y_nm)
    tangent_sd = np.hypot(np.sin(theta) * x_sd, np.cos(theta) * y_sd)
    unknown = ~(tangent_sd > 0.0)
    if unknown.any():
        tangent_sd = np.where(unknown, radial_scatter(distance), tangent_sd)
    tangent_sd = np.maximum(tangent_sd, _LEAST_SD * circle.radius_nm)
    concentration = np.maximum(circle.radius_nm * distance / tangent_sd**2, _LEAST_CONCENTRATION)
    return Readings(frame[usable].astype(np.int64), theta, distance, concentration)


def radial_scatter(distance_nm: Floats) -> float:
    """Robust standard deviation of the noise of distances from the centre, nm.

    By their steps from one reading to the next, which a rod that breathes over many frames leaves
    as they are.
    """
    if distance_nm.size < 2:
        return 0.0
    return 1.4826 / math.sqrt(2.0) * float(np.median(np.abs(np.diff(distance_nm))))


def noise_prior(seen: Readings, timing: Timing, diffusion: float, radius_nm: float) -> NoisePrior:
    """Read the noise off the radius, where the rotor's motion hardly shows.

    Noise along the radius is that along the circle. Motion during the exposure adds
    ``R^2 (2 D t)^2 / 180``, which is taken off. A rotor that wobbles or turns fast on an ellipse
    scatters more, hence the width of 0.3: a hundred readings tell their noise better.
    """
    blur = (2.0 * diffusion * timing.exposure_s) ** 2 / 180.0
    scatter = (radial_scatter(seen.distance_nm) / radius_nm) ** 2
    # The distance of a noisy point on a circle varies less than its coordinates.
    own = scatter * (1.0 + 0.5 * scatter) - blur
    given = float(np.median(seen.distance_nm / radius_nm / seen.concentration))
    log_factor = float(np.log(np.clip(own / given, *_FACTOR_RANGE)))
    return NoisePrior(log_factor, noise_prior_sd(len(seen)))


def noise_prior_sd(n_readings: float) -> float:
    """Give how well the radius tells the logarithm of the noise variance."""
    return math.sqrt(_WOBBLE**2 + _MEDIAN_VARIANCE / n_readings)


def first_guess(seen: Readings, timing: Timing) -> Pace:
    """Guess speed and diffusion from how directions agree over 1, 2, 4, ... frames.

    ``C(m) = mean exp(i (theta[k + m] - theta[k]))`` has the argument ``omega m dt`` and falls by
    ``exp(-D m dt)``; noise lowers all lags alike. Its argument at each lag is read nearest to what
    the shorter ones predict, so that steps and gaps need not be below half a turn.

    Returns
    -------
    Pace
        nan in all parts when no two frames adjoin.
    """
    offset = seen.frame - seen.frame[0]
    signal = np.zeros(int(offset[-1]) + 1, np.complex128)
    signal[offset] = np.exp(1j * seen.theta_rad)
    there = np.abs(signal) > 0.0
    dt = timing.frame_interval_s
    omega, diffusion, first = math.nan, math.nan, math.nan
    lag = 1
    while lag <= min(_LONGEST_LAG, signal.size - 1):
        pairs = int(np.count_nonzero(there[lag:] & there[:-lag]))
        coherence = complex(np.vdot(signal[:-lag], signal[lag:])) / max(pairs, 1)
        size = abs(coherence)
        if lag == 1:
            if pairs == 0:
                return Pace(np.nan, np.nan, np.nan)
            first = size
            omega = float(np.angle(coherence)) / dt
        elif size < max(_COHERENT * first, 4.0 / math.sqrt(max(pairs, 1))) and lag > 2:
            break
        else:
            slip = np.angle(coherence * np.exp(-1j * omega * lag * dt))
            omega += float(slip) / (lag * dt)
            diffusion = math.log(first / max(size, 1e-3)) / ((lag - 1) * dt)
        lag *= 2
    spread = -2.0 * math.log(min(max(first, 1e-3), 1.0 - 1e-12))
    given = 2.0 * float(np.median(seen.noise_rad2))
    free = dt - timing.exposure_s / 3.0
    # Diffusion takes 2 % of the spread at least, and all of it at most.
    diffusion = min(max(diffusion, 0.01 * spread / free), 0.5 * spread / free)
    noise = max(spread - 2.0 * diffusion * free, 0.05 * given)
    return Pace(omega, diffusion, min(max(noise / given, 0.2), 5.0))
