"""Signed speed of a rotor from its steps, with a standard deviation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from rotortrack.motion.diffusion import Diffusion
from rotortrack.motion.increments import Increments

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_BLOCKS = 16
_STEPS_PER_BLOCK = 8
_FALSE_ALARM = 1e-3


@dataclass(frozen=True)
class Speed:
    """Signed angular speed.

    Attributes
    ----------
    omega_rad_s, omega_sd_rad_s
        Speed and standard deviation, rad/s, positive counter-clockwise on the displayed image.
    freedom
        Degrees of freedom of that standard deviation, which is itself estimated.
    excess
        Factor by which the variance was raised because the speed wanders more than diffusion
        explains; 1 for a steady rotor.
    """

    omega_rad_s: float
    omega_sd_rad_s: float
    freedom: float
    excess: float

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Two-sided confidence interval in rad/s."""
        half = float(stats.t.isf(0.5 - 0.5 * level, self.freedom)) * self.omega_sd_rad_s
        return self.omega_rad_s - half, self.omega_rad_s + half

    def differs_from_zero(self, z: float) -> bool:
        """Whether the speed is as significant as z standard deviations of a normal variable."""
        if not self.omega_sd_rad_s >= 0.0:
            return False
        needed = float(stats.t.isf(stats.norm.sf(z), self.freedom))
        return abs(self.omega_rad_s) > needed * self.omega_sd_rad_s


def estimate_speed(
    moves: Increments, diffusion: Diffusion, *, frame_interval_s: float, exposure_s: float
) -> Speed:
    """Mean displacement over time, its runs weighted by how well each tells the speed.

    A run of n frame intervals turns by ``omega n dt`` with variance
    ``2 D dt (n - 2 Rb) + 2 sigma^2``: diffusion, shortened by the exposure, and the noise of its
    two ends. Runs are independent, so weights n / variance are best; without gaps this is
    displacement over time. The variance contains the part of it that stems from diffusion, so
    the interval covers the drift of the rotor and not the mean of this one trajectory.

    The model's variance is checked against the scatter of block displacements: where that is
    too large for chance (0.1 %), as when a rotor switches direction, the variance is raised to it.

    Parameters
    ----------
    moves
        Steps of one rotor.
    diffusion
        D and noise from the steps between adjacent frames.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.

    Returns
    -------
    Speed
        nan without steps; the standard deviation is nan where D is unknown.
    """
    if len(moves) == 0:
        return Speed(np.nan, np.nan, np.nan, np.nan)
    blur_s = exposure_s / 3.0
    _, run = np.unique(moves.run, return_inverse=True)
    turned = np.bincount(run, moves.step_rad)
    lasted_s = np.bincount(run, moves.frames_apart) * frame_interval_s
    # Variance as a linear form in (D, sigma^2), one column a run.
    form = np.stack([2.0 * (lasted_s - blur_s), np.full_like(lasted_s, 2.0)])
    variances = np.array([diffusion.cautious_rad2_s, diffusion.noise_variance_rad2])
    variance = variances @ form
    usable = np.isfinite(variance).all() and variance.all()
    weight = lasted_s / variance if usable else np.ones_like(lasted_s)
    per_turn = weight / (weight @ lasted_s)
    omega = float(per_turn @ turned)
    form_of_omega = form @ per_turn**2
    omega_variance = float(form_of_omega @ variances)
    uncertainty = float(form_of_omega @ diffusion.covariance @ form_of_omega)
    freedom = 2.0 * omega_variance**2 / uncertainty if uncertainty > 0.0 else np.inf
    excess, blocks = _excess(moves, run, omega, variances, frame_interval_s, blur_s)
    if excess > 1.0:
        freedom = min(freedom, blocks - 1.0)
    return Speed(omega, float(np.sqrt(excess * omega_variance)), freedom, excess)


def _excess(
    moves: Increments,
    run: Integers,
    omega: float,
    variances: Floats,
    frame_interval_s: float,
    blur_s: float,
) -> tuple[float, int]:
    """Return the scatter of block displacements over the model's if it is beyond chance, else 1."""
    blocks = min(_BLOCKS, len(moves) // _STEPS_PER_BLOCK)
    if blocks < 4:
        return 1.0, blocks
    block = np.arange(len(moves)) * blocks // len(moves)
    lasted_s = np.bincount(block, moves.frames_apart) * frame_interval_s
    strayed = np.bincount(block, moves.step_rad) - omega * lasted_s
    # A block may hold pieces of several runs; each piece has two noisy ends of its own.
    pieces = 1 + np.count_nonzero((np.diff(run) != 0) | (np.diff(block) != 0))
    expected = variances @ [2.0 * (lasted_s.sum() - pieces * blur_s), 2.0 * pieces]
    if not expected > 0.0:
        return 1.0, blocks
    excess = float(strayed @ strayed / expected)
    # Blocks that share a noisy end are anticorrelated, which widens the scatter by 3/2 at most.
    freedom = (blocks - 1.0) / 1.5
    chance = float(stats.chi2.isf(_FALSE_ALARM, freedom)) / freedom
    return (excess, blocks) if excess > chance else (1.0, blocks)
