"""How well and how fast the drift of the stage is told, by method and number of time bins.

Rotors turn in a field that drifts along a curve and wanders at random. The error is the rms
distance per axis of the estimated from the true drift, over frames, each without its mean: a
constant shift moves all rotors alike. Where the drift is not told from none, the error is that of
no correction.
"""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, interval_of_mean, stamped
from rotortrack.tradeoff.turns import in_turns

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

TITLE: Final = "drift: method, time bins and magnification"

DEFAULT: Final = "bins 10"
SETTINGS: Final[dict[str, dict[str, Any]]] = {
    "none": {"method": "none"},
    "bins 5": {"bins": 5},
    DEFAULT: {},
    "bins 20": {"bins": 20},
    "bins 40": {"bins": 40},
    "magnification 2": {"magnification": 2.0},
    "magnification 10": {"magnification": 10.0},
    "bins 20, smoothing 0.1": {"bins": 20, "smoothing": 0.1},
    "bins 40, smoothing 0.1": {"bins": 40, "smoothing": 0.1},
}


@dataclass(frozen=True)
class Field:
    """Rotors of a field, their spots, and how it drifts.

    Attributes
    ----------
    rotors, spots_per_frame, frames
        How many rotors there are, and how many of them are seen in a frame on average.
    noise_nm, radius_nm, side_nm, pixel_size_nm
        Noise of a position per axis, radius of the rotors, side of the field, and its pixels.
    drift_nm, walk_nm
        Length of the curve along x, and the random walk's deviation at the film's end, per axis.
    """

    rotors: int
    spots_per_frame: float
    frames: int = 8000
    noise_nm: float = 10.0
    radius_nm: float = 80.0
    side_nm: float = 14_000.0
    pixel_size_nm: float = 108.3
    drift_nm: float = 200.0
    walk_nm: float = 10.0


GROUPS: Final = {
    "100 rotors, 200 nm": Field(100, 60.0),
    "10 rotors, 200 nm": Field(10, 6.0),
    "100 rotors, walk of 100 nm": Field(100, 60.0, walk_nm=100.0),
}


@dataclass(frozen=True)
class Sizes:
    """Fields of a group, and how often each setting is timed."""

    fields: int
    repeats: int


SIZES: Final = {"quick": Sizes(2, 1), "usual": Sizes(8, 1), "thorough": Sizes(40, 2)}


def answer(effort: Effort, progress: Progress, groups: Mapping[str, Field] = GROUPS) -> Answer:
    """Estimate the drift of fields in every way, the ways in turns.

    Parameters
    ----------
    effort, progress
        As of every question.
    groups
        What fields are like, by the names of the groups.
    """
    points: list[Point] = []
    for group, kind in groups.items():
        points += measure(group, kind, SIZES[effort.name], progress)
    return stamped(
        question="drift",
        effort=effort,
        points=points,
        error_unit="rms drift error per axis, nm",
        seconds_unit="s per 100 000 localisations",
        bounds=dict.fromkeys(groups),
        advice=advice(points),
    )


def advice(points: list[Point]) -> str:
    """Say what the points mean."""
    told = []
    for default in (point for point in points if point.is_default):
        own = [p for p in points if p.group == default.group and not p.failed]
        left = next(p for p in own if p.setting == "none")
        best = min(own, key=lambda point: point.error)
        better = f", {best.error:.2g} nm by {best.setting}" if best.error < default.error else ""
        told.append(
            f"{left.error:.2g} nm become {default.error:.2g} nm by {DEFAULT}{better} "
            f"({default.group})"
        )
    return "; ".join(told).capitalize() + "."


def measure(group: str, kind: Field, sizes: Sizes, progress: Progress) -> list[Point]:
    """Estimate the drift of some fields of one kind in every way."""
    rng = np.random.default_rng((kind.rotors, kind.frames, int(kind.walk_nm)))
    fields = [drifting(kind, rng) for _ in range(sizes.fields)]
    spots = sum(len(table) for table, _ in fields)
    works = {
        name: functools.partial(estimated, [table for table, _ in fields], kind, name)
        for name in SETTINGS
    }
    points = []
    for name, (found, seconds) in in_turns(works, sizes.repeats, progress, group).items():
        errors = [error_nm(drift, truth) for drift, (_, truth) in zip(found, fields, strict=True)]
        per_spots = 1e5 * seconds / spots
        points.append(Point(name, group, *interval_of_mean(errors), per_spots, name == DEFAULT))
    return points


def estimated(tables: list[pd.DataFrame], kind: Field, name: str) -> list[pd.DataFrame]:
    """Estimate the drift of every table with a setting."""
    from rotortrack.corrections.drift.cross_correlation import estimate_drift
    from rotortrack.corrections.options import DriftOptions
    from rotortrack.errors import DriftWarning

    options = DriftOptions(**SETTINGS[name])
    with warnings.catch_warnings():
        # What an estimate warns of shows in its error.
        warnings.simplefilter("ignore", DriftWarning)
        return [
            estimate_drift(table, options, pixel_size_nm=kind.pixel_size_nm).table
            for table in tables
        ]


def error_nm(drift: pd.DataFrame, truth_nm: Floats) -> float:
    """Give the rms per axis between a drift and the true one, (frame, 2), without their means."""
    seen = drift["frame"].to_numpy(np.int64)
    off = drift[["dx_nm", "dy_nm"]].to_numpy() - truth_nm[seen]
    return float(np.sqrt(np.mean((off - off.mean(axis=0)) ** 2)))


def drifting(kind: Field, rng: np.random.Generator) -> tuple[pd.DataFrame, Floats]:
    """Make a table of localisations, and the drift of every frame, (frame, 2), nm."""
    import pandas as pd

    part = np.linspace(0.0, 1.0, kind.frames)
    curve = kind.drift_nm * np.column_stack([part**1.5, -0.5 * np.sin(2.0 * part)])
    walk = np.cumsum(rng.normal(0.0, kind.walk_nm / math.sqrt(kind.frames), (kind.frames, 2)), 0)
    truth = curve + walk
    seen = rng.random((kind.frames, kind.rotors)) < kind.spots_per_frame / kind.rotors
    frame, rotor = np.nonzero(seen)
    middles = rng.uniform(0.0, kind.side_nm, (kind.rotors, 2))
    theta = rng.uniform(0.0, 2.0 * math.pi, frame.size)
    around = kind.radius_nm * np.column_stack([np.cos(theta), np.sin(theta)])
    places = middles[rotor] + around + truth[frame]
    places += rng.normal(0.0, kind.noise_nm, places.shape)
    table = pd.DataFrame({"frame": frame, "x_nm": places[:, 0], "y_nm": places[:, 1]})
    return table, truth
