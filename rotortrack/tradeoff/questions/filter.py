"""How many spots each filter and threshold finds, how many of its candidates are none, how fast.

Films of spots at random places on a background are searched for candidates; a candidate and a spot
are one where each is the other's nearest within a gate. The error is 1 - F1, F1 being the harmonic
mean of recall and precision: what is missed and what is false weigh the same. Spots that overlap
are no candidates of their own in any setting, so that dense films have errors that no threshold
takes away.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, interval_of_mean, stamped
from rotortrack.tradeoff.turns import in_turns

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rotortrack.cameras.camera import Camera
    from rotortrack.localise.options import LocaliseOptions

Floats = NDArray[np.float64]

TITLE: Final = "filter and threshold: spots found, missed and false"

DEFAULT: Final = "threshold 5.5 noise"
SETTINGS: Final[dict[str, dict[str, Any]]] = {
    "threshold 4 noise": {"threshold": "4*noise(Wave.F)"},
    "threshold 5 noise": {"threshold": "5*noise(Wave.F)"},
    DEFAULT: {},
    "threshold 6 noise": {"threshold": "6*noise(Wave.F)"},
    "threshold 8 noise": {"threshold": "8*noise(Wave.F)"},
    "paper: std(Wave.F1)": {"threshold": "std(Wave.F1)"},
    "threshold 4 std(Wave.F)": {"threshold": "4*std(Wave.F)"},
    "four neighbours": {"connectivity": 4},
    "order 2": {"wavelet_order": 2},
    "scale 1.5": {"wavelet_scale": 1.5},
    "scale 3": {"wavelet_scale": 3.0},
}

PIXEL_NM: Final = 108.3
SIGMA_PX: Final = 1.25
BACKGROUND: Final = 8.0
SIDE_PX: Final = 128
PARTS: Final = 8
"""Parts of a film, between which errors are compared for their intervals."""


@dataclass(frozen=True)
class Film:
    """Photons of a spot, and spots of a frame."""

    photons: float
    spots: float


GROUPS: Final = {
    "150 photons, 10 spots": Film(150.0, 10.0),
    "500 photons, 10 spots": Film(500.0, 10.0),
    "500 photons, 60 spots": Film(500.0, 60.0),
}


@dataclass(frozen=True)
class Sizes:
    """Frames of a film, and how often each setting is timed."""

    frames: int
    repeats: int


SIZES: Final = {"quick": Sizes(80, 2), "usual": Sizes(400, 5), "thorough": Sizes(3200, 5)}


def answer(effort: Effort, progress: Progress) -> Answer:
    """Search the films of all groups in every way, the settings in turns."""
    points: list[Point] = []
    found: dict[str, tuple[float, float]] = {}
    for group, film in GROUPS.items():
        made, shares = measure(group, film, SIZES[effort.name], progress)
        points += made
        found[group] = shares
    return stamped(
        question="filter",
        effort=effort,
        points=points,
        error_unit="1 - F1 of candidates",
        seconds_unit=f"s per 1000 frames of {SIDE_PX} x {SIDE_PX} pixels",
        bounds=dict.fromkeys(GROUPS),
        advice=advice(points, found),
    )


def advice(points: list[Point], found: Mapping[str, tuple[float, float]]) -> str:
    """Say what the points mean; `found` are recall and precision of the default by group."""
    told = ", ".join(
        f"{recall:.1%} at a precision of {precision:.1%} ({group})"
        for group, (recall, precision) in found.items()
    )
    paper = [p.seconds for p in points if p.setting.startswith("paper")]
    usual = [p.seconds for p in points if p.is_default]
    return (
        f"The default finds {told}, at {1000.0 / max(usual):.0f} frames/s of one processor "
        f"(the paper's threshold: {1000.0 / max(paper):.0f})."
    )


def measure(
    group: str, film: Film, sizes: Sizes, progress: Progress
) -> tuple[list[Point], tuple[float, float]]:
    """Search one film in all ways; the second result is recall and precision of the default."""
    from rotortrack.localise.options import LocaliseOptions

    camera, counts, truth = filmed(film, sizes.frames)
    works = {
        name: functools.partial(search, counts, camera, LocaliseOptions(**options))
        for name, options in SETTINGS.items()
    }
    told = in_turns(works, sizes.repeats, progress, group)
    points = []
    shares = (math.nan, math.nan)
    for name, (candidates, seconds) in told.items():
        right, found, true = compared(candidates, truth, sizes.frames)
        errors = 1.0 - 2.0 * right / (found + true)
        spread = interval_of_mean(errors.tolist())
        if name == DEFAULT:
            shares = (float(right.sum() / true.sum()), float(right.sum() / found.sum()))
        per_thousand = 1e3 * seconds / sizes.frames
        points.append(Point(name, group, *spread, per_thousand, name == DEFAULT))
    return points, shares


def search(counts: NDArray[Any], camera: Camera, options: LocaliseOptions) -> NDArray[np.int32]:
    """Find candidates as `localise` does: frame, row and column, shape (n, 3)."""
    from rotortrack.localise.detect import find_candidates
    from rotortrack.localise.threshold import parse_threshold
    from rotortrack.localise.wavelet import bspline_taps
    from rotortrack.localise.windows import camera_arrays

    taps = bspline_taps(options.wavelet_order, options.wavelet_scale).astype(np.float32)
    return find_candidates(
        counts,
        camera_arrays(camera, counts.dtype),
        parse_threshold(options.threshold),
        taps=taps,
        connectivity=options.connectivity,
        quantum_e=float(camera.gain_e_per_adu),
    )


def filmed(film: Film, frames: int) -> tuple[Camera, NDArray[np.uint16], NDArray[np.float64]]:
    """Film spots: the camera, counts (frame, y, x), and frame, y and x (px) of every spot."""
    from rotortrack.cameras.camera import Camera
    from rotortrack.simulate.psf import pixel_fractions

    rng = np.random.default_rng((int(film.photons), int(film.spots)))
    camera = Camera(100.0, 0.46, 1.6)
    zero = np.zeros(1, np.int64)
    counts = np.empty((frames, SIDE_PX, SIDE_PX), np.uint16)
    truth = []
    for frame in range(frames):
        places = rng.uniform(0.0, SIDE_PX, (rng.poisson(film.spots), 2))
        rows, columns = (
            pixel_fractions(places[:, axis], zero, SIDE_PX, SIGMA_PX) for axis in (0, 1)
        )
        light = BACKGROUND + film.photons * (rows.T @ columns)
        counts[frame] = camera.to_counts(light, rng)
        truth.append(np.column_stack([np.full(len(places), frame), places]))
    return camera, counts, np.concatenate(truth)


def compared(
    candidates: NDArray[np.int32], truth: Floats, frames: int
) -> tuple[Floats, Floats, Floats]:
    """Count by part of the film the candidates that are spots, the candidates, and the spots."""
    import pandas as pd

    from rotortrack.tradeoff.matching import match_spots

    middles = candidates + np.array([0.0, 0.5, 0.5])
    found, true = (
        pd.DataFrame({"frame": of[:, 0], "x_nm": PIXEL_NM * of[:, 2], "y_nm": PIXEL_NM * of[:, 1]})
        for of in (middles, truth)
    )
    matched = match_spots(found, true)
    counts = [
        np.bincount((of[:, 0] * PARTS // frames).astype(np.int64), minlength=PARTS).astype(float)
        for of in (middles[matched >= 0], middles, truth)
    ]
    return counts[0], counts[1], counts[2]
