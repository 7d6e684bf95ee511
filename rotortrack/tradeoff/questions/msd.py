"""What the mean-square displacement costs by the length of a track, and how many digits it keeps.

A turning, diffusing angle with missing frames is evaluated by fast Fourier transforms, as a run
does, and by the sum over all pairs of frames that defines it. Both are compared with that sum in
extended precision at some lags; the error is the largest relative one. Errors below 1e-16 are not
told from none.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, interval_of_mean, stamped
from rotortrack.tradeoff.turns import in_turns

Floats = NDArray[np.float64]

TITLE: Final = "mean-square displacement: transforms against sums"

DEFAULT: Final = "transforms, half of the lags"
SETTINGS: Final = {
    "transforms, all lags": (True, 1.0),
    DEFAULT: (True, 0.5),
    "transforms, a tenth of the lags": (True, 0.1),
    "sums, half of the lags": (False, 0.5),
    "sums, a tenth of the lags": (False, 0.1),
}
"""Whether transforms are used, and the part of the track's length that lags reach."""

LEAST_TOLD: Final = 1e-16
MISSING: Final = 0.1
COMPARED: Final = 12
"""Lags that are compared, spread evenly over the logarithms of those of the shortest setting."""


@dataclass(frozen=True)
class Sizes:
    """Frames of the tracks, tracks of each length, and how often each setting is timed."""

    frames: tuple[int, ...]
    tracks: int
    repeats: int


SIZES: Final = {
    "quick": Sizes((100, 1000, 8000), 2, 1),
    "usual": Sizes((100, 1000, 8000, 30_000), 4, 2),
    "thorough": Sizes((100, 1000, 8000, 30_000, 100_000), 4, 2),
}


def answer(effort: Effort, progress: Progress) -> Answer:
    """Evaluate tracks of every length in every way, the ways in turns."""
    sizes = SIZES[effort.name]
    points: list[Point] = []
    for frames in sizes.frames:
        points += measure(frames, sizes, progress)
    return stamped(
        question="msd",
        effort=effort,
        points=points,
        error_unit="largest relative error",
        seconds_unit="s per track",
        bounds=dict.fromkeys(dict.fromkeys(point.group for point in points)),
        advice=advice(points),
    )


def advice(points: list[Point]) -> str:
    """Say what the points mean."""
    of = {(point.group, point.setting): point for point in points}
    longest = points[-1].group
    own, sums = of[longest, DEFAULT], of[longest, "sums, half of the lags"]
    return (
        f"Transforms take {1e3 * own.seconds:.2g} ms for {longest}, "
        f"{sums.seconds / own.seconds:.0f} times less than sums, with a relative error of "
        f"{own.error:.0e}."
    )


def measure(frames: int, sizes: Sizes, progress: Progress) -> list[Point]:
    """Evaluate tracks of one length in every way."""
    group = f"{frames} frames"
    rng = np.random.default_rng(frames)
    tracks = [turning(frames, rng) for _ in range(sizes.tracks)]
    shortest = int(min(part for _, part in SETTINGS.values()) * (frames - 1))
    lags = np.unique(np.geomspace(1, shortest, COMPARED).astype(np.int64))
    truths = [by_sums(track.astype(np.longdouble), lags) for track in tracks]
    works = {name: functools.partial(curves, tracks, *SETTINGS[name]) for name in SETTINGS}
    points = []
    for name, (found, seconds) in in_turns(works, sizes.repeats, progress, group).items():
        errors = [
            max(float(np.max(np.abs(curve[lags - 1] / truth - 1.0))), LEAST_TOLD)
            for curve, truth in zip(found, truths, strict=True)
        ]
        spread = interval_of_mean(errors)
        points.append(Point(name, group, *spread, seconds / sizes.tracks, name == DEFAULT))
    return points


def curves(tracks: list[Floats], transforms: bool, part: float) -> list[Floats]:
    """Evaluate every track at lags from 1 up to a part of its length."""
    from rotortrack.motion.msd import msd

    last = int(part * (tracks[0].size - 1))
    if transforms:
        return [msd(track, last).values for track in tracks]
    return [by_sums(track, np.arange(1, last + 1)) for track in tracks]


def by_sums(track: NDArray[Any], lags: NDArray[np.int64]) -> NDArray[Any]:
    """Give the mean of squared turns over the pairs of frames of each lag, as it is defined."""
    return np.array([np.nanmean((track[lag:] - track[:-lag]) ** 2) for lag in lags.tolist()])


def turning(frames: int, rng: np.random.Generator) -> Floats:
    """Make the cumulative angle of a rotor, rad, nan in frames without it."""
    angle = np.cumsum(rng.normal(0.1, 0.2, frames)) + rng.normal(0.0, 0.1, frames)
    angle[rng.random(frames) < MISSING] = np.nan
    angle[[0, -1]] = 0.0, 0.1 * frames
    return angle
