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


@dataclass(frozen=True, kw_only=True)
class CircleOptions(Options):
    """How a circle is fitted to a rotor's localisations."""

    method: Literal["hyper", "kasa", "pratt", "taubin", "geometric"] = option(
        "hyper", "circle fit"
    )
