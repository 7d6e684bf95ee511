"""How well and how fast each estimator tells the place of a spot.

Single spots at random places within a pixel are filmed by a camera whose pixels differ in offset,
gain and read noise, and every setting estimates them from the same counts. The error is the rms
distance per axis over the spots of which every setting gives a place; one that gives none for more
than a tenth of them is left out. A place counts as none, too, where its own standard deviation
exceeds half the window: at 100 photons the correction of the bias moves one likelihood fit in 2000
far out of its window, with an error of thousands of pixels that `quality.max_uncertainty_nm` drops
in a run. The bound is that of Cramer and Rao with the background, photons
and width unknown, in the largest window.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, stamped
from rotortrack.tradeoff.turns import in_turns, rms_interval

if TYPE_CHECKING:
    from rotortrack.cameras.camera import Camera
    from rotortrack.localise.windows import CameraArrays

Floats = NDArray[np.float64]
Fit = tuple[Floats, NDArray[np.int32]]

TITLE: Final = "localiser: estimators, windows and camera maps"

DEFAULT: Final = "mle"
START_PX: Final = 1.6
"""Width at which fits start, the default of `localise.initial_sigma_px`."""
SIDE_PX: Final = 25
LARGEST_PX: Final = 4
MOST_LOST: Final = 0.1


@dataclass(frozen=True)
class Setting:
    """Method, half the window, and whether the camera's maps or their means are used."""

    method: str
    radius_px: int = 3
    maps: bool = True
    lanes: bool = True


SETTINGS: Final = {
    "centroid": Setting("centroid"),
    "radial symmetry": Setting("radial-symmetry"),
    "phasor": Setting("phasor"),
    "lsq": Setting("lsq"),
    "wlsq": Setting("wlsq"),
    DEFAULT: Setting("mle"),
    "mle float64": Setting("mle", lanes=False),
    "mle 5 x 5": Setting("mle", 2),
    "mle 9 x 9": Setting("mle", 4),
    "mle without maps": Setting("mle", maps=False),
}


@dataclass(frozen=True)
class Spots:
    """What spots are like: photons, background a pixel, width and pixel; noise of the camera.

    `at_border`: they lie within a pixel of the frame's edge, which clips their windows.
    """

    photons: float
    background: float = 8.0
    sigma_px: float = 1.25
    pixel_size_nm: float = 108.3
    read_noise_e: float = 1.6
    gain_e_per_adu: float = 0.46
    at_border: bool = False


GROUPS: Final = {
    "100 photons": Spots(100.0),
    "500 photons": Spots(500.0),
    "5000 photons": Spots(5000.0),
    "500 photons, at the border": Spots(500.0, at_border=True),
}


@dataclass(frozen=True)
class Sizes:
    """Spots of a group, and how often each setting is timed."""

    spots: int
    repeats: int


SIZES: Final = {"quick": Sizes(3_000, 2), "usual": Sizes(12_000, 5), "thorough": Sizes(100_000, 7)}


def answer(effort: Effort, progress: Progress, groups: Mapping[str, Spots] = GROUPS) -> Answer:
    """Localise the spots of every group by every setting, the settings in turns.

    Parameters
    ----------
    effort, progress
        As of every question.
    groups
        What spots are like, by the names of the groups.
    """
    points: list[Point] = []
    bounds: dict[str, float | None] = {}
    for group, spots in groups.items():
        made, bounds[group] = measure(group, spots, SIZES[effort.name], progress)
        points += made
    return stamped(
        question="localiser",
        effort=effort,
        points=points,
        error_unit="rms position error per axis, nm",
        seconds_unit="s per 1000 spots",
        bounds=bounds,
        advice=advice(points, bounds),
    )


def advice(points: list[Point], bounds: Mapping[str, float | None]) -> str:
    """Say what the points mean."""
    defaults = [point for point in points if point.setting == DEFAULT]
    worst = max(point.error / (bounds[point.group] or math.nan) for point in defaults)
    of = {(point.group, point.setting): point for point in points}
    fast = [point for point in defaults if not of[point.group, "phasor"].failed]
    ratios = [
        (of[p.group, "phasor"].error / p.error, p.seconds / of[p.group, "phasor"].seconds)
        for p in fast
    ]
    sentence = f"The likelihood fit stays within {worst:.2f} times the bound"
    if ratios:
        error, gain = max(error for error, _ in ratios), max(gain for _, gain in ratios)
        sentence += (
            f"; the phasor is up to {gain:.1f} times as fast for up to {error:.2f} times the error"
        )
    return sentence + "."


def measure(
    group: str, spots: Spots, sizes: Sizes, progress: Progress
) -> tuple[list[Point], float]:
    """Localise the spots of a group by all settings; the second result is the bound, nm."""
    from rotortrack.localise.windows import camera_arrays, cut_windows

    camera, counts, places = filmed(spots, sizes.spots)
    mean = flat(camera)
    arrays = {True: camera_arrays(camera, counts.dtype), False: camera_arrays(mean, counts.dtype)}
    pixels = np.floor(places).astype(np.int32)
    candidates = np.column_stack([np.arange(len(places), dtype=np.int32), pixels[:, ::-1]])
    candidates = np.ascontiguousarray(candidates)
    works: dict[str, Callable[[], Fit]] = {}
    for name, setting in SETTINGS.items():
        windows = cut_windows(counts, arrays[setting.maps], candidates, setting.radius_px)
        works[name] = functools.partial(estimated, windows, setting)
    found = in_turns(works, sizes.repeats, progress, group)
    kept = {name: _kept(*fit, SETTINGS[name].radius_px) for name, (fit, _) in found.items()}
    lost = {name: 1.0 - float(np.mean(good)) for name, good in kept.items()}
    shared = np.logical_and.reduce([good for name, good in kept.items() if lost[name] <= MOST_LOST])
    points = []
    for name, ((results, _), seconds) in found.items():
        off_nm = (results[:2].T + pixels + 0.5 - places) * spots.pixel_size_nm
        squares = np.mean(off_nm[shared] ** 2, axis=1)
        failed = lost[name] > MOST_LOST
        error = (math.nan,) * 3 if failed else rms_interval(squares)
        why = f"gives {lost[name]:.0%} of the spots no place" if failed else ""
        points.append(Point(name, group, *error, 1e3 * seconds / sizes.spots, name == DEFAULT, why))
    return points, bound_nm(spots, arrays[True], places)


