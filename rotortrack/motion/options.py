"""Options of motion analysis and screening."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class MotionOptions(Options):
    """How angles become speeds, diffusion coefficients and behaviours.

    Examples
    --------
    >>> import rotortrack as rt
    >>> rt.MotionOptions(estimator="increments").driven_z
    3.0
    """

    estimator: Literal["auto", "increments", "circular", "paper"] = option(
        "auto",
        "likelihood of the steps or of the directions on the circle (auto: the first where it is "
        "unbiased), or the paper's fit of the MSD, which has no sign and no error",
    )
    gap_mode: Literal["drop", "bridge", "model"] = option(
        "drop",
        "steps across missing frames are left out, counted like adjacent ones, or counted with the "
        "turns that the estimated speed makes in them",
    )
    msd_lags: int | None = option(
        None, "number of lags in the MSD fit (absent: a quarter of the track)", ge=2
    )
    msd_noise: bool = option(
        False, "fit the constant 2 sigma^2 of localisation noise to the MSD as well"
    )
    msd_covariance: bool = option(
        False, "fit the MSD also with the covariance of its lags, for honest errors (slow)"
    )
    driven_z: float = option(
        3.0, "standard deviations by which the speed of a driven rotor differs from zero", gt=0
    )
    stuck_turn_deg: float = option(
        30.0, "a rotor that neither drifts nor diffuses this far in the movie is stuck", ge=0
    )
    temperature_k: float = option(
        300.0, "absolute temperature that turns speed and diffusion into torque and power, K", gt=0
    )
    min_steps: int = option(20, "rotors with fewer steps stay unclassified", ge=2)
    switch_min_s: float = option(
        0.5, "least time between two switches of speed, s, and from the ends of a track", gt=0
    )
    switch_false_alarm: float = option(
        0.01, "part of the rotors that never switch in which a switch may be found", gt=0, le=0.2
    )
    voltage_min_s: float = option(
        0.2, "shortest stretch of constant voltage in a trace that counts as a step, s", gt=0
    )
    daq_first_edge: int = option(
        0, "edges of the camera's trigger in a trace before the one that began frame 0", ge=0
    )
