"""Options of the comparison of rotors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


def _refused(value: bool) -> str | None:
    reason = (
        "cannot be on: frames of one rotor are not independent, so that a test on frames finds two "
        "halves of one population different; whole rotors are permuted instead"
    )
    return reason if value else None


@dataclass(frozen=True, kw_only=True)
class CompareOptions(Options):
    """How groups of rotors are compared with each other and with simulated rods."""

    min_frames: int = option(50, "frames with both ends that a rotor needs", ge=2)
    weights: Literal["cells", "shapes", "runs"] = option(
        "cells",
        "what of a scan counts the same: its cells (charge and flow), their shapes, or runs",
    )
    prior: str | None = option(
        None,
        "how probable the cells of the scan are, which allows p-values: `uniform`, or a CSV file "
        "with lambda_eff, flow_ratio, weight",
    )
    same_shape_nm: float = option(
        3.0, "runs of a cell whose shapes differ by less, rms, count once, nm", gt=0
    )
    noise: Literal["told", "fitted"] = option(
        "told", "noise that simulated distances get: by the uncertainties, or by the distances' fit"
    )
    twins: int = option(20, "simulated twins of each measured rotor", ge=1, le=1000)
    bin_nm: float = option(25.0, "width of the histograms' bins, nm", ge=1, le=500)
    axes: Literal["log", "linear", "rank"] = option(
        "log", "axes of speed against distance; rank ones have no slope"
    )
    resamples: int = option(2000, "resamples of the rotors for intervals", ge=100, le=100_000)
    permutations: int = option(1999, "permutations of the rotors for p-values", ge=99, le=100_000)
    test_frames: bool = option(
        False, "refused: frames of one rotor are not independent", check=_refused
    )
    seed: int = option(0, "seed of twins, resamples and permutations", ge=0)
