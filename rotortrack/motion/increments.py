"""Steps of one rotor: which of them count, and how they are distributed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.motion.angles import GapMode, step

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
    """Normal distribution fitted to steps between adjacent frames.

    Attributes
    ----------
    mean_rad, sd_rad
        Mean and standard deviation (n - 1), rad; nan with too few steps.
    n_steps
        Number of steps.
    folded_gaps
        Whether such steps, grown over the gaps that are bridged, outgrow the 180-degree rule in
        more than 5 % of all steps.
    """

    mean_rad: float
    sd_rad: float
    n_steps: int
    folded_gaps: bool = False

    @property
    def folded(self) -> bool:
        """Whether the 180-degree rule visibly shortens steps (by 5 % and more)."""
        wide = self.sd_rad > WIDE_STEP_RAD or abs(self.mean_rad) > LONG_STEP_RAD
        return bool(wide or self.folded_gaps)


def increments(frame: Integers, theta_rad: Floats, gap_mode: GapMode) -> Increments:
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
    """
    apart = np.diff(frame)
    steps = step(theta_rad[:-1], theta_rad[1:])
    if gap_mode == "bridge":
        return Increments(steps, apart, np.zeros(apart.size, np.int64))
    adjacent = apart == 1
    return Increments(steps[adjacent], apart[adjacent], np.cumsum(~adjacent)[adjacent])


def step_sizes(moves: Increments) -> StepSizes:
    """Fit a normal distribution to the steps between adjacent frames."""
    adjacent = moves.step_rad[moves.frames_apart == 1]
    mean = float(adjacent.mean()) if adjacent.size else np.nan
    sd = float(adjacent.std(ddof=1)) if adjacent.size > 1 else np.nan
    apart = moves.frames_apart
    outgrown = (abs(mean) * apart > LONG_STEP_RAD) | (sd * np.sqrt(apart) > WIDE_STEP_RAD)
    return StepSizes(
        mean_rad=mean,
        sd_rad=sd,
        n_steps=adjacent.size,
        folded_gaps=bool(len(moves) and np.mean(outgrown & (apart > 1)) > FOLDED_SHARE),
    )
