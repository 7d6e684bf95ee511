"""How well each kind of map brings the second colour onto the first, and what finding it costs.

The truth is a distortion as relay optics make it: over a field of 30 um a radial term that moves
the edges by 120 nm, a keystone of 40 nm, and a waviness of 15 nm that no polynomial of low order
follows. The error is that of places all over the field, not of the beads themselves: rms per axis
of a map's distance from the truth on a fine grid (the target registration error).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, interval_of_mean, stamped

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import pandas as pd

Floats = NDArray[np.float64]

TITLE: Final = "registration of two colours: kinds of maps"

PIXEL_NM: Final = 108.3
PIXELS: Final = 277
FIELD_NM: Final = PIXEL_NM * PIXELS
BESIDE_NM: Final = np.array([FIELD_NM, 0.0])

RADIAL_NM, KEYSTONE_NM, WAVE_NM = 120.0, 40.0, 15.0
WAVE_LENGTHS_NM: Final = (12_000.0, 15_000.0)
PARAMETERS: Final = 10
"""Of an affine map, the radial term, the keystone and the two waves, for two coordinates."""

MODELS: Final[dict[str, dict[str, Any]]] = {
    "cross-validated": {},
    "affine": {"model": "affine"},
    **{f"polynomial {k}": {"model": "polynomial", "order": k} for k in (2, 3, 4, 5)},
    "spline": {"model": "spline"},
    "local mean": {"model": "local-mean"},
}
DEFAULT: Final = "cross-validated"

GROUPS: Final = {
    "64 beads": (8, 3.0),
    "400 beads": (20, 3.0),
    "400 beads, 10 nm noise": (20, 10.0),
}
"""Beads along an edge, and noise of the distance between a bead's two places (nm per axis)."""


@dataclass(frozen=True)
class Sizes:
    """Sets of beads in each group (0: the group is left out); maps tried on many beads; the grid.

    The grid has as many places along an edge of the field.
    """

    sets: tuple[int, int, int]
    on_many: tuple[str, ...] = tuple(MODELS)
    grid: int = 61


SIZES: Final = {
    "quick": Sizes((2, 1, 0), (DEFAULT, "affine")),
    "usual": Sizes((4, 2, 2), (DEFAULT, "affine", "polynomial 3", "spline", "local mean")),
    "thorough": Sizes((40, 12, 12)),
}


def answer(effort: Effort, progress: Progress) -> Answer:
    """Register sets of beads by each kind of map, the kinds in turns."""
    sizes = SIZES[effort.name]
    points = []
    for group, sets in zip(GROUPS, sizes.sets, strict=True):
        if sets:
            names = tuple(MODELS) if group == next(iter(GROUPS)) else sizes.on_many
            points += measure(group, names, sets, sizes.grid, progress)
    groups = {point.group for point in points}
    return stamped(
        question="registration",
        effort=effort,
        points=points,
        error_unit="nm, target registration error per axis",
        seconds_unit="s per registration",
        bounds={group: bound_nm(*GROUPS[group]) for group in GROUPS if group in groups},
        advice=advice(points),
    )


def bound_nm(edge: int, noise_nm: float) -> float:
    """Error of the best map if the form of the distortion were known: sigma sqrt(p / 2 N)."""
    return noise_nm * math.sqrt(PARAMETERS / (2.0 * edge**2))


def advice(points: list[Point]) -> str:
    """Say what the points mean."""
    most = max(points, key=lambda p: list(GROUPS).index(p.group)).group
    by_name = {p.setting: p for p in points if p.group == most}
    chosen, affine = by_name[DEFAULT], by_name["affine"]
    return (
        f"Leave the choice to cross-validation: {chosen.error:.1f} nm against {affine.error:.1f} "
        f"nm of an affine map ({most}); naming the kind saves no time, since every kind is tried "
        "to tell the beads' noise."
    )


def measure(
    group: str, names: Sequence[str], sets: int, grid: int, progress: Progress
) -> list[Point]:
    """Register each set of beads of a group by some kinds of maps, in turns."""
    from rotortrack.twocolour.options import RegisterOptions
    from rotortrack.twocolour.register import register_beads

    edge, noise_nm = GROUPS[group]
    options = {name: RegisterOptions(**MODELS[name]) for name in names}
    errors: dict[str, list[float]] = {name: [] for name in options}
    seconds = dict.fromkeys(options, math.inf)
    for number in range(sets):
        tables = films(np.random.default_rng((edge, int(noise_nm), number)), edge, noise_nm)
        for at, (name, chosen) in enumerate(options.items()):
            progress(group, number * len(options) + at, sets * len(options))
            begun = time.process_time()
            made = register_beads(
                tables[:1],
                tables[1:],
                chosen,
                pixel_size_nm=PIXEL_NM,
                regions=((0, 0, PIXELS, PIXELS), (PIXELS, 0, PIXELS, PIXELS)),
            )
            seconds[name] = min(seconds[name], time.process_time() - begun)
            errors[name].append(error_nm(made.to_first, grid))
    return [
        Point(name, group, *interval_of_mean(errors[name]), seconds[name], name == DEFAULT)
        for name in options
    ]


def to_first(places_nm: Floats) -> Floats:
    """Map places of the second colour, nm from its corner, (n, 2), onto the first: the truth."""
    middle = 0.5 * FIELD_NM
    u = (places_nm - middle) / middle
    radial = RADIAL_NM * u * np.sum(u**2, axis=1, keepdims=True)
    keystone = KEYSTONE_NM * u * u[:, 1:]
    phases = 2.0 * np.pi * places_nm[:, ::-1] / np.array(WAVE_LENGTHS_NM)
    return np.asarray(places_nm + radial + keystone + WAVE_NM * np.sin(phases))


def films(rng: np.random.Generator, edge: int, noise_nm: float) -> list[pd.DataFrame]:
    """Scatter beads over the field, one in each cell of a lattice, and see them in both colours."""
    import pandas as pd

    cells = np.stack(np.meshgrid(np.arange(edge), np.arange(edge)), axis=-1).reshape(-1, 2)
    places_nm = (cells + rng.uniform(0.2, 0.8, cells.shape)) * FIELD_NM / edge
    photons = rng.lognormal(8.0, 0.5, len(places_nm))
    tables = []
    for seen in (to_first(places_nm), places_nm + BESIDE_NM):
        seen_nm = seen + rng.normal(0.0, noise_nm / math.sqrt(2.0), seen.shape)
        columns = {"x_nm": seen_nm[:, 0], "y_nm": seen_nm[:, 1], "photons": photons}
        tables.append(pd.DataFrame({"frame": 0, **columns}))
    return tables


def error_nm(mapped: Callable[[Floats], Floats], grid: int) -> float:
    """Give a map's rms distance from the truth, per axis, over the field but its outermost 5 %."""
    line = np.linspace(0.05, 0.95, grid) * FIELD_NM
    places_nm = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    miss = mapped(places_nm + BESIDE_NM) - to_first(places_nm)
    return math.sqrt(float(np.mean(miss**2)))