def estimated(windows: Any, setting: Setting) -> Fit:
    """Estimate the spots of windows."""
    from rotortrack.localise.fit import RESULT_COLUMNS, fit_chosen
    from rotortrack.localise.lanes import fit_windows
    from rotortrack.localise.quick import QUICK_METHODS, estimate

    method: Any = setting.method
    if method in QUICK_METHODS:
        return estimate(windows, setting.radius_px, method=method, sigma_px=START_PX)
    if setting.lanes:
        return fit_windows(windows, setting.radius_px, method=method, sigma_px=START_PX)
    count = len(windows.flags)
    results, flags = np.empty((len(RESULT_COLUMNS), count)), windows.flags.copy()
    fit_chosen(
        windows,
        np.arange(count),
        method=method,
        sigma_px=START_PX,
        free_sigma=True,
        correct_bias=True,
        results=results,
        flags=flags,
    )
    return results, flags


def filmed(spots: Spots, count: int) -> tuple[Camera, NDArray[np.uint16], Floats]:
    """Film spots, one a frame: the camera, counts (frame, y, x), places (frame, x and y; px)."""
    from rotortrack.cameras.camera import Camera
    from rotortrack.simulate.psf import pixel_fractions

    rng = np.random.default_rng((int(spots.photons), int(spots.background), spots.at_border))
    size = (SIDE_PX, SIDE_PX)
    camera = Camera(
        offset_adu=rng.normal(100.0, 1.5, size),
        gain_e_per_adu=spots.gain_e_per_adu * np.exp(rng.normal(0.0, 0.03, size)),
        # sCMOS pixels have a median noise and a tail of a few times that.
        read_noise_e=spots.read_noise_e * np.exp(np.abs(rng.normal(0.0, 0.4, size))),
    )
    middle = SIDE_PX // 2
    places = rng.uniform(middle, middle + 1.0, (count, 2))
    if spots.at_border:
        places[:, 0] = rng.uniform(0.5, 2.0, count)
    # Cut in parts, so that the light of all frames never lies in memory at once.
    counts = np.empty((count, *size), np.uint16)
    for start in range(0, count, 2000):
        part = places[start : start + 2000]
        zero = np.zeros(1, np.int64)
        columns = pixel_fractions(part[:, 0], zero, SIDE_PX, spots.sigma_px)
        rows = pixel_fractions(part[:, 1], zero, SIDE_PX, spots.sigma_px)
        light = spots.background + spots.photons * rows[:, :, np.newaxis] * columns[:, np.newaxis]
        counts[start : start + 2000] = camera.to_counts(light, rng)
    return camera, counts, places


def flat(camera: Camera) -> Camera:
    """Give the camera that one number for all pixels makes of the maps."""
    from rotortrack.cameras.camera import Camera

    return Camera(
        offset_adu=float(np.mean(camera.offset_adu)),
        gain_e_per_adu=float(np.mean(camera.gain_e_per_adu)),
        read_noise_e=float(np.sqrt(np.mean(np.square(camera.read_noise_e)))),
    )


def bound_nm(spots: Spots, arrays: CameraArrays, places: Floats, most: int = 500) -> float:
    """Give the rms over some spots of the Cramer-Rao bound per axis in the largest window, nm."""
    from rotortrack.localise.gaussian import PARAMETERS, X, Y
    from rotortrack.localise.precision import covariance

    n = 2 * LARGEST_PX + 1
    result = np.empty((PARAMETERS, PARAMETERS))
    total = 0.0
    chosen = places[:most]
    for place in chosen:
        left, top = (np.floor(place).astype(int) - LARGEST_PX).tolist()
        variance, keep = np.zeros((n, n)), np.zeros((n, n))
        y0, x0 = max(-top, 0), max(-left, 0)
        seen = arrays.variance_e2[top + y0 : top + n, left + x0 : left + n]
        inside = np.s_[y0 : y0 + seen.shape[0], x0 : x0 + seen.shape[1]]
        variance[inside], keep[inside] = seen, 1.0
        off = place - np.floor(place) - 0.5
        truth = np.array([*off, spots.photons, spots.background, spots.sigma_px])
        covariance(truth, variance, keep, keep, False, True, True, result)
        total += 0.5 * (result[X, X] + result[Y, Y])
    return math.sqrt(total / len(chosen)) * spots.pixel_size_nm


def _kept(results: Floats, flags: NDArray[np.int32], radius_px: int) -> NDArray[np.bool_]:
    """Tell which spots `localise` would report with an error that their window can hold."""
    from rotortrack.flags import FitFlag
    from rotortrack.localise.fit import RESULT_COLUMNS

    dropped = int(FitFlag.LEFT_WINDOW | FitFlag.SINGULAR | FitFlag.NOT_FINITE)
    errors = [results[RESULT_COLUMNS.index(name)] for name in ("x_sd_px", "y_sd_px")]
    placed = (flags & dropped == 0) & np.isfinite(results[:2]).all(axis=0)
    kept: NDArray[np.bool_] = placed & (np.maximum(*errors) <= radius_px)
    return kept
