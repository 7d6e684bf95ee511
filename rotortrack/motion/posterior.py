"""Where a rotor was in every frame, also those in which it was not seen, given all frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from rotortrack.kernels import kernel
from rotortrack.motion.circular import Grid
from rotortrack.motion.grid import UNIFORM_SHARE, smooth_moments
from rotortrack.motion.readings import Circle, Pace, Readings, Timing

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_ANYWHERE_RAD2 = 1e3


@dataclass(frozen=True)
class Posterior:
    """Exposure average of angle and position in every frame from the first to the last seen.

    Standard deviations are of localisation and motion; those of the circle are not in them.

    Attributes
    ----------
    frame
        All frames, shape (m,).
    theta_rad, theta_sd_rad
        Circular mean in (-pi, pi], and ``sqrt(-2 log |mean exp(i theta)|)``.
    x_nm, y_nm, x_sd_nm, y_sd_nm
        Mean position and standard deviations.
    """

    frame: Integers
    theta_rad: Floats
    theta_sd_rad: Floats
    x_nm: Floats
    y_nm: Floats
    x_sd_nm: Floats
    y_sd_nm: Floats


def smooth_on_circle(grid: Grid, pace: Pace) -> tuple[Floats, Floats]:
    """First and second moment of every frame's angle by a pass forth and back over the grid."""
    seen, timing = grid.seen, grid.timing
    row = seen.frame - seen.frame[0]
    own = np.zeros(int(row[-1]) + 1)
    own[row] = seen.concentration / pace.noise_factor
    sharpness = np.zeros(own.size)
    sharpness[row] = grid.concentration(pace)
    drift = _drift(seen, timing, pace)
    theta = np.zeros(own.size)
    theta[row] = seen.theta_rad - drift[row]
    deviation = timing.deviation_variance(pace.diffusion_rad2_s)
    moments = smooth_moments(
        theta,
        own > 0.0,
        sharpness,
        (1.0 - UNIFORM_SHARE) / (2.0 * np.pi * special.i0e(sharpness)),
        own * deviation / (1.0 + own * deviation),
        grid.turns(timing.step_variance(pace.diffusion_rad2_s)),
        grid.size,
    )
    left = deviation / (1.0 + own * deviation)
    turn = np.exp(1j * drift)
    first = (moments[0] + 1j * moments[1]) * turn * np.exp(-0.5 * left)
    second = (moments[2] + 1j * moments[3]) * turn**2 * np.exp(-2.0 * left)
    return first, second


def smooth_on_line(
    seen: Readings, timing: Timing, strayed: Floats, pace: Pace
) -> tuple[Floats, Floats]:
    """Give the same moments by the Gaussian smoother, from angles unwrapped by `linear.unwrap`."""
    row = seen.frame - seen.frame[0]
    noise = np.full(int(row[-1]) + 1, np.inf)
    noise[row] = pace.noise_factor * seen.noise_rad2
    angles = np.zeros(noise.size)
    angles[row] = strayed
    mean, variance = _smooth(
        angles,
        noise,
        timing.step_variance(pace.diffusion_rad2_s),
        timing.deviation_variance(pace.diffusion_rad2_s),
    )
    mean = mean + _drift(seen, timing, pace)
    return np.exp(1j * mean - 0.5 * variance), np.exp(2j * mean - 2.0 * variance)


def posterior(
    seen: Readings,
    timing: Timing,
    pace: Pace,
    moments: tuple[Floats, Floats],
    circle: Circle,
) -> Posterior:
    """Turn moments of the angle into angles and positions.

    During an exposure the rotor turns, which pulls its average position inwards by an amount
    that differs from frame to frame, with variance ``R^2 (2 D t)^2 / 180``; the measured distance
    from the centre tells it.
    """
    first, second = moments
    radius = circle.radius_nm
    direction = first / np.abs(first)
    swing = 2.0 * pace.diffusion_rad2_s * timing.exposure_s
    inward = radius**2 * swing**2 / 180.0
    row = seen.frame - seen.frame[0]
    # concentration = R r / s^2, hence r and s follow from it only together.
    distance = seen.distance_nm
    noise = pace.noise_factor * radius * distance / seen.concentration
    gain = np.zeros(first.size)
    gain[row] = inward / (inward + noise) if inward > 0.0 else 0.0
    ahead = np.zeros(first.size)
    ahead[row] = distance * (np.exp(1j * seen.theta_rad) * np.conj(direction[row])).real
    place = radius * first + gain * (ahead - radius * np.abs(first)) * direction
    depth = inward * (1.0 - gain)
    x_variance = radius**2 * (0.5 + 0.5 * second.real - first.real**2) + depth * direction.real**2
    y_variance = radius**2 * (0.5 - 0.5 * second.real - first.imag**2) + depth * direction.imag**2
    return Posterior(
        frame=seen.frame[0] + np.arange(first.size),
        theta_rad=np.angle(first),
        theta_sd_rad=np.sqrt(-2.0 * np.log(np.minimum(np.abs(first), 1.0))),
        x_nm=circle.x_nm + place.real,
        y_nm=circle.y_nm - place.imag,
        x_sd_nm=np.sqrt(np.maximum(x_variance, 0.0)),
        y_sd_nm=np.sqrt(np.maximum(y_variance, 0.0)),
    )


def _drift(seen: Readings, timing: Timing, pace: Pace) -> Floats:
    frames = np.arange(int(seen.frame[-1] - seen.frame[0]) + 1)
    return pace.omega_rad_s * timing.frame_interval_s * frames.astype(np.float64)


@kernel
def _smooth(angles: Floats, noise: Floats, step: float, deviation: float) -> tuple[Floats, Floats]:
    """Mean and variance of every exposure average; frames without a reading have infinite noise."""
    n = angles.size
    extra = 0.25 * step + deviation
    # Of both ends (start, end) and the average between them, given the readings so far.
    end, average = np.empty(n), np.empty(n)
    start = np.empty(n)
    v_end, v_average, c_average = np.empty(n), np.empty(n), np.empty(n)
    c_start, v_start = np.empty(n), np.empty(n)
    mean, spread = angles[0], _ANYWHERE_RAD2
    for k in range(n):
        inverse = 1.0 / (spread + extra + noise[k])
        error = angles[k] - mean
        to_end, to_average = spread + 0.5 * step, spread + extra
        start[k] = mean + spread * inverse * error
        end[k] = mean + to_end * inverse * error
        average[k] = mean + to_average * inverse * error
        v_start[k] = spread - spread * spread * inverse
        c_start[k] = spread - spread * to_end * inverse
        v_end[k] = spread + step - to_end * to_end * inverse
        v_average[k] = to_average - to_average * to_average * inverse
        c_average[k] = to_end - to_average * to_end * inverse
        mean, spread = end[k], v_end[k]
    later, v_later = mean, spread
    for k in range(n - 1, -1, -1):
        shift, narrowed = later - end[k], v_later - v_end[k]
        share = c_average[k] / v_end[k]
        average[k] += share * shift
        v_average[k] += share * share * narrowed
        share = c_start[k] / v_end[k]
        later = start[k] + share * shift
        v_later = v_start[k] + share * share * narrowed
    return average, v_average
