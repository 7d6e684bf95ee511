"""Exact likelihood of a particle that diffuses in the plane, with gaps, noise and blur."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.interpolate import CubicSpline

from rotortrack.motion.likelihood import freedom, profile_rise
from rotortrack.motion.linear import whitened_sums
from rotortrack.motion.optimum import crossing
from rotortrack.motion.readings import Timing

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_KNOT = 0.5
_REFINED = 5
_STRIDE = 0.2
_LEAST_SQUARES = 1e-12
_NEWTON_STEPS = 5

GIVEN_NOISE = 1.0
"""Standard deviation of the logarithm of the noise variance about that of the fits' own errors.

So wide that intervals hold where those are wrong by a factor of two.
"""


@dataclass(frozen=True)
class FreeParticle:
    """Diffusion, noise and mean velocity of one particle.

    Attributes
    ----------
    diffusion_nm2_s, diffusion_sd_nm2_s, diffusion_interval_nm2_s
        D, its standard deviation and profile interval of 95 %, which begins at zero where a
        particle that only jitters explains the positions too.
    noise_factor
        Factor on the given variances of localisation.
    velocity_nm_s, velocity_sd_nm_s
        Mean velocity along x and y, and the standard deviation of each.
    directed_p
        Test of no mean velocity.
    """

    diffusion_nm2_s: float
    diffusion_sd_nm2_s: float
    diffusion_interval_nm2_s: tuple[float, float]
    noise_factor: float
    velocity_nm_s: tuple[float, float]
    velocity_sd_nm_s: tuple[float, float]
    directed_p: float


def fit_free_particle(
    frame: Integers,
    x_nm: Floats,
    y_nm: Floats,
    x_noise_nm2: Floats,
    y_noise_nm2: Floats,
    timing: Timing,
    *,
    noise_log_sd: float = GIVEN_NOISE,
) -> FreeParticle:
    """Maximum of the restricted likelihood of D and noise, the same along both axes.

    The noise is known up to a factor c, which has a closed form for each D / c, as have the mean
    velocities, which are integrated out so that estimating them does not make D too small.

    Parameters
    ----------
    frame, x_nm, y_nm
        One particle, frames ascending without repeats, shape (n,) with n >= 3.
    x_noise_nm2, y_noise_nm2
        Variances of localisation but for one factor, positive.
    timing
        Frame interval and exposure.
    noise_log_sd
        Standard deviation of log c about 0, inf where the variances are no more than a shape.
        Without it, noise that is small beside the steps is made too large, and D too small.

    Notes
    -----
    Some 60 passes of a filter of one state over each axis: 3 ms for 1000 frames.
    """
    n = frame.size - 1
    dt = timing.frame_interval_s
    apart = np.diff(frame)
    time = dt * (frame - frame[0]).astype(np.float64)
    unit = float(np.median(np.concatenate([x_noise_nm2, y_noise_nm2]))) / dt
    knots = np.arange(-2.0 * math.log(float(frame[-1] - frame[0])) - 7.0, 16.0, _KNOT)
    # The first model is the one without diffusion.
    ratio = np.append(0.0, unit * np.exp(knots))
    extra = timing.step_variance(1.0) / 4.0 + timing.deviation_variance(1.0)
    axes = [
        whitened_sums(
            place - place[0],
            time,
            apart,
            # One layout of memory for all callers, so that the kernel is compiled once.
            np.ascontiguousarray(noise),
            timing.step_variance(1.0) * ratio,
            extra * ratio,
        )
        for place, noise in ((x_nm, x_noise_nm2), (y_nm, y_noise_nm2))
    ]
    velocity = np.stack([sums[:, 2] / sums[:, 3] for sums in axes])
    information = np.stack([sums[:, 3] for sums in axes])
    both = np.sum(axes, axis=0)
    shape = both[:, 0] + np.log(information).sum(axis=0)
    least = _LEAST_SQUARES * float(both[0, 1]) + 1e-300
    at_rest = np.maximum(both[:, 1], least)
    squares = np.maximum(both[:, 1] - (velocity**2 * information).sum(axis=0), least)

    log_ratio = np.linspace(knots[0], knots[-1], (knots.size - 1) * _REFINED + 1)
    columns = np.stack([shape[1:], np.log(squares[1:]), np.log(at_rest[1:])], axis=1)
    smooth = CubicSpline(knots, columns)(log_ratio)
    profile = _Profile(
        math.log(unit) + log_ratio,
        smooth[:, 0],
        np.exp(smooth[:, 1]),
        still=(float(shape[0]), float(squares[0])),
        freedom=2 * n - 2,
        precision=noise_log_sd**-2,
    )
    best, moves = profile.best()
    factor = float(np.exp(profile.log_factor(profile.squares[best] if moves else profile.still[1])))
    diffusion = factor * math.exp(profile.log_ratio[best]) if moves else 0.0
    low, high = profile.limits(1.0)
    relative_sd = 0.5 * (high - low) / diffusion if low > 0.0 else math.inf
    degrees = freedom(relative_sd)
    d_low, d_high = profile.limits(profile_rise(degrees))
    rest = profile.with_squares(np.exp(smooth[:, 2]), float(at_rest[0]))
    statistic = max(rest.least() - profile.least(), 0.0)
    nearest = 1 + int(np.argmin(np.abs(knots - log_ratio[best]))) if moves else 0
    vx, vy = (float(v) for v in velocity[:, nearest])
    x_sd, y_sd = (math.sqrt(factor / float(i)) for i in information[:, nearest])
    return FreeParticle(
        diffusion_nm2_s=diffusion,
        diffusion_sd_nm2_s=0.5 * (high - low) if moves else high,
        diffusion_interval_nm2_s=(d_low, d_high),
        noise_factor=factor,
        velocity_nm_s=(vx, vy),
        velocity_sd_nm_s=(x_sd, y_sd),
        directed_p=_directed_p(statistic, degrees),
    )


def _directed_p(statistic: float, degrees: float) -> float:
    """Probability of such a deviance for two velocities where D is as uncertain as this."""
    ratio = 0.5 * degrees * math.expm1(min(statistic / degrees, 700.0))
    return float(stats.f.sf(ratio, 2.0, degrees))


@dataclass(frozen=True)
class _Profile:
    """Deviance over log(D / c), the factor c and the velocities at their best.

    `still` holds shape and squares of the model without diffusion.
    """

    log_ratio: Floats
    shape: Floats
    squares: Floats
    still: tuple[float, float]
    freedom: int
    precision: float

    def with_squares(self, squares: Floats, still: float) -> _Profile:
        """Give the same models other squares, those of a particle without velocity."""
        return replace(self, squares=squares, still=(self.still[0], still))

    def best(self) -> tuple[int, bool]:
        """Index of the best model, and whether it is better than none that diffuses."""
        deviance = self._deviance(self.shape, self.squares)
        best = int(np.argmin(deviance))
        return best, bool(deviance[best] < self._deviance(*self.still))

    def least(self) -> float:
        """Deviance of the best model."""
        least = float(np.min(self._deviance(self.shape, self.squares)))
        return min(least, float(self._deviance(*self.still)))

    def limits(self, rise: float) -> tuple[float, float]:
        """D below and above the best where the deviance has risen so far."""
        limit = self.least() + rise

        def above(log_d: float) -> float:
            log_factor = log_d - self.log_ratio
            return float(self._deviance_at(self.shape, self.squares, log_factor).min()) - limit

        best, moves = self.best()
        start = float(self.log_ratio[best] + self.log_factor(self.squares)[best])
        high = math.exp(crossing(above, start, _STRIDE))
        if not moves or float(self._deviance(*self.still)) <= limit:
            return 0.0, high
        return math.exp(crossing(above, start, -_STRIDE)), high

    def log_factor(self, squares: Floats | float) -> Floats:
        """Best log c of models with these squares."""
        found = np.log(np.asarray(squares) / self.freedom)
        for _ in range(_NEWTON_STEPS if self.precision else 0):
            weighed = squares * np.exp(-found)
            slope = self.freedom - weighed + 2.0 * found * self.precision
            found = found - np.clip(slope / (weighed + 2.0 * self.precision), -2.0, 2.0)
        return found

    def _deviance(self, shape: Floats | float, squares: Floats | float) -> Floats:
        return self._deviance_at(shape, squares, self.log_factor(squares))

    def _deviance_at(
        self, shape: Floats | float, squares: Floats | float, log_factor: Floats
    ) -> Floats:
        deviance: Floats = (
            shape
            + self.freedom * log_factor
            + squares * np.exp(np.minimum(-log_factor, 600.0))
            + self.precision * log_factor**2
        )
        return deviance
