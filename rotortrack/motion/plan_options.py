"""Options of the planning of a movie."""

from __future__ import annotations

from dataclasses import dataclass

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class PlanOptions(Options):
    """The rotor and the movie that are planned."""

    speed_deg_s: float | None = option(None, "speed that is to be resolved, deg/s", gt=0)
    diffusion_rad2_s: float | None = option(None, "rotational diffusion coefficient, rad^2/s", ge=0)
    radius_nm: float | None = option(None, "radius of the circle that the tip traces, nm", gt=0)
    photons: float | None = option(None, "photons of a spot in one frame", gt=0)
    background: float | None = option(None, "background, photons per pixel and frame", ge=0)
    sigma_nm: float | None = option(None, "width of a spot, nm", gt=0)
    localisation_sd_nm: float | None = option(
        None, "localisation error per axis, nm (absent: that of the photons)", gt=0
    )
    frames: int | None = option(None, "frames of the movie", ge=3)
    duration_s: float | None = option(None, "duration of the movie, s (instead of frames)", gt=0)
    detection: float = option(1.0, "part of the frames in which the rotor is seen", gt=0, le=1)
