"""How well and how fast each fit tells the circle that a rotor's positions trace.

Positions lie on a whole circle or an arc, with noise of each axis and, in one group, with spots
elsewhere. The error is that of centre and radius: the rms of their three errors. The bound is that
of the geometric fit to first order in noise over radius, s^2 (J'J)^-1, from which every fit of a
circle may stray by its bias.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, stamped
from rotortrack.tradeoff.turns import in_turns, rms_interval

if TYPE_CHECKING:
    from rotortrack.rotors.circle import CircleFit

Floats = NDArray[np.float64]

TITLE: Final = "circle fits"

DEFAULT: Final = "auto"
SETTINGS: Final[dict[str, dict[str, Any]]] = {
    DEFAULT: {},
    "auto, all spots": {"outlier_sd": 0.0},
    "hyper": {"method": "hyper"},
    "hyper, all spots": {"method": "hyper", "outlier_sd": 0.0},
    "kasa": {"method": "kasa"},
    "pratt": {"method": "pratt"},
    "taubin": {"method": "taubin"},
    "geometric": {"method": "geometric"},
}

RADIUS_NM: Final = 80.0


@dataclass(frozen=True)
class Rotor:
    """Positions of a rotor, their arc (deg) and noise per axis over radius, and share elsewhere."""

    positions: int
    arc_deg: float
    noise: float
    elsewhere: float = 0.0


GROUPS: Final = {
    "whole circle, noise R / 8": Rotor(1000, 360.0, 0.125),
    "whole circle, noise R / 3": Rotor(1000, 360.0, 1.0 / 3.0),
    "half a circle, noise R / 8": Rotor(1000, 180.0, 0.125),
    "whole circle, R / 8, 3 % elsewhere": Rotor(1000, 360.0, 0.125, 0.03),
}


@dataclass(frozen=True)
class Sizes:
    """Rotors of a group, and how often each setting is timed."""

    rotors: int
    repeats: int


SIZES: Final = {"quick": Sizes(40, 1), "usual": Sizes(250, 2), "thorough": Sizes(2000, 3)}


def answer(effort: Effort, progress: Progress) -> Answer:
    """Fit circles to the rotors of all groups in every way, the settings in turns."""
    points: list[Point] = []
    for group, rotor in GROUPS.items():
        points += measure(group, rotor, SIZES[effort.name], progress)
    return stamped(
        question="circle",
        effort=effort,
        points=points,
        error_unit="rms error of centre and radius, nm",
        seconds_unit="s per 1000 circles of 1000 positions",
        bounds={group: bound_nm(rotor) for group, rotor in GROUPS.items()},
        advice=advice(points),
    )


def advice(points: list[Point]) -> str:
    """Say what the points mean."""
    of = {(point.group, point.setting): point for point in points}
    clear, noisy = list(GROUPS)[:2]
    auto, hyper = of[clear, DEFAULT], of[clear, "hyper"]
    return (
        f"auto takes {auto.seconds / hyper.seconds:.1f} times the time of hyper; that buys nothing "
        f"where noise is small ({auto.error:.2f} against {hyper.error:.2f} nm) and "
        f"{of[noisy, DEFAULT].error:.2f} against {of[noisy, 'hyper'].error:.2f} nm where it is a "
        "third of the radius."
    )


def measure(group: str, rotor: Rotor, sizes: Sizes, progress: Progress) -> list[Point]:
    """Fit circles to rotors of a group."""
    rng = np.random.default_rng((int(rotor.arc_deg), int(1e3 * rotor.noise), rotor.elsewhere > 0))
    clouds = [positions(rotor, rng) for _ in range(sizes.rotors)]
    works = {name: functools.partial(fitted, clouds, name) for name in SETTINGS}
    points = []
    for name, (fits, seconds) in in_turns(works, sizes.repeats, progress, group).items():
        errors = np.array([[f.x_nm, f.y_nm, f.radius_nm - RADIUS_NM] for f in fits])
        known = np.isfinite(errors).all(axis=1)
        lost = 1.0 - float(np.mean(known))
        error, failed = (math.nan,) * 3, f"no circle in {lost:.0%} of the cases"
        if lost <= 0.1:
            error, failed = rms_interval(np.mean(errors[known] ** 2, axis=1)), ""
        per_thousand = 1e3 * seconds / sizes.rotors
        points.append(Point(name, group, *error, per_thousand, name == DEFAULT, failed))
    return points


def fitted(clouds: list[tuple[Floats, Floats]], name: str) -> list[CircleFit]:
    """Fit a circle to every cloud of positions with a setting."""
    from rotortrack.rotors.circle import fit_circle
    from rotortrack.rotors.options import CircleOptions

    options = CircleOptions(**SETTINGS[name])
    return [fit_circle(x, y, options.method, outlier_sd=options.outlier_sd) for x, y in clouds]


def positions(rotor: Rotor, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Draw the positions of a rotor about the origin, nm."""
    theta = np.radians(rng.uniform(0.0, rotor.arc_deg, rotor.positions))
    x, y = (
        RADIUS_NM * (wave + rng.normal(0.0, rotor.noise, theta.size))
        for wave in (np.cos(theta), np.sin(theta))
    )
    stray = rng.random(theta.size) < rotor.elsewhere
    x[stray], y[stray] = rng.uniform(-4.0 * RADIUS_NM, 4.0 * RADIUS_NM, (2, theta.size))[:, stray]
    return x, y


def bound_nm(rotor: Rotor) -> float:
    """Give the bound of the rms of the three errors."""
    theta = np.radians((np.arange(3600) + 0.5) / 3600 * rotor.arc_deg)
    slopes = np.column_stack([np.cos(theta), np.sin(theta), np.ones_like(theta)])
    information = slopes.T @ slopes / theta.size * rotor.positions * (1.0 - rotor.elsewhere)
    mean = float(np.trace(np.linalg.inv(information))) / 3.0
    return RADIUS_NM * rotor.noise * math.sqrt(mean)
