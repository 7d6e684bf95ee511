"""Options of end-to-end distances."""

from __future__ import annotations

from dataclasses import dataclass

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class EndsOptions(Options):
    """How both ends of a rotor become a distance."""

    reach_nm: float = option(
        600.0, "how far from a rotor's centre its second end is looked for, nm", gt=0
    )
    min_frames: int = option(
        50, "rotors with fewer frames that show both ends have no distance", ge=10
    )
    noise_prior: float = option(
        0.03, "relative error of the told noise; 0 takes it as known", ge=0, le=1
    )
    median_frames: int = option(40, "frames of the moving median", ge=1)
    self_calibrate: bool = option(
        True, "rigid turning rotors correct what is smooth over the field in the registration"
    )
    correct_registration: bool = option(
        False, "subtract the registration error that each rotor shows by itself, too"
    )
    pore_axis_deg: float | None = option(
        None,
        "long axis of elongated pores on the displayed image, counter-clockwise from the right",
        ge=-180,
        le=180,
    )
