"""Options that describe the camera."""

from __future__ import annotations

from dataclasses import dataclass

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class CameraOptions(Options):
    """How counts become photo-electrons: three numbers, a file of maps, or a nominal model."""

    camera_model: str | None = option(None, "nominal values of a camera by name")
    camera_maps: str | None = option(
        None, "file (.npz) with per-pixel offset_adu, gain_e_per_adu and read_noise_e"
    )
    offset_adu: float | None = option(None, "counts of a dark pixel, ADU")
    gain_e_per_adu: float | None = option(None, "photo-electrons per count", gt=0)
    read_noise_e: float | None = option(None, "read noise, electrons rms", ge=0)
    saturation_adu: float | None = option(
        None,
        "counts from which a pixel is saturated, ADU (absent: the most the file can hold)",
        gt=0,
    )
