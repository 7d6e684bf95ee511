"""The numbers of a closed loop: how often right, how far off, and whether the errors are honest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import pandas as pd

from rotortrack.tradeoff.score import MEASURED, Score

Aim = Literal["high", "low", "one", "zero", "nominal"]

AIMS: Final[dict[str, tuple[str, Aim]]] = {
    "recall": ("spots found", "high"),
    "precision": ("found spots that are true", "high"),
    "rmse_nm": ("error of a position, nm rms per axis", "low"),
    "rmse_over_bound": ("the same over the Cramer-Rao bound", "low"),
    "position_pull": ("the same over what is reported, rms", "one"),
    "rotors_found": ("rotors found", "high"),
    "verdict_accuracy": ("verdicts right", "high"),
    "behaviour_accuracy": ("behaviours right, of kept rotors", "high"),
    "stuck_called_driven": ("stuck rotors called driven", "low"),
    "speed_coverage": ("95 % intervals of speed that hold the truth", "nominal"),
    "speed_pull": ("errors of speed over reported ones, rms", "one"),
    "speed_rmse_deg_s": ("error of a signed speed, deg/s rms", "low"),
    "wrong_direction": ("driven rotors said to turn the other way", "low"),
    "diffusion_coverage": ("95 % intervals of D that hold the truth", "nominal"),
    "diffusion_bias": ("median relative error of D", "zero"),
    "radius_bias": ("median relative error of the radius", "zero"),
    "radius_rmse_nm": ("error of the radius, nm rms", "low"),
    "radius_pull": ("errors of the radius over reported ones, rms", "one"),
    "centre_rmse_nm": ("error of the centre, nm rms per axis", "low"),
}
"""What each number is, and where it should be."""

_NOMINAL = 0.95
_Z = 1.959963984540054


@dataclass(frozen=True)
class Measure:
    """One number with its 95 % interval.

    Attributes
    ----------
    value, low, high
        nan where the analysis tells nothing of the kind.
    n
        Of how many spots or rotors.
    """

    value: float
    low: float
    high: float
    n: int


def summarise(scores: Sequence[Score]) -> dict[str, Measure]:
    """Pool films.

    Returns
    -------
    dict
        A measure for each name of `AIMS`.
    """
    spots = {name: sum(score.spots[name] for score in scores) for name in scores[0].spots}
    rotors = pd.concat([score.rotors for score in scores], ignore_index=True)
    numbers = {
        "recall": share(spots["matched"], spots["true"]),
        "precision": share(spots["matched"], spots["found"]),
        "rmse_nm": rms(spots["square_nm2"], spots["errors"]),
        "rmse_over_bound": rms(spots["square_over_bound"], spots["errors"]),
        "position_pull": rms(spots["square_over_sd"], spots["with_sd"]),
        "rotors_found": share(rotors["found"].sum(), len(rotors)),
    }
    judged = rotors[rotors["expected"] != ""]
    verdicts = judged["found_verdict"].fillna("refused")
    numbers["verdict_accuracy"] = share((verdicts == judged["expected"]).sum(), len(judged))
    kept = rotors[rotors["found"] & (rotors["found_verdict"] == "kept") & ~rotors["double"]]
    named = kept[(kept["behaviour"] != "") & (kept["motion"] != "stuck")]
    right = (named["found_behaviour"] == named["behaviour"]).sum()
    numbers["behaviour_accuracy"] = share(right, len(named))
    stuck = rotors[rotors["motion"] == "stuck"]
    driven = stuck["found_behaviour"].fillna("").str.startswith("driven")
    told = driven & (stuck["found_verdict"] == "kept")
    numbers["stuck_called_driven"] = share(told.sum(), len(stuck))
    moving = kept[kept["motion"].isin(MEASURED)]
    return {**numbers, **_of_motion(moving), **_of_circles(moving)}


def better(name: str, first: Measure, second: Measure) -> bool:
    """Tell whether the first of two measures is nearer to where it should be, or as near."""
    return _miss(name, first.value) <= _miss(name, second.value)


def share(hits: float, n: float) -> Measure:
    """Give a share with Wilson's interval."""
    if not n:
        return Measure(math.nan, math.nan, math.nan, 0)
    value = float(hits / n)
    centre = (value + _Z**2 / (2.0 * n)) / (1.0 + _Z**2 / n)
    half = _Z / (1.0 + _Z**2 / n) * math.sqrt(value * (1 - value) / n + _Z**2 / (4.0 * n**2))
    return Measure(value, centre - half, centre + half, int(n))


