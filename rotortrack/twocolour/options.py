"""Options of the registration of two colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


def _pair(value: tuple[float, ...]) -> str | None:
    return None if len(value) == 2 else f"must be two numbers x, y, not {list(value)}"


@dataclass(frozen=True, kw_only=True)
class RegisterOptions(Options):
    """How beads are paired, and the kind of the map."""

    model: Literal["auto", "affine", "polynomial", "spline", "local-mean"] = option(
        "auto", "kind of the map; auto takes what predicts left-out beads best"
    )
    order: Literal[1, 2, 3, 4, 5] | None = option(
        None, "order of the polynomial (absent: what predicts left-out beads best)"
    )
    neighbours: int = option(25, "beads of each part of a local-mean map", ge=12, le=200)
    shift_nm: tuple[float, float] | None = option(
        None, "shift of the second colour's image, x and y (absent: found)", check=_pair
    )
    max_shift_nm: float = option(6000.0, "largest shift that is looked for", gt=0)
    mirror: Literal["auto", "none", "left-right", "top-bottom"] = option(
        "auto", "how the second colour's image is flipped"
    )
    max_uncertainty_nm: float = option(5.0, "largest uncertainty of a bead", gt=0)
    min_separation_px: float = option(
        5.0, "beads with another one this close are left out, pixels", ge=0
    )
