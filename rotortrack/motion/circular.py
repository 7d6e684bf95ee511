"""Likelihood of a rotor's motion on the circle itself: wide noise, long gaps, many turns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from rotortrack.motion.grid import UNIFORM_SHARE, filter_densities
from rotortrack.motion.likelihood import (
    IDENTIFIED,
    Fit,
    drift_p,
    freedom,
    profile_rise,
    quantile,
)
from rotortrack.motion.linear import speed_information
from rotortrack.motion.optimum import Maximum, maximise, profile_end
from rotortrack.motion.readings import NoisePrior, Pace, Readings, Timing

Floats = NDArray[np.float64]

_LEAST_ANGLES = 48
MOST_ANGLES = 512
_WIDTH_IN_CELLS = 0.7
_REACH_SD = 5.0
_LONGEST_GAP = 32
_LEAST_STEP_IN_CELLS = 0.8
_GREATEST_STEP_VARIANCE = 4.0
_GRIDS = 3
_LEAST_VARIANCE = 1e-30
"""In rad^2: far below a cell, where all weight falls on the middle one, and still no zero."""


def angles_needed(pace: Pace, seen: Readings, timing: Timing) -> int:
    """Angles of a grid that resolves the filter's densities, without an upper bound.

    The product that a frame sums over has the width w of prediction, turn and reading together;
    with cells of 1.4 w the sum errs by 1e-4 of itself, now up, now down.
    """
    step = timing.step_variance(pace.diffusion_rad2_s)
    deviation = timing.deviation_variance(pace.diffusion_rad2_s)
    # The sharpest tenth of the readings decides.
    noise = pace.noise_factor / float(np.quantile(seen.concentration, 0.9))
    extra = step / 4.0 + deviation
    spread = extra + noise
    for _ in range(100):
        shared = spread + 0.5 * step
        spread = spread + step - shared**2 / (spread + extra + noise)
    width = 1.0 / np.sqrt(1.0 / spread + 1.0 / step + 0.25 / (noise + deviation))
    return int(np.ceil(2.0 * np.pi * _WIDTH_IN_CELLS / width / 16.0)) * 16


@dataclass(frozen=True)
class Grid:
    """Likelihood of the directions of one rotor on a grid of angles."""

    seen: Readings
    timing: Timing
    size: int

    def log_densities(self, pace: Pace) -> Floats:
        """Log density of each reading given those before it."""
        return self._filter(pace)[0]

    def _filter(self, pace: Pace) -> tuple[Floats, Floats]:
        seen = self.seen
        dt = self.timing.frame_interval_s
        sharpness = self.concentration(pace)
        offset = seen.frame - seen.frame[0]
        missed = np.diff(offset, prepend=-1) - 1
        step = self.timing.step_variance(pace.diffusion_rad2_s)
        longest = min(max(int(missed.max()), 1), _LONGEST_GAP)
        gap_turns = np.stack([self.circle_turns(step * n) for n in range(1, longest + 1)])
        gap_sd = np.sqrt(step * np.arange(1, longest + 1))
        reach = np.minimum(np.ceil(_REACH_SD * gap_sd / self.cell), self.size // 2)
        return filter_densities(
            seen.theta_rad - pace.omega_rad_s * dt * offset,
            missed,
            sharpness,
            (1.0 - UNIFORM_SHARE) / (2.0 * np.pi * special.i0e(sharpness)),
            self.turns(step),
            gap_turns,
            reach.astype(np.int64),
            self.size,
        )

    def residuals(self, pace: Pace) -> tuple[Floats, Floats]:
        """Standardised deviation of each reading from its prediction, and the direction predicted.

        The sine of the angle between both, over its standard deviation: of mean zero, of variance
        one and uncorrelated whatever the widths of noise and steps.
        """
        _, (cos_1, sin_1, cos_2, sin_2) = self._filter(pace)
        sharpness = self.concentration(pace)
        length = resultant(sharpness)
        turn = self.timing.step_variance(pace.diffusion_rad2_s)
        first = cos_1 + 1j * sin_1
        # The reading lies about the middle of the interval's ends, a quarter of the turn's variance
        # from its start.
        second = (cos_2 + 1j * sin_2) * (1.0 - 2.0 * length / sharpness) * np.exp(-0.5 * turn)
        ahead = np.angle(first)
        offset = self.seen.frame - self.seen.frame[0]
        drift = pace.omega_rad_s * self.timing.frame_interval_s * offset
        variance = 0.5 * (1.0 - (second * np.exp(-2j * ahead)).real)
        deviation = np.sin(self.seen.theta_rad - drift - ahead)
        return deviation / np.sqrt(variance), ahead + drift

    def false_readings(self, pace: Pace) -> NDArray[np.bool_]:
        """Find readings that are likelier a spot anywhere than the rotor."""
        anywhere = UNIFORM_SHARE / (2.0 * np.pi)
        found: NDArray[np.bool_] = self.log_densities(pace) < np.log(2.0 * anywhere)
        return found

    @property
    def cell(self) -> float:
        """Distance of two angles, rad."""
        return 2.0 * np.pi / self.size

    def concentration(self, pace: Pace) -> Floats:
        """Concentration of a reading about the middle of its interval's ends.

        That of the von Mises distribution with the mean resultant of the reading's own times
        that of the normal deviation of the exposure average.
        """
        own = self.seen.concentration / pace.noise_factor
        deviation = self.timing.deviation_variance(pace.diffusion_rad2_s)
        return inverse_resultant(resultant(own) * np.exp(-0.5 * deviation))

    def turns(self, step_variance: float) -> Floats:
        """Weights of turns by -2r to 2r - 1 cells, more than half a circle included."""
        reach = 2 * int(np.ceil(0.5 * _REACH_SD * np.sqrt(step_variance) / self.cell) + 1)
        reach = min(reach, self.size - 4)
        return _normal(self.cell * np.arange(-reach, reach), step_variance)

    def circle_turns(self, step_variance: float) -> Floats:
        """Weights of turns on the circle, -size/2 to size/2 cells, half of it at both ends."""
        half = self.size // 2
        angles = self.cell * np.arange(-half, half + 1)
        if step_variance > np.pi**2:
            harmonics = np.arange(1, 4)[:, np.newaxis]
            waves = np.exp(-0.5 * harmonics**2 * step_variance) * np.cos(harmonics * angles)
            weights = (1.0 + 2.0 * waves.sum(axis=0)) / self.size
        else:
            laps = 2.0 * np.pi * np.arange(-3, 4)[:, np.newaxis]
            spread = max(step_variance, _LEAST_VARIANCE)
            weights = np.exp(-0.5 * (angles + laps) ** 2 / spread).sum(axis=0)
        weights[[0, -1]] *= 0.5
        total: Floats = weights / weights.sum()
        return total


def _normal(angles: NDArray[np.floating], variance: float) -> Floats:
    weights = np.exp(-0.5 * angles**2 / max(variance, _LEAST_VARIANCE))
    total: Floats = weights / weights.sum()
    return total


def resultant(concentration: Floats) -> Floats:
    """Mean resultant length of a von Mises distribution."""
    ratio: Floats = special.i1e(concentration) / special.i0e(concentration)
    return ratio


def inverse_resultant(length: Floats) -> Floats:
    """Concentration of a von Mises distribution by its mean resultant length.

    The usual approximation and three steps of Newton: the length is met to 1e-8.
    """
    length = np.clip(length, 1e-9, 1.0 - 1e-12)
    found = length * (2.0 - length**2) / (1.0 - length**2)
    for _ in range(3):
        now = resultant(found)
        found = found - (now - length) / (1.0 - now**2 - now / found)
    return found


def fit_circular(
    seen: Readings, timing: Timing, starts: Sequence[Pace], prior: NoisePrior
) -> CircularFit:
    """Maximum of the likelihood on the circle, with profile intervals.

    Its parameters are omega, log D and the logarithm of the factor on the noise variances.

    Parameters
    ----------
    seen
        At least three readings, some in adjacent frames.
    timing
        Frame interval and exposure.
    starts
        First guesses, of which the most likely is taken.
    prior
        Of the factor on the noise variances.

    Notes
    -----
    Some 45 passes over the readings, each 3 to 10 ms for 8000 frames. Where the
    estimate needs a finer grid than its guess did, it is repeated.
    """
    trial = max(_grid_size(start, seen, timing) for start in starts)
    objective = _objective(Grid(seen, timing, trial), prior)
    found = max(starts, key=lambda start: objective(_point(start)))
    size = 0
    for _ in range(_GRIDS):
        needed = _grid_size(found, seen, timing)
        if needed <= size:
            break
        size = needed
        grid = Grid(seen, timing, size)
        maximum = _maximise(grid, found, prior)
        found = _pace(maximum.point)
    objective = _objective(grid, prior)
    relative_sd = float(maximum.sd[1])
    degrees = freedom(relative_sd)
    # The profile below keeps D where it is, as if it were known, so the limit is Student's.
    limit = quantile(degrees)
    omega = float(maximum.point[0])
    slope = maximum.covariance[:, 0] / maximum.covariance[0, 0]
    at_rest = 2.0 * (maximum.value - objective(maximum.point - slope * omega))
    rise = profile_rise(degrees)
    low, high = 0.0, float(np.exp(profile_end(objective, maximum, 1, rise, 1.0)))
    if relative_sd <= IDENTIFIED:
        low = float(np.exp(profile_end(objective, maximum, 1, rise, -1.0)))
    fit = Fit(
        omega_rad_s=omega,
        omega_sd_rad_s=float(maximum.sd[0]),
        omega_interval_rad_s=(
            profile_end(objective, maximum, 0, limit, -1.0),
            profile_end(objective, maximum, 0, limit, 1.0),
        ),
        drift_p=drift_p(at_rest, degrees),
        diffusion_rad2_s=found.diffusion_rad2_s,
        diffusion_sd_rad2_s=found.diffusion_rad2_s * relative_sd,
        diffusion_interval_rad2_s=(low, high),
        diffusion_relative_sd=relative_sd,
        noise_factor=found.noise_factor,
    )
    return CircularFit(fit, grid, maximum)


@dataclass(frozen=True)
class CircularFit:
    """Estimates, the grid that gave them and the maximum in (omega, log D, log factor)."""

    fit: Fit
    grid: Grid
    maximum: Maximum


def _pace(point: Floats) -> Pace:
    return Pace(float(point[0]), float(np.exp(point[1])), float(np.exp(point[2])))


def _point(pace: Pace) -> Floats:
    least = max(pace.diffusion_rad2_s, 1e-9)
    return np.array([pace.omega_rad_s, np.log(least), np.log(pace.noise_factor)])


def _grid_size(pace: Pace, seen: Readings, timing: Timing) -> int:
    """Angles for the smallest D and noise that intervals will reach."""
    least = Pace(pace.omega_rad_s, max(0.7 * pace.diffusion_rad2_s, 1e-9), 0.8 * pace.noise_factor)
    return min(max(angles_needed(least, seen, timing), _LEAST_ANGLES), MOST_ANGLES)


def _objective(grid: Grid, prior: NoisePrior) -> Callable[[Floats], float]:
    """Restricted log-likelihood: omega's information makes up for its being estimated."""

    def objective(point: Floats) -> float:
        pace = _pace(point)
        information = speed_information(
            grid.seen, grid.timing, pace.diffusion_rad2_s, pace.noise_factor
        )
        made_up = np.log(information) + float(prior.deviance(point[2]))
        return float(grid.log_densities(pace).sum() - 0.5 * made_up)

    return objective


def _maximise(grid: Grid, start: Pace, prior: NoisePrior) -> Maximum:
    timing, seen = grid.timing, grid.seen
    information = speed_information(seen, timing, start.diffusion_rad2_s, start.noise_factor)
    sd = np.array([information**-0.5, max(0.05, 2.0 * len(seen) ** -0.5), 0.1])
    least = timing.step_variance(1.0)
    bounds = np.array(
        [
            [-np.inf, np.log((_LEAST_STEP_IN_CELLS * grid.cell) ** 2 / least), -3.0],
            [np.inf, np.log(_GREATEST_STEP_VARIANCE / least), 3.0],
        ]
    )
    return maximise(_objective(grid, prior), np.clip(_point(start), *bounds), sd, bounds)
