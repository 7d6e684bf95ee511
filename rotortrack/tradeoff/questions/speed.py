"""How well and how fast each estimator tells the speed of a rotor.

Rotors turn steadily and diffuse, and their positions have noise; some frames are missing. The error
is that of the speed, rms, and of its size alone where an estimator knows no sign. The bound is the
standard deviation of the best unbiased estimate for known diffusion D and noise, of all readings
weighed by their covariance: sqrt(2 D / T) without noise, T being the length of the film.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, stamped
from rotortrack.tradeoff.turns import in_turns, rms_interval

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

TITLE: Final = "speed of a rotor"

DEFAULT: Final = "auto"
INTERVAL_S: Final = 0.002
RADIUS_NM: Final = 80.0
FRAMES: Final = 1000
PAPER: Final = "MSD, quarter of the film"
MSD_LAGS: Final = {"MSD, 10 lags": 10, PAPER: FRAMES // 4, "MSD, half of the film": FRAMES // 2}


@dataclass(frozen=True)
class Rotor:
    """Speed (rad/s), diffusion (rad^2/s), noise of a position (nm) and share of missing frames."""

    omega_rad_s: float
    diffusion_rad2_s: float
    noise_nm: float
    missing: float = 0.0


GROUPS: Final = {
    "D 10, noise 8 nm": Rotor(30.0, 10.0, 8.0),
    "D 10, 8 nm, 20 % missing": Rotor(30.0, 10.0, 8.0, 0.2),
    "D 1, noise 25 nm": Rotor(30.0, 1.0, 25.0),
    "D 200, 8 nm, 20 % missing": Rotor(200.0, 200.0, 8.0, 0.2),
    "D 100, noise 50 nm": Rotor(100.0, 100.0, 50.0),
}


@dataclass(frozen=True)
class Sizes:
    """Rotors of a group, and how often each setting is timed."""

    rotors: int
    repeats: int


SIZES: Final = {"quick": Sizes(6, 1), "usual": Sizes(50, 1), "thorough": Sizes(800, 2)}


@dataclass(frozen=True)
class Seen:
    """Frames in which a rotor was seen, and its positions in them, nm; their noise, nm."""

    frame: Integers
    x_nm: Floats
    y_nm: Floats
    sd_nm: float


def answer(effort: Effort, progress: Progress) -> Answer:
    """Measure the rotors of every group in every way, the ways in turns."""
    points: list[Point] = []
    for group, rotor in GROUPS.items():
        points += measure(group, rotor, SIZES[effort.name], progress)
    return stamped(
        question="speed",
        effort=effort,
        points=points,
        error_unit="rms error of the speed, rad/s",
        seconds_unit=f"s per rotor of {FRAMES} frames",
        bounds={group: bound_rad_s(rotor) for group, rotor in GROUPS.items()},
        advice=advice(points),
    )


def advice(points: list[Point]) -> str:
    """Say what the points mean."""
    ratios = {
        p.group: p.error / bound_rad_s(GROUPS[p.group]) for p in points if p.setting == DEFAULT
    }
    paper = {p.group: p.error / bound_rad_s(GROUPS[p.group]) for p in points if p.setting == PAPER}
    worst = max(paper, key=lambda group: paper[group])
    return (
        f"auto stays within {max(ratios.values()):.2f} times the bound; the paper's fit of the MSD "
        f"errs {paper[worst]:.1f} times the bound for {worst}, and knows no sign."
    )


def measure(group: str, rotor: Rotor, sizes: Sizes, progress: Progress) -> list[Point]:
    """Measure rotors of one group in every way."""
    rng = np.random.default_rng([int(1e3 * v) for v in vars(rotor).values()])
    films = [turning(rotor, rng) for _ in range(sizes.rotors)]
    works = {name: functools.partial(_each, films, way) for name, way in ways().items()}
    points = []
    for name, (speeds, seconds) in in_turns(works, sizes.repeats, progress, group).items():
        found = np.array(speeds)
        known = np.isfinite(found)
        if known.mean() < 0.9:
            error, failed = (math.nan,) * 3, f"no speed of {1.0 - known.mean():.0%} of the rotors"
        else:
            error, failed = rms_interval((found[known] - rotor.omega_rad_s) ** 2), ""
        each = seconds / sizes.rotors
        points.append(Point(name, group, *error, each, name == DEFAULT, failed))
    return points


def _each(films: list[Seen], way: Callable[[Seen], float]) -> list[float]:
    return [way(seen) for seen in films]


def ways() -> dict[str, Callable[[Seen], float]]:
    """List the estimators of the speed of one rotor, rad/s, by name."""
    likelihoods = {
        name: functools.partial(by_likelihood, method=name)
        for name in ("increments", "circular", DEFAULT)
    }
    curves = {name: functools.partial(by_msd, lags=count) for name, count in MSD_LAGS.items()}
    return {"mean step": by_mean_step, "line": by_line, **curves, **likelihoods}


def by_mean_step(seen: Seen) -> float:
    """Divide the whole turn by the time between the first and the last frame."""
    turned = unbroken(seen)
    return float(turned[-1] - turned[0]) / ((turned.size - 1) * INTERVAL_S)


def by_line(seen: Seen) -> float:
    """Fit a line to the cumulative angle by least squares."""
    turned = unbroken(seen)
    known = np.isfinite(turned)
    return float(np.polyfit(INTERVAL_S * np.flatnonzero(known), turned[known], 1)[0])


def by_msd(seen: Seen, lags: int) -> float:
    """Fit the mean-square displacement of the cumulative angle, as published."""
    from rotortrack.motion.msd import fit_msd, msd

    return fit_msd(msd(unbroken(seen), lags), INTERVAL_S, lags=lags).speed_rad_s


def by_likelihood(seen: Seen, method: Any) -> float:
    """Maximise the likelihood of the steps, or of the directions on the circle."""
    from rotortrack.motion.estimate import estimate_motion
    from rotortrack.motion.readings import Circle

    sd = np.full(seen.frame.size, seen.sd_nm)
    return estimate_motion(
        seen.frame,
        seen.x_nm,
        seen.y_nm,
        sd,
        sd,
        Circle(0.0, 0.0, RADIUS_NM),
        frame_interval_s=INTERVAL_S,
        exposure_s=INTERVAL_S,
        method=method,
    ).fit.omega_rad_s


def unbroken(seen: Seen) -> Floats:
    """Give the cumulative angle in every frame, rad."""
    from rotortrack.motion.angles import unbroken_angle

    return unbroken_angle(seen.frame, np.arctan2(-seen.y_nm, seen.x_nm))


def turning(rotor: Rotor, rng: np.random.Generator) -> Seen:
    """Film a rotor that turns and diffuses, each frame showing the mean of its exposure."""
    parts = 8
    small_s = INTERVAL_S / parts
    steps = rng.normal(
        rotor.omega_rad_s * small_s,
        math.sqrt(2.0 * rotor.diffusion_rad2_s * small_s),
        FRAMES * parts,
    )
    theta = (rng.uniform(0.0, 2.0 * math.pi) + np.cumsum(steps)).reshape(FRAMES, parts)
    x, y = (
        RADIUS_NM * wave.mean(axis=1) + rng.normal(0.0, rotor.noise_nm, FRAMES)
        for wave in (np.cos(theta), -np.sin(theta))
    )
    kept = np.flatnonzero(rng.random(FRAMES) >= rotor.missing)
    return Seen(kept, x[kept], y[kept], rotor.noise_nm)


def bound_rad_s(rotor: Rotor) -> float:
    """Give the least standard deviation of the speed for known diffusion and noise.

    Of unwrapped angles with variance 2 D t of the walk and (noise / R)^2 of a reading, with the
    first angle unknown. Missing frames are taken to lie evenly.
    """
    count = round(FRAMES * (1.0 - rotor.missing))
    time_s = INTERVAL_S * np.linspace(0.0, FRAMES - 1.0, count)
    walk = 2.0 * rotor.diffusion_rad2_s * np.minimum.outer(time_s, time_s)
    covariance = walk + (rotor.noise_nm / RADIUS_NM) ** 2 * np.eye(count)
    design = np.column_stack([np.ones(count), time_s])
    information = design.T @ np.linalg.solve(covariance, design)
    return math.sqrt(float(np.linalg.inv(information)[1, 1]))
