"""Steps of a rotor as a Gaussian process in time, and speeds that are constant between switches.

A step over n frame intervals has the variance ``2 D (n dt - t / 3) + 2 sigma^2`` and, with the next
one, the covariance ``D t / 3 - sigma^2`` (t: exposure), because both share a noisy, blurred end.
The covariance matrix of all steps is tridiagonal, whatever the gaps, so its Cholesky factor has two
diagonals and the exact likelihood of any drift costs O(N).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from rotortrack.motion.diffusion import Diffusion, estimate_diffusion
from rotortrack.motion.increments import WIDE_STEP_RAD, Increments

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Drift = Callable[[Floats, Floats], Floats]
"""Expected turn (rad) between two times (s)."""

_LEAST_VARIANCE = 1e-12


@dataclass(frozen=True)
class TimedSteps:
    """Steps of one rotor with their covariance.

    Attributes
    ----------
    start_s, stop_s
        Starts of the frames between which each step lies, s since frame 0.
    step_rad
        Turn between them, rad, the nearest to what was expected.
    factor
        Upper Cholesky factor U of the covariance U^T U in LAPACK's band form, shape (2, n).
    """

    start_s: Floats
    stop_s: Floats
    step_rad: Floats
    factor: Floats

    def __len__(self) -> int:
        return self.step_rad.size

    @property
    def lasted_s(self) -> Floats:
        """Duration of each step."""
        return self.stop_s - self.start_s

    def over_covariance(self, values: Floats) -> Floats:
        """Solve ``covariance x = values``."""
        return linalg.cho_solve_banded((self.factor, False), values, check_finite=False)

    def whitened(self, values: Floats) -> Floats:
        """Solve ``U^T x = values``: steps become independent, of variance one."""
        lower = np.stack([self.factor[1], np.append(self.factor[0, 1:], 0.0)])
        return linalg.solve_banded((1, 0), lower, values, check_finite=False)

    def unwhitened_weights(self, white: Floats) -> Floats:
        """Solve ``U x = white``: what `over_covariance` makes of steps that are U^T white."""
        solved: Floats = linalg.solve_banded((0, 1), self.factor, white, check_finite=False)
        return solved

    def part(self, start: int, stop: int) -> TimedSteps:
        """Cut out steps; what they share with their neighbours becomes noise of their own."""
        # The factor of a part is not a part of the factor: the first step loses its predecessor.
        beside = self.factor[0, start + 1 : stop] * self.factor[1, start : stop - 1]
        return TimedSteps(
            self.start_s[start:stop],
            self.stop_s[start:stop],
            self.step_rad[start:stop],
            _factor(self.variance[start:stop], beside),
        )

    @property
    def variance(self) -> Floats:
        """Variance of each step, rad^2."""
        variance: Floats = self.factor[0] ** 2 + self.factor[1] ** 2
        return variance


@dataclass(frozen=True)
class SegmentSpeeds:
    """Speeds that are constant within segments of time.

    Attributes
    ----------
    omega_rad_s, covariance
        Signed speeds (rad/s) and their covariance, shapes (k,) and (k, k); nan where a segment has
        no steps.
    explained
        How much the weighted sum of squares falls when these speeds are subtracted.
    """

    omega_rad_s: Floats
    covariance: Floats
    explained: float

    @property
    def sd_rad_s(self) -> Floats:
        """Standard deviations."""
        sd: Floats = np.sqrt(np.diag(self.covariance))
        return sd

    def changes(self) -> tuple[Floats, Floats]:
        """Change of speed from each segment to the next, and its standard deviation, rad/s.

        For a switch at a known time; about ``sqrt(2 D (1 / T1 + 1 / T2))``.
        """
        variance = np.diag(self.covariance)
        spread = variance[1:] + variance[:-1] - 2.0 * np.diag(self.covariance, 1)
        return np.diff(self.omega_rad_s), np.sqrt(spread)


def timed_steps(
    frame: Integers,
    theta_rad: Floats,
    noise: Diffusion,
    drift: Drift,
    *,
    frame_interval_s: float,
    exposure_s: float,
) -> TimedSteps:
    """List the steps between frames, across gaps too, with their covariance.

    Each step is the one nearest to the expected turn. A gap so long that diffusion and noise alone
    spread the step beyond 55 degrees (`WIDE_STEP_RAD`) is left out: turns in it are not countable.

    Parameters
    ----------
    frame, theta_rad
        Frames, ascending without repeats, and angles (rad), shape (n,).
    noise
        D and sigma^2.
    drift
        Expected turn between two times.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.
    """
    start_s: Floats = frame[:-1] * np.float64(frame_interval_s)
    stop_s: Floats = frame[1:] * np.float64(frame_interval_s)
    turn = drift(start_s, stop_s)
    step = turn + _wrapped(np.diff(theta_rad) - turn)
    diffusion = noise.cautious_rad2_s
    variance = 2.0 * diffusion * (stop_s - start_s - exposure_s / 3.0)
    variance += 2.0 * noise.noise_variance_rad2 + _LEAST_VARIANCE
    shared = diffusion * exposure_s / 3.0 - noise.noise_variance_rad2
    kept = np.flatnonzero((np.diff(frame) == 1) | (variance < WIDE_STEP_RAD**2))
    beside = np.where(np.diff(kept) == 1, shared, 0.0)
    return TimedSteps(start_s[kept], stop_s[kept], step[kept], _factor(variance[kept], beside))


def mean_pace(frame: Integers, theta_rad: Floats, frame_interval_s: float) -> float:
    """Mean speed (rad/s) between the frames that lie closest together, as a start."""
    apart = np.diff(frame)
    closest = apart.min()
    turn = np.exp(1j * np.diff(theta_rad)[apart == closest]).mean()
    return float(np.angle(turn) / (closest * frame_interval_s))


def noise_of(
    frame: Integers,
    theta_rad: Floats,
    drift: Drift,
    *,
    frame_interval_s: float,
    exposure_s: float,
) -> Diffusion:
    """Estimate D and sigma^2 from the steps between adjacent frames, less a drift.

    A change of speed that is not taken off would pass for diffusion. Where hardly any frames
    adjoin, steps across gaps enter, too.
    """
    start_s: Floats = frame[:-1] * np.float64(frame_interval_s)
    stop_s: Floats = frame[1:] * np.float64(frame_interval_s)
    turn = drift(start_s, stop_s)
    strayed = _wrapped(np.diff(theta_rad) - turn)
    apart = np.diff(frame)
    adjacent = apart == 1
    times = {"frame_interval_s": frame_interval_s, "exposure_s": exposure_s}
    known = estimate_diffusion(
        Increments(strayed[adjacent], apart[adjacent], np.cumsum(~adjacent)[adjacent]), **times
    )
    if np.isfinite(known.diffusion_sd_rad2_s):
        return known
    return estimate_diffusion(Increments(strayed, apart, np.zeros_like(apart)), **times)


def fit_speeds(steps: TimedSteps, edges_s: Floats) -> SegmentSpeeds:
    """Fit speeds that change at known times, by generalised least squares.

    A step across an edge turns with each speed for its share of the time. The steps on both sides
    of an edge share their noise, so speeds of adjacent segments are correlated.

    Parameters
    ----------
    steps
        Steps of one rotor.
    edges_s
        Times that bound the k segments, ascending, shape (k + 1,), s; the first and last may be
        infinite.
    """
    spent_s = np.diff(
        np.clip(edges_s[np.newaxis, :], steps.start_s[:, np.newaxis], steps.stop_s[:, np.newaxis]),
        axis=1,
    )
    seen = spent_s.sum(axis=0) > 0.0
    omega = np.full(seen.size, np.nan)
    covariance = np.full((seen.size, seen.size), np.nan)
    if not seen.any():
        return SegmentSpeeds(omega, covariance, 0.0)
    design = steps.whitened(spent_s[:, seen])
    told = design.T @ steps.whitened(steps.step_rad)
    inverse = np.linalg.inv(design.T @ design)
    omega[seen] = inverse @ told
    covariance[np.ix_(seen, seen)] = inverse
    return SegmentSpeeds(omega, covariance, float(told @ inverse @ told))


def steady(omega_rad_s: float) -> Drift:
    """Expect one speed throughout."""
    return lambda start_s, stop_s: omega_rad_s * (stop_s - start_s)


def switching(edges_s: Floats, omega_rad_s: Floats) -> Drift:
    """Expect speeds that change at known times; edges as in `fit_speeds`."""

    def drift(start_s: Floats, stop_s: Floats) -> Floats:
        spent_s = np.diff(
            np.clip(edges_s[np.newaxis, :], start_s[:, np.newaxis], stop_s[:, np.newaxis]), axis=1
        )
        turned: Floats = spent_s @ np.nan_to_num(omega_rad_s)
        return turned

    return drift


def _factor(variance: Floats, beside: Floats) -> Floats:
    """Factorise a symmetric tridiagonal matrix."""
    band = np.stack([np.append(0.0, beside), variance])
    factor: Floats = linalg.cholesky_banded(band, check_finite=False)
    return factor


def _wrapped(angle_rad: Floats) -> Floats:
    """Bring angles into (-pi, pi]."""
    wrapped: Floats = np.angle(np.exp(1j * angle_rad))
    return wrapped
