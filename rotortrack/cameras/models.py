"""Nominal values of scientific cameras, to start with when nothing was measured.

Written down from general knowledge of the makers' public data sheets and not yet compared with
them line by line; modes and revisions of a model differ, each camera differs by some per cent more,
and the offset is set by the user. A calibration from dark and flat frames is always better, and the
variance-mean slope (`photon_transfer`) tells when the gain is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CameraModel:
    """Nominal values of one camera in one read-out mode.

    Attributes
    ----------
    description
        Maker, model and mode.
    offset_adu, gain_e_per_adu, read_noise_e
        Bias in counts, photo-electrons per count, read noise in electrons rms.
    bits
        Depth of the converter, which sets the saturation.
    """

    description: str
    offset_adu: float
    gain_e_per_adu: float
    read_noise_e: float
    bits: int

    @property
    def saturation_adu(self) -> float:
        """Largest count of the converter."""
        return float(2**self.bits - 1)


MODELS = {
    "prime-bsi-12bit-cms": CameraModel(
        "Teledyne Photometrics Prime BSI, 12-bit CMS (nominal)", 100.0, 0.25, 1.1, 12
    ),
    "prime-bsi-16bit-hdr": CameraModel(
        "Teledyne Photometrics Prime BSI, 16-bit HDR (nominal)", 100.0, 0.70, 1.8, 16
    ),
    "prime-bsi-11bit-speed": CameraModel(
        "Teledyne Photometrics Prime BSI Express, 11-bit speed (nominal)", 100.0, 5.0, 3.4, 11
    ),
    "prime-95b-16bit-hdr": CameraModel(
        "Teledyne Photometrics Prime 95B, 16-bit HDR (nominal)", 100.0, 1.22, 1.8, 16
    ),
    "orca-flash4-v3": CameraModel(
        "Hamamatsu ORCA-Flash4.0 V3, 16-bit standard scan (nominal)", 100.0, 0.46, 1.6, 16
    ),
    "orca-fusion-bt": CameraModel(
        "Hamamatsu ORCA-Fusion BT, 16-bit ultra-quiet scan (nominal)", 100.0, 0.24, 0.7, 16
    ),
}
