"""What a rotor does: driven, Brownian, stuck, or not known."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from rotortrack.motion.estimate import MotionEstimate
from rotortrack.motion.increments import StepSizes
from rotortrack.motion.options import MotionOptions

Floats = NDArray[np.float64]

Behaviour = Literal["driven_ccw", "driven_cw", "brownian", "stuck", "unclassified"]

TOGGLING = 3.0
"""|mean exp(2 i theta)| sqrt(2 D T) above which a rotor is not called Brownian."""


def classify(
    estimate: MotionEstimate,
    steps: StepSizes,
    theta_rad: Floats,
    duration_s: float,
    options: MotionOptions,
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
    estimate, steps
        Estimates of the rotor.
    theta_rad
        Its angles.
    duration_s
        Time from its first to its last frame, s.
    options
        Thresholds.
    """
    fit = estimate.fit
    if steps.n_steps < options.min_steps or not np.isfinite(fit.omega_sd_rad_s) or steps.folded:
        return "unclassified"
    least_turn = np.deg2rad(options.stuck_turn_deg)
    turned = abs(fit.omega_rad_s) * duration_s > least_turn
    if turned and fit.drift_p < 2.0 * stats.norm.sf(options.driven_z):
        return "driven_ccw" if fit.omega_rad_s > 0.0 else "driven_cw"
    low, high = (
        np.sqrt(2.0 * duration_s * max(bound, 0.0)) for bound in fit.diffusion_interval_rad2_s
    )
    if high <= least_turn:
        return "stuck"
    # Time averages of exp(2 i theta) scatter by 1 / sqrt(2 D T) for a rotor that only diffuses.
    spread = np.sqrt(2.0 * fit.diffusion_rad2_s * duration_s)
    poles = float(abs(np.exp(2j * theta_rad).mean()) * spread)
    if low > least_turn and not estimate.resampled and poles <= TOGGLING:
        return "brownian"
    return "unclassified"
