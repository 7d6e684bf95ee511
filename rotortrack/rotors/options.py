"""Options of clustering and circle fits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class ClusterOptions(Options):
    """How localisations are grouped into rotors."""

    distance_nm: float | None = option(
        None, "spots closer than this join, nm (absent: chosen from the data)", gt=0
    )
    min_localisations: int = option(
        30, "clusters with fewer localisations are background, not rotors", ge=1
    )


@dataclass(frozen=True, kw_only=True)
class CircleOptions(Options):
    """How a circle is fitted to a rotor's localisations."""

    method: Literal["auto", "hyper", "kasa", "pratt", "taubin", "geometric"] = option(
        "auto", "circle fit (auto: hyper, and the likelihood of distances beyond 270 degrees)"
    )
    outlier_sd: float = option(
        4.0,
        "spots farther from the circle than this many robust standard deviations are left out of "
        "its fit (0: none are)",
        ge=0,
    )
