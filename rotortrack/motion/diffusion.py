"""Diffusion coefficient and noise of a turning angle from its steps.

An angle that drifts, diffuses with D, is averaged over the exposure and read with a noise of
sigma has steps that are Gaussian with variance ``2 D dt (1 - 2 Rb) + 2 sigma^2`` and lag-1
covariance ``2 Rb D dt - sigma^2``, where ``Rb = exposure / (6 dt)``; further steps are
independent. The sine transform makes the steps of an unbroken run independent, so that the
likelihood of the covariance costs O(N log N) and gaps only end runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, optimize

from rotortrack.motion.increments import Increments

Floats = NDArray[np.float64]

_GRID_STEP = 1.5
_LEAST_LOG_RATIO = -9.0


@dataclass(frozen=True)
class Diffusion:
    """Diffusion coefficient and noise of one angle.

    Attributes
    ----------
    diffusion_rad2_s, diffusion_sd_rad2_s
        D and its standard deviation. Where D = 0 the latter is the D that is less likely by
        exp(-1/2), since a curvature says nothing at a bound.
    noise_variance_rad2
        sigma^2 of one angle's reading noise.
    covariance
        Covariance of (D, sigma^2), shape (2, 2).
    """

    diffusion_rad2_s: float
    diffusion_sd_rad2_s: float
    noise_variance_rad2: float
    covariance: Floats

    @property
    def cautious_rad2_s(self) -> float:
        """D, or at the bound its standard deviation, for error bars that must not vanish."""
        return self.diffusion_rad2_s or self.diffusion_sd_rad2_s


UNKNOWN = Diffusion(np.nan, np.nan, np.nan, np.full((2, 2), np.nan))


def estimate_diffusion(
    moves: Increments, *, frame_interval_s: float, exposure_s: float
) -> Diffusion:
    """Maximum-likelihood D >= 0 and sigma^2 >= 0 from the steps of one rotor.

    It fits the covariance whose two numbers the covariance-based estimator (CVE) takes from
    lag-0 and lag-1 products alone. All scales tell D where noise exceeds the diffusion of a
    frame: at 8000 steps, D 2 rad^2/s and sigma 0.2 rad its standard deviation is 5 %, where the
    CVE has 17 %.

    Parameters
    ----------
    moves
        Steps of one rotor. Bridged ones enter with their mean duration, which keeps D unbiased
        as long as the rotor turns by less than half a turn in a gap.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.

    Returns
    -------
    Diffusion
        All nan with fewer than three steps, and when no two steps adjoin: then diffusion and
        noise look alike.

    Notes
    -----
    Cost: one sine transform a run and some 30 passes over the steps; 10 ms for 20 000.
    Sources: Berglund, PRE 82, 011917 (2010); Vestergaard et al., PRE 89, 022726 (2014).
    """
    if len(moves) < 3 or np.unique(moves.run).size == len(moves):
        return UNKNOWN
    apart = moves.frames_apart
    pace = moves.step_rad.sum() / apart.sum()
    power, rise = _spectrum(moves.step_rad - pace * apart, moves.run)
    flat = apart.mean() - exposure_s / (3.0 * frame_interval_s) * rise
    if not power.any():
        return Diffusion(0.0, 0.0, 0.0, np.zeros((2, 2)))

    # Expected power: flat * 2 D dt + rise * 2 sigma^2. For a given ratio of these two variances
    # the best scale is known, which leaves one dimension to search.
    def scale(log_ratio: float) -> float:
        return float(np.mean(power / (flat + np.exp(log_ratio) * rise)))

    def deviance(log_ratio: float) -> float:
        shape = flat + np.exp(log_ratio) * rise
        return float(power.size * np.log(np.mean(power / shape)) + np.log(shape).sum())

    longest = float(np.bincount(moves.run - moves.run[0]).max())
    grid = np.arange(_LEAST_LOG_RATIO, np.log(1e3 * longest**2) + _GRID_STEP, _GRID_STEP)
    on_grid = np.array([deviance(log_ratio) for log_ratio in grid])
    best = int(np.argmin(on_grid))
    found = optimize.minimize_scalar(
        deviance,
        bounds=(grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]),
        method="bounded",
        options={"xatol": 1e-4},
    )
    noise_alone = float(np.mean(power / rise))
    at_zero = power.size * np.log(noise_alone) + np.log(rise).sum()
    if found.fun < at_zero - 1e-6:
        diffusive = scale(found.x)
        noisy = np.exp(found.x) * diffusive
        covariance = _covariance(flat, rise, diffusive * flat + noisy * rise)
    else:
        diffusive, noisy = 0.0, noise_alone
        # The deviance is twice the log-likelihood ratio, so exp(-1/2) lies one above its least.
        unlikely = np.flatnonzero(on_grid > at_zero + 1.0)
        edge = float(grid[unlikely[-1]] if unlikely.size else grid[0])
        if unlikely.size and unlikely[-1] + 1 < grid.size:
            edge = optimize.brentq(
                lambda log_ratio: deviance(log_ratio) - at_zero - 1.0, edge, edge + _GRID_STEP
            )
        covariance = np.diag([scale(edge) ** 2, 2.0 * noisy**2 / power.size])
    per_variance = np.array([1.0 / (2.0 * frame_interval_s), 0.5])
    covariance = covariance * np.outer(per_variance, per_variance)
    return Diffusion(
        diffusion_rad2_s=float(diffusive * per_variance[0]),
        diffusion_sd_rad2_s=float(np.sqrt(covariance[0, 0])),
        noise_variance_rad2=float(noisy * per_variance[1]),
        covariance=covariance,
    )


def _spectrum(step: Floats, run: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Return power on the sine basis of each run and ``1 - cos(pi k / (n + 1))`` beside it.

    Runs of one length are transformed together, because gappy tracks have thousands of them.
    """
    starts = np.flatnonzero(np.diff(run, prepend=run[0] - 1))
    lengths = np.diff(starts, append=step.size)
    powers, rises = [], []
    for length in np.unique(lengths):
        rows = step[starts[lengths == length][:, np.newaxis] + np.arange(length)]
        powers.append((fft.dst(rows, type=1, norm="ortho", axis=1) ** 2).ravel())
        half = 0.5 * np.pi * np.arange(1, length + 1) / (length + 1)
        rises.append(np.tile(2.0 * np.sin(half) ** 2, rows.shape[0]))
    return np.concatenate(powers), np.concatenate(rises)


def _covariance(flat: Floats, rise: Floats, expected: Floats) -> Floats:
    """Invert the Fisher information of the two variances, given the expected power."""
    relative = np.stack([flat, rise]) / expected
    information = 0.5 * relative @ relative.T
    covariance: Floats = np.linalg.inv(information).astype(np.float64)
    return covariance
