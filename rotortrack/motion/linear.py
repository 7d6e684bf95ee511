"""Exact likelihood of a turning angle whose steps stay below half a turn, gaps included.

The angle at the ends of a frame's interval drifts and diffuses; a reading is its exposure average
plus noise (`readings.Timing`). One pass of a filter gives the Gaussian likelihood of all steps,
with missing frames and with a noise of its own in every frame; without gaps and with one noise it
is what the type-I sine transform of the steps gives. The noise is known up to a factor c, and D/c
is the one number to search: c and omega have closed forms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from rotortrack.kernels import kernel
from rotortrack.motion.likelihood import (
    IDENTIFIED,
    Fit,
    drift_p,
    freedom,
    profile_rise,
    student_square,
)
from rotortrack.motion.optimum import crossing
from rotortrack.motion.readings import NoisePrior, Pace, Readings, Timing

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_STEP = 1.5
_FINE = 48
_REFINED = 801
_FAR = 14.0
_UNWRAPPINGS = 4
_LEAST_SQUARES = 1e-12
_NEWTON_STEPS = 4


@kernel
def _unwrap(
    theta: Floats, apart: Integers, noise: Floats, step_variance: float, extra: float
) -> tuple[Floats, Floats, Floats]:
    """Unwrapped angles, innovations and their variances; the drift is taken off beforehand.

    `extra` is the variance of an exposure average about the angle at the start of its interval.
    """
    n = theta.size
    unwrapped = np.empty(n)
    innovation = np.zeros(n)
    variance = np.full(n, np.nan)
    mean = theta[0]
    spread = extra + noise[0]
    unwrapped[0] = theta[0]
    for k in range(1, n):
        before = spread + (apart[k - 1] - 1) * step_variance
        total = before + extra + noise[k]
        error = theta[k] - mean
        error -= 2.0 * np.pi * np.round(error / (2.0 * np.pi))
        unwrapped[k] = mean + error
        innovation[k] = error
        variance[k] = total
        shared = before + 0.5 * step_variance
        mean += shared / total * error
        spread = before + step_variance - shared * shared / total
    return unwrapped, innovation, variance


@kernel
def whitened_sums(
    y: Floats, t: Floats, apart: Integers, noise: Floats, step_variance: Floats, extra: Floats
) -> Floats:
    """Log determinant and products (yy, yt, tt) of whitened angles and times, a row a model."""
    sums = np.zeros((step_variance.size, 4))
    for m in range(step_variance.size):
        s, u = step_variance[m], extra[m]
        mean_y, mean_t = y[0], t[0]
        spread = u + noise[0]
        product = 1.0
        log_determinant, yy, yt, tt = 0.0, 0.0, 0.0, 0.0
        for k in range(1, y.size):
            before = spread + (apart[k - 1] - 1) * s
            inverse = 1.0 / (before + u + noise[k])
            error_y, error_t = y[k] - mean_y, t[k] - mean_t
            product *= inverse
            if not 1e-200 < product < 1e200:
                log_determinant -= np.log(product)
                product = 1.0
            yy += error_y * error_y * inverse
            yt += error_y * error_t * inverse
            tt += error_t * error_t * inverse
            shared = before + 0.5 * s
            gain = shared * inverse
            mean_y += gain * error_y
            mean_t += gain * error_t
            spread = before + s - shared * gain
        sums[m, 0] = log_determinant - np.log(product)
        sums[m, 1], sums[m, 2], sums[m, 3] = yy, yt, tt
    return sums


@dataclass(frozen=True)
class LinearFit:
    """Fit of the increments and what is needed to judge it.

    Attributes
    ----------
    fit
        Estimates.
    innovation, variance
        Deviation of each reading from its prediction by those before, and its variance, rad and
        rad^2; nan for the first.
    """

    fit: Fit
    innovation: Floats
    variance: Floats


def fit_increments(seen: Readings, timing: Timing, start: Pace, prior: NoisePrior) -> LinearFit:
    """Maximum of the exact likelihood of the steps, with profile intervals.

    Parameters
    ----------
    seen
        At least three readings.
    timing
        Frame interval and exposure.
    start
        First guess; it unwraps the angles, which is repeated with the estimates.
    prior
        Of the factor on the noise variances.

    Notes
    -----
    Some 70 passes of a filter of one state over the readings: 15 ms for 8000 of them. D and omega
    have profiles by splines in log(D / c), of which all else is a closed form.
    """
    pace = start
    strayed, innovation, variance = unwrap(seen, timing, pace)
    turns = np.zeros(0)
    for _ in range(_UNWRAPPINGS):
        before, turns = turns, _turns(seen, timing, pace, strayed)
        if np.array_equal(before, turns):
            break
        fit = _fit(strayed, seen, timing, pace.omega_rad_s, prior)
        pace = Pace(fit.omega_rad_s, fit.diffusion_rad2_s, fit.noise_factor)
        strayed, innovation, variance = unwrap(seen, timing, pace)
    return LinearFit(fit, innovation, variance)


def unwrap(seen: Readings, timing: Timing, pace: Pace) -> tuple[Floats, Floats, Floats]:
    """Unwrapped angles less the drift, deviations from their predictions, variances of these."""
    return _unwrap(
        seen.theta_rad - _drift(seen, timing, pace.omega_rad_s),
        np.diff(seen.frame),
        pace.noise_factor * seen.noise_rad2,
        timing.step_variance(pace.diffusion_rad2_s),
        _extra(timing, pace.diffusion_rad2_s),
    )


def prediction_moves(
    seen: Readings, timing: Timing, pace: Pace, variance: Floats
) -> tuple[Floats, Floats]:
    """Turn of the next prediction by each reading but the first: standard deviation and drift.

    Parameters
    ----------
    variance
        Of the deviations from the predictions, by `unwrap`.
    """
    step = timing.step_variance(pace.diffusion_rad2_s)
    own = _extra(timing, pace.diffusion_rad2_s) + pace.noise_factor * seen.noise_rad2
    shared = (variance - own)[1:] + 0.5 * step
    apart = np.diff(seen.frame, append=seen.frame[-1] + 1)[1:]
    return shared / np.sqrt(variance[1:]), pace.omega_rad_s * timing.frame_interval_s * apart


def log_densities(seen: Readings, timing: Timing, pace: Pace) -> Floats:
    """Log density of each reading given those before it, 0 for the first."""
    _, innovation, variance = unwrap(seen, timing, pace)
    found: Floats = -0.5 * (innovation**2 / variance + np.log(2.0 * np.pi * variance))
    found[0] = 0.0
    return found


def speed_information(seen: Readings, timing: Timing, diffusion: float, factor: float) -> float:
    """Information about omega, (rad/s)^-2, where D and the factor on the noise are known."""
    t = _drift(seen, timing, 1.0)
    model = np.array([timing.step_variance(diffusion)]), np.array([_extra(timing, diffusion)])
    return float(whitened_sums(t, t, np.diff(seen.frame), factor * seen.noise_rad2, *model)[0, 3])


def _drift(seen: Readings, timing: Timing, omega: float) -> Floats:
    drift: Floats = omega * timing.frame_interval_s * (seen.frame - seen.frame[0])
    return drift


def _extra(timing: Timing, diffusion: float) -> float:
    """Variance of an exposure average about the angle at either end of its interval."""
    return timing.step_variance(diffusion) / 4.0 + timing.deviation_variance(diffusion)


def _turns(seen: Readings, timing: Timing, pace: Pace, strayed: Floats) -> Floats:
    """Count the whole turns by which the unwrapped angles differ from the directions."""
    unwrapped = strayed + _drift(seen, timing, pace.omega_rad_s)
    turns: Floats = np.round((unwrapped - seen.theta_rad) / (2.0 * np.pi))
    return turns


def _fit(
    strayed: Floats, seen: Readings, timing: Timing, reference: float, prior: NoisePrior
) -> Fit:
    """Fit unwrapped angles from which the drift of a reference speed was taken."""
    n = len(seen) - 1
    noise = seen.noise_rad2
    t = _drift(seen, timing, 1.0)
    # The ratio of D to the factor on the noise variances, relative to that where both matter
    # alike within one frame.
    unit = float(np.median(noise)) / timing.frame_interval_s

    def sums(log_ratio: Floats) -> Floats:
        ratio = unit * np.exp(log_ratio)
        model = timing.step_variance(1.0) * ratio, _extra(timing, 1.0) * ratio
        return whitened_sums(strayed, t, np.diff(seen.frame), noise, *model)

    span = float(seen.frame[-1] - seen.frame[0])
    coarse = np.arange(-2.0 * np.log(span) - 7.0, 8.0, _STEP)
    deviance = _Table(coarse, sums(coarse), n, prior).deviance()
    near = coarse[deviance < deviance.min() + _FAR]
    low, high = max(near[0] - _STEP, coarse[0]), min(near[-1] + _STEP, coarse[-1])
    knots = np.linspace(low, high, _FINE)
    fine = np.linspace(low, high, _REFINED)
    columns = sums(knots)
    columns[:, 1] = np.log(_Table(knots, columns, n, prior).squares())
    columns[:, 2] /= columns[:, 3]
    columns[:, 3] = np.log(columns[:, 3])
    smooth = CubicSpline(knots, columns)(fine)
    information = np.exp(smooth[:, 3])
    squares = np.exp(smooth[:, 1]) + smooth[:, 2] ** 2 * information
    rows = np.stack([smooth[:, 0], squares, smooth[:, 2] * information, information], axis=1)
    rest = np.array([-np.inf])
    return _Profiles(_Table(fine, rows, n, prior), _Table(rest, sums(rest), n, prior), unit).fit(
        reference
    )


@dataclass(frozen=True)
class _Table:
    """Sums of `whitened_sums` at values of log(D / c), the models that profiles choose from.

    Deviances are twice the negative restricted log-likelihood, which adds the logarithm of
    omega's information: it makes up for the omega that is estimated, so that D is not too small.
    """

    log_ratio: Floats
    sums: Floats
    n: int
    prior: NoisePrior

    def omega(self) -> Floats:
        best: Floats = self.sums[:, 2] / self.sums[:, 3]
        return best

    def squares(self) -> Floats:
        """Sum of whitened squares at the best omega, positive also for exact angles."""
        left: Floats = np.maximum(
            self.sums[:, 1] - self.sums[:, 2] ** 2 / self.sums[:, 3], _LEAST_SQUARES * self.n
        )
        return left

    def log_factor(self, omega: float | None = None) -> Floats:
        """Best log(c) of each model, at the best omega or a given one."""
        squares = self._squares_at(omega)
        freedom = self.n - 1
        found = np.log(squares / freedom)
        for _ in range(_NEWTON_STEPS):
            weighed = squares * np.exp(-found)
            slope = freedom - weighed + 2.0 * (found - self.prior.log_factor) / self.prior.sd**2
            found = found - slope / (weighed + 2.0 / self.prior.sd**2)
        return found

    def deviance(self, omega: float | None = None) -> Floats:
        """Deviance of the best c, at the best omega or a given one."""
        return self.deviance_at(self.log_factor(omega), omega)

    def deviance_at(self, log_factor: Floats, omega: float | None = None) -> Floats:
        """Deviance of each model at a c of its own."""
        freedom = self.n - 1
        return (
            self.sums[:, 0]
            + np.log(self.sums[:, 3])
            + freedom * log_factor
            + self._squares_at(omega) * np.exp(-log_factor)
            + self.prior.deviance(log_factor)
        )

    def _squares_at(self, omega: float | None) -> Floats:
        if omega is None:
            return self.squares()
        away: Floats = self.squares() + (omega - self.omega()) ** 2 * self.sums[:, 3]
        return away


@dataclass(frozen=True)
class _Profiles:
    """Profiles over a table of models and the one without diffusion.

    `unit` turns exp(log_ratio) into D / c.
    """

    models: _Table
    still: _Table
    unit: float

    def fit(self, reference: float) -> Fit:
        """Maximum and intervals; omega is counted from the reference speed."""
        models, still = self.models, self.still
        restricted = models.deviance()
        best = int(np.argmin(restricted))
        moves = restricted[best] < still.deviance()[0]
        chosen, at = (models, best) if moves else (still, 0)
        factor = float(np.exp(chosen.log_factor()[at]))
        diffusion = factor * self.unit * float(np.exp(chosen.log_ratio[at]))
        omega = float(chosen.omega()[at])
        sd = float(np.sqrt(factor / chosen.sums[at, 3]))
        low, high = self._diffusion_limits(diffusion, 1.0)
        relative_sd = 0.5 * (high - low) / diffusion if low > 0.0 else np.inf
        degrees = freedom(relative_sd)
        least = self._speed_deviance(omega)
        limit = profile_rise(degrees) + least
        at_rest = self._speed_deviance(-reference) - least
        d_low, d_high = self._diffusion_limits(diffusion, profile_rise(degrees))
        ends = [
            crossing(lambda v: self._speed_deviance(v) - limit, omega, side * sd)
            for side in (-1.0, 1.0)
        ]
        return Fit(
            omega_rad_s=reference + omega,
            omega_sd_rad_s=sd,
            omega_interval_rad_s=(reference + ends[0], reference + ends[1]),
            drift_p=drift_p(student_square(at_rest, degrees), degrees),
            diffusion_rad2_s=diffusion,
            diffusion_sd_rad2_s=0.5 * (high - low) if moves else high,
            diffusion_interval_rad2_s=(d_low if relative_sd <= IDENTIFIED else 0.0, d_high),
            diffusion_relative_sd=relative_sd,
            noise_factor=factor,
        )

    def _speed_deviance(self, omega: float) -> float:
        both = (table.deviance(omega).min() for table in (self.models, self.still))
        return float(min(both))

    def _diffusion_limits(self, diffusion: float, rise: float) -> tuple[float, float]:
        """D below and above the best where the restricted deviance has risen so far."""
        log_ratio = np.log(self.unit) + self.models.log_ratio
        still = float(self.still.deviance()[0])
        limit = min(still, float(self.models.deviance().min())) + rise

        def above(log_d: float) -> float:
            return float(self.models.deviance_at(log_d - log_ratio).min()) - limit

        start = np.log(diffusion) if diffusion > 0.0 else float(self._least_log_d())
        high = float(np.exp(crossing(above, start, 0.05)))
        if still <= limit:
            return 0.0, high
        return float(np.exp(crossing(above, start, -0.05))), high

    def _least_log_d(self) -> float:
        """Log of a D that is as good as none."""
        log_factor = self.still.log_factor()[0]
        return float(np.log(self.unit) + log_factor + self.models.log_ratio[0])
