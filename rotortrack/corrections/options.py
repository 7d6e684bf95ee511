"""Options of the corrections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class QualityOptions(Options):
    """Which localisations are precise enough."""

    max_uncertainty_nm: float = option(
        50.0, "localisations must be more certain than this, nm", gt=0
    )


@dataclass(frozen=True, kw_only=True)
class DriftOptions(Options):
    """How stage drift is estimated."""

    method: Literal["cross-correlation", "none"] = option(
        "cross-correlation", "how drift is estimated"
    )
    bins: int = option(10, "time bins with equal numbers of localisations", ge=2)
    magnification: float = option(5.0, "rendered pixels per camera pixel", gt=0)
    smoothing: float = option(0.25, "part of the bins in each LOESS window", gt=0, le=1)
    min_significance: float = option(
        2.0, "a drift is subtracted when it is this many times its own error (0: always)", ge=0
    )


@dataclass(frozen=True, kw_only=True)
class DensityOptions(Options):
    """Which localisations have enough neighbours in the whole movie."""

    radius_nm: float = option(50.0, "radius of the neighbourhood, nm", gt=0)
    min_neighbours: int = option(15, "neighbours closer than radius_nm, itself not counted", ge=0)
