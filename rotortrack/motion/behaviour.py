"""What a rotor does: driven, Brownian, stuck, or not known."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy import stats

from rotortrack.motion.diffusion import Diffusion
from rotortrack.motion.increments import StepSizes
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.speed import Speed

Behaviour = Literal["driven_ccw", "driven_cw", "brownian", "stuck", "unclassified"]

TOGGLING = 3.0
"""Pole strength above which a rotor is not called Brownian."""

_TWO_SIDED_95 = float(stats.norm.isf(0.025))


def classify(
    speed: Speed,
    diffusion: Diffusion,
    steps: StepSizes,
    duration_s: float,
    options: MotionOptions,
    *,
    pole_strength: float = 0.0,
) -> Behaviour:
    """Name the behaviour of one rotor, `unclassified` rather than wrong.

    - driven: the speed differs from zero by `driven_z` standard deviations (3.5: one undriven
      rotor in 2000 is called driven by chance) and turns the rotor by more than `stuck_turn_deg`
      in the movie.
    - stuck: neither the speed nor diffusion at the upper end of its 95 % interval turns it so far.
    - brownian: not driven, and diffusion at the lower end of its interval does.
    - unclassified: too few steps, D too uncertain to tell, a speed that wanders more than
      diffusion explains, two opposite poses visited more than diffusion does, or steps so wide
      (`StepSizes.folded`) that noise alone may make them: the angles of a stuck spot within the
      circle fitted to it are random in every frame.

    Parameters
    ----------
    speed, diffusion, steps
        Estimates of the rotor.
    duration_s
        Time from its first to its last frame, s.
    options
        Thresholds.
    pole_strength
        ``|mean exp(2 i theta)| sqrt(2 D T)``: of order 1 for a Brownian rotor (95th percentile
        1.4), above 4 for one that toggles between opposite poses.
    """
    measured = steps.n_steps >= options.min_steps and np.isfinite(speed.omega_sd_rad_s)
    if not measured or steps.folded:
        return "unclassified"
    least_turn = np.deg2rad(options.stuck_turn_deg)
    turned = abs(speed.omega_rad_s) * duration_s > least_turn
    if turned and speed.differs_from_zero(options.driven_z):
        return "driven_ccw" if speed.omega_rad_s > 0.0 else "driven_cw"
    margin = _TWO_SIDED_95 * diffusion.diffusion_sd_rad2_s
    low, high = (
        np.sqrt(2.0 * duration_s * max(diffusion.diffusion_rad2_s + sign * margin, 0.0))
        for sign in (-1.0, 1.0)
    )
    if high <= least_turn:
        return "stuck"
    if low > least_turn and speed.excess == 1.0 and pole_strength <= TOGGLING:
        return "brownian"
    return "unclassified"
