"""Options of motion analysis and screening."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class MotionOptions(Options):
    """How angles become speeds, diffusion coefficients and behaviours."""

    gap_mode: Literal["drop", "bridge"] = option(
        "drop", "steps across missing frames are left out, or counted like adjacent ones"
    )
    msd_lags: int | None = option(
        None, "number of lags in the MSD fit (absent: a quarter of the track)", ge=2
    )
    msd_noise: bool = option(
        False, "fit the constant 2 sigma^2 of localisation noise to the MSD as well"
    )
    driven_z: float = option(
        3.5, "standard deviations by which the speed of a driven rotor differs from zero", gt=0
    )
    stuck_turn_deg: float = option(
        30.0, "a rotor that neither drifts nor diffuses this far in the movie is stuck", ge=0
    )
    min_steps: int = option(20, "rotors with fewer steps stay unclassified", ge=2)
