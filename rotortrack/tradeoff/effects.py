"""What each effect of a filmed scene costs, by leaving it out."""

from __future__ import annotations

import statistics
import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from rotortrack.simulate.film.film import Film
from rotortrack.simulate.film.scene import FilmScene
from rotortrack.simulate.scene import Scene, make_scene

if TYPE_CHECKING:
    from rotortrack.simulate.film.shapes import Shape

EVERYTHING: Final[dict[str, Any]] = {
    "film": {"n_frames": 400, "exposure_s": 0.002, "height_px": 128, "width_px": 256},
    "rotors": [
        {"count": 10, "ends": 2},
        {"count": 2, "motion": "brownian"},
        {"count": 2, "motion": "stuck"},
    ],
    "lattice": {"pitch_nm": 2000.0},
    "voltage": {"times_s": [0.0, 0.4], "voltages_mv": [50.0, 100.0]},
    "dyes": {"labelled": 0.9},
    "bleaching": {},
    "blinking": {},
    "background": {"texture": 0.1, "gradient": [0.2, 0.1]},
    "laser": {},
    "flicker": {},
    "psf": {"astigmatism_nm": 300.0},
    "drift": {"total_nm": [50.0, -30.0], "walk_nm": 0.3},
    "vibration": {},
    "free_rods": {},
    "split": {"shift_nm": [80.0, -40.0], "radial_nm": 60.0, "crosstalk": [0.05, 0.0]},
    "camera": {},
    "pixel_maps": {},
    "hot_pixels": {},
    "column_noise": {},
    "rolling_shutter": {},
    "dropped": {"fraction": 0.01},
    "timestamps": {},
}
"""A scene with every effect, for those who bring none."""

_MEMORY_FRAMES = 64


@dataclass(frozen=True)
class EffectCost:
    """What one effect costs.

    Attributes
    ----------
    effect
        Its section; `everything` for the whole scene.
    ms_per_frame
        Processor time a frame that leaving it out saves; negative where the scene is dearer without
        it, as one whose dyes never go dark.
    spread_ms
        How far the times of its films differ: their median less the least.
    share
        Part of the whole film's time.
    peak_mb
        Memory at the peak that leaving it out saves.
    """

    effect: str
    ms_per_frame: float
    spread_ms: float
    share: float
    peak_mb: float


def everything() -> Scene:
    """Give a scene with every effect."""
    from rotortrack.settings import Layer

    return make_scene([Layer("every effect", EVERYTHING)])


def effect_costs(
    scene: FilmScene,
    shapes: Sequence[Sequence[Shape]] = (),
    *,
    frames: int = 256,
    repeats: int = 7,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[EffectCost]:
    """Film a scene again and again, each time with another effect left out.

    Parameters
    ----------
    scene, shapes
        What is filmed, and the rods of its groups.
    frames
        How many are filmed each time, if the scene has as many.
    repeats
        Films of each kind, taken in turns, so that a machine that slows down slows all.
    progress
        Called with what goes on, films done and films in all.

    Returns
    -------
    list of EffectCost
        The whole scene first, then the effects, the dearest first.
    """
    frames = min(frames, scene.film.n_frames)
    names = scene.names
    variants = {name: scene.without(name) for name in names}
    kept = {name: shapes if variants[name].rotors else () for name in names}
    _cpu_seconds(scene, shapes, frames)
    whole_s: list[float] = []
    without_s: dict[str, list[float]] = {name: [] for name in names}
    for repeat in range(repeats):
        whole_s.append(_cpu_seconds(scene, shapes, frames))
        for number, name in enumerate(names, 1):
            without_s[name].append(_cpu_seconds(variants[name], kept[name], frames))
            if progress is not None:
                progress("film", repeat * len(names) + number, repeats * len(names))
    peak_mb = _peak_mb(scene, shapes)
    # The shortest of several times is the one that nothing else on the machine lengthened.
    whole, own = min(whole_s), {name: min(times) for name, times in without_s.items()}
    costs = [
        EffectCost(
            effect=name,
            ms_per_frame=1e3 * (whole - own[name]) / frames,
            spread_ms=1e3 * (statistics.median(times) - own[name]) / frames,
            share=(whole - own[name]) / whole,
            peak_mb=peak_mb - _peak_mb(variants[name], kept[name]),
        )
        for name, times in without_s.items()
    ]
    first = EffectCost(
        effect="everything",
        ms_per_frame=1e3 * whole / frames,
        spread_ms=1e3 * (statistics.median(whole_s) - whole) / frames,
        share=1.0,
        peak_mb=peak_mb,
    )
    return [first, *sorted(costs, key=lambda cost: -cost.ms_per_frame)]


def advice(costs: Sequence[EffectCost]) -> str:
    """Say in a sentence what the costs mean."""
    whole, *effects = costs
    dear = [cost for cost in effects if cost.ms_per_frame > 2.0 * cost.spread_ms][:3]
    most = ", ".join(
        f"{cost.effect} {cost.ms_per_frame:.2f} ms ({cost.share:.0%})" for cost in dear
    )
    return (
        f"A frame takes {whole.ms_per_frame:.2f} ms of one processor"
        + (f"; most of it is {most}" if dear else "")
        + ". What a scene does not name costs nothing."
    )


def _cpu_seconds(scene: FilmScene, shapes: Sequence[Sequence[Shape]], frames: int) -> float:
    begun = time.thread_time()
    for _ in Film(scene, shapes, n_frames=frames).blocks(workers=1):
        pass
    return time.thread_time() - begun


def _peak_mb(scene: FilmScene, shapes: Sequence[Sequence[Shape]]) -> float:
    tracemalloc.start()
    try:
        for _ in Film(scene, shapes, n_frames=_MEMORY_FRAMES).blocks(workers=1):
            pass
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()
