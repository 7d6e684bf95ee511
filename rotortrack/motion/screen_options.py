"""Options of the screening of rotors."""

from __future__ import annotations

from dataclasses import dataclass

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class ScreenOptions(Options):
    """Which rotors are measured."""

    min_frames: int = option(100, "frames with a localisation that a rotor needs", ge=1)
    min_detection: float = option(
        0.05, "part of all frames in which a rotor must have been localised", ge=0, le=1
    )
    max_duplicates: float = option(
        0.1, "part of a rotor's frames that may hold a second localisation", ge=0, le=1
    )
    max_gap: float = option(
        0.5, "part of all frames for which a rotor may vanish before it is seen again", gt=0, le=1
    )
    max_fragment: float = option(
        0.1, "part of a rotor's localisations that may lie in other clusters", ge=0, le=1
    )
    max_intensity_step: float = option(
        1.4, "intensity may rise in a step by less than this factor", gt=1
    )
    max_intensity_fall: float = option(
        1.5, "intensity may fall in a step by less than this factor", gt=1
    )
    min_spread: float = option(
        1.3, "spread of the positions per axis over their localisation uncertainty", ge=0
    )
    min_ring_evidence: float = option(
        6.0, "difference of information criteria by which a ring must be preferred to a blob", ge=0
    )
    arc_elongation: float = option(
        1.3, "a blob stretched by this factor is a short arc and not an immobile spot", ge=1
    )
    min_arc_deg: float = option(90.0, "part of its circle that a rotor must visit", ge=0, le=360)
    max_residual: float = option(
        4.0, "scatter about the circle over the localisation uncertainty", gt=0
    )
    max_radius_error: float = option(0.2, "standard deviation of the radius over the radius", gt=0)
    max_two_rings: float = option(
        6.0, "difference of information criteria from which on two rings are seen", ge=0
    )
    max_centre_motion: float = option(
        0.15, "rms motion of the circle's centre per axis over the radius", gt=0
    )
    max_common_motion_nm: float = option(
        10.0, "rms motion of all centres together, nm, above which drift was left", gt=0
    )
    neighbour_margin_nm: float | None = option(
        None,
        "gap that must lie between the circles of two rotors, nm (absent: five widths of a spot)",
        ge=0,
    )
    neighbour_share: float = option(
        0.1, "a neighbour counts when it has this part of the rotor's localisations", ge=0
    )
