"""Steps of one rotor: which of them count, and how they are distributed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.motion.angles import GapMode, consecutive_steps

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

WIDE_STEP_RAD = np.deg2rad(55.0)
LONG_STEP_RAD = np.deg2rad(90.0)
FOLDED_SHARE = 0.05


@dataclass(frozen=True)
class Increments:
    """Steps of one rotor in order of time.

    Attributes
    ----------
    step_rad
        Steps by the 180-degree rule, rad.
    frames_apart
        Frames between both ends of each step, 1 between adjacent frames.
    run
        Number of the unbroken run that each step belongs to, ascending.
    """

    step_rad: Floats
    frames_apart: Integers
    run: Integers

    def __len__(self) -> int:
        return self.step_rad.size


@dataclass(frozen=True)
class StepSizes:
    """Normal and wrapped normal distribution fitted to steps between adjacent frames.

    Attributes
    ----------
    mean_rad, sd_rad
        Mean and standard deviation (n - 1), rad; nan with too few steps.
    n_steps
        Number of steps.
    folded_gaps
        Whether such steps, grown over the gaps that are bridged, outgrow the 180-degree rule in
        more than 5 % of all steps.
    wrapped_mean_rad, wrapped_sd_rad
        Mean and standard deviation of the wrapped normal distribution, rad, which the 180-degree
        rule does not shorten. A mean and one that is larger by a whole turn cannot be told apart.
    wrapped_mean_sd_rad, wrapped_sd_sd_rad
        Their standard deviations, rad, as if steps were independent: localisation noise makes
        adjoining steps undo each other in part, and the mean better than that.
    """

    mean_rad: float
    sd_rad: float
    n_steps: int
    folded_gaps: bool = False
    wrapped_mean_rad: float = np.nan
    wrapped_sd_rad: float = np.nan
    wrapped_mean_sd_rad: float = np.nan
    wrapped_sd_sd_rad: float = np.nan

    @property
    def folded(self) -> bool:
        """Whether the 180-degree rule visibly shortens steps (by 5 % and more)."""
        # The rule folds wide steps back, so that their own spread stays below 104 degrees.
        sd = np.fmax(self.sd_rad, self.wrapped_sd_rad)
        mean = np.fmax(abs(self.mean_rad), abs(self.wrapped_mean_rad))
        return bool(sd > WIDE_STEP_RAD or mean > LONG_STEP_RAD or self.folded_gaps)


def increments(
    frame: Integers,
    theta_rad: Floats,
    gap_mode: GapMode,
    turn_per_frame_rad: float | None = None,
) -> Increments:
    """List the steps between the frames of one rotor.

    Parameters
    ----------
    frame
        Frame numbers, ascending without repeats.
    theta_rad
        Angles, rad.
    gap_mode
        "drop": steps between adjacent frames only, each gap starts a new run.
        "bridge": steps between all consecutive rows, in one run. A gap in which the rotor turns
        by more than half a turn makes it look slower than it is.
        "model": the same, but a step across a gap takes the turn nearest to the expected one.
    turn_per_frame_rad
        Expected turn in one frame for "model", as for `angles.consecutive_steps`.
    """
    apart = np.diff(frame)
    steps = consecutive_steps(theta_rad, frame, gap_mode, turn_per_frame_rad)
    if gap_mode != "drop":
        return Increments(steps, apart, np.zeros(apart.size, np.int64))
    adjacent = apart == 1
    return Increments(steps[adjacent], apart[adjacent], np.cumsum(~adjacent)[adjacent])


def step_sizes(moves: Increments) -> StepSizes:
    """Fit a normal and a wrapped normal distribution to the steps between adjacent frames.

    The latter follows from ``C = mean exp(i step)``: ``mu = arg C``, ``s^2 = -2 ln |C|``,
    ``sd(mu)^2 = sinh(s^2) / n`` and ``sd(s)^2 = 2 sinh(s^2 / 2)^2 / (n s^2)``.
    Source: Mardia and Jupp, Directional Statistics (2000), section 4.8.
    """
    adjacent = moves.step_rad[moves.frames_apart == 1]
    n = adjacent.size
    mean = float(adjacent.mean()) if n else np.nan
    sd = float(adjacent.std(ddof=1)) if n > 1 else np.nan
    wrapped = _wrapped_normal(adjacent) if n > 1 else (np.nan,) * 4
    apart = moves.frames_apart
    outgrown = (abs(mean) * apart > LONG_STEP_RAD) | (sd * np.sqrt(apart) > WIDE_STEP_RAD)
    return StepSizes(
        mean_rad=mean,
        sd_rad=sd,
        n_steps=n,
        folded_gaps=bool(len(moves) and np.mean(outgrown & (apart > 1)) > FOLDED_SHARE),
        wrapped_mean_rad=wrapped[0],
        wrapped_sd_rad=wrapped[1],
        wrapped_mean_sd_rad=wrapped[2],
        wrapped_sd_sd_rad=wrapped[3],
    )


def _wrapped_normal(steps: Floats) -> tuple[float, float, float, float]:
    """Mean, standard deviation, and the standard deviations of both."""
    resultant = np.exp(1j * steps).mean()
    # 1 - |C| and 1 - |C|^2 vanish with the spread: taken about the mean direction, they keep it.
    mean = float(np.angle(resultant))
    spread = float(2.0 * np.mean(np.sin(0.5 * (steps - mean)) ** 2))
    if spread >= 1.0:
        return np.nan, np.nan, np.nan, np.nan
    variance = -2.0 * np.log1p(-spread)
    sd = float(np.sqrt(variance))
    if sd == 0.0:
        return mean, 0.0, 0.0, 0.0
    root = float(np.sqrt(steps.size))
    with np.errstate(over="ignore"):
        mean_sd = float(np.sqrt(np.sinh(variance)) / root)
        sd_sd = float(np.sqrt(2.0) * np.sinh(0.5 * variance) / (sd * root))
    return mean, sd, mean_sd, sd_sd