def rms(square: float, n: float) -> Measure:
    """Give a root mean square with the interval that normal errors have."""
    if not n:
        return Measure(math.nan, math.nan, math.nan, 0)
    value = math.sqrt(square / n)
    half = _Z * value / math.sqrt(2.0 * n)
    return Measure(value, value - half, value + half, int(n))


def _of_motion(moving: pd.DataFrame) -> dict[str, Measure]:
    error = moving["found_omega_rad_s"] - moving["mean_omega_rad_s"]
    degrees = np.degrees(error.dropna())
    truth_deg_s = np.degrees(moving["mean_omega_rad_s"])
    low, high = moving["found_speed_ci_low_deg_s"], moving["found_speed_ci_high_deg_s"]
    told = (low <= high) & np.isfinite(high - low)
    inside = ((low <= truth_deg_s) & (truth_deg_s <= high))[told]
    pulls = (error / moving["found_omega_sd_rad_s"]).replace([np.inf, -np.inf], np.nan).dropna()
    driven = moving[moving["motion"] == "driven"]
    wrong = driven["found_omega_rad_s"] * driven["mean_omega_rad_s"] < 0.0
    d, d_true = moving["found_diffusion_rad2_s"], moving["diffusion_rad2_s"]
    d_low, d_high = (moving[f"found_diffusion_ci_{end}_rad2_s"] for end in ("low", "high"))
    d_told = d_low <= d_high
    d_inside = ((d_low <= d_true) & (d_true <= d_high))[d_told]
    return {
        "speed_coverage": share(inside.sum(), len(inside)),
        "speed_pull": rms(float((pulls**2).sum()), len(pulls)),
        "speed_rmse_deg_s": rms(float((degrees**2).sum()), len(degrees)),
        "wrong_direction": share(wrong.sum(), len(driven)),
        "diffusion_coverage": share(d_inside.sum(), len(d_inside)),
        "diffusion_bias": middle((d / d_true - 1.0).dropna()),
    }


def _of_circles(moving: pd.DataFrame) -> dict[str, Measure]:
    radius = moving["found_radius_nm"] - moving["radius_nm"]
    pulls = (radius / moving["found_radius_sd_nm"]).replace([np.inf, -np.inf], np.nan).dropna()
    offsets = pd.concat(
        [
            moving[f"found_{axis}_nm"] - moving[f"stage_{axis}_nm"] - moving[f"{axis}_nm"]
            for axis in "xy"
        ]
    )
    offsets = offsets.dropna()
    return {
        "radius_bias": middle((radius / moving["radius_nm"]).dropna()),
        "radius_rmse_nm": rms(float((radius.dropna() ** 2).sum()), int(radius.notna().sum())),
        "radius_pull": rms(float((pulls**2).sum()), len(pulls)),
        "centre_rmse_nm": rms(float((offsets**2).sum()), len(offsets)),
    }


def middle(values: pd.Series[float]) -> Measure:
    """Give a median with the interval of its order statistics."""
    n = len(values)
    if not n:
        return Measure(math.nan, math.nan, math.nan, 0)
    ordered = np.sort(values.to_numpy())
    half = _Z * math.sqrt(n) / 2.0
    low = ordered[max(math.floor(n / 2.0 - half), 0)]
    high = ordered[min(math.ceil(n / 2.0 + half), n - 1)]
    return Measure(float(np.median(ordered)), float(low), float(high), n)


def _miss(name: str, value: float) -> float:
    """Tell how far a value is from where it should be; what is not told is infinitely far."""
    aim = AIMS[name][1]
    if not math.isfinite(value):
        return math.inf
    match aim:
        case "high":
            return 1.0 - value
        case "low":
            return value
        case "one":
            return abs(math.log(value)) if value > 0.0 else math.inf
        case "zero":
            return abs(value)
        case "nominal":
            return abs(value - _NOMINAL)
