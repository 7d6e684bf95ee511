"""What the whole analysis costs at each `--accuracy`, and what that buys.

Films of rotors that stand apart, of dim ones, and of ones so close that their spots often overlap,
are analysed at each level and by the paper's choices, and compared with what is true in them:
positions (rms per axis), or the radii of the rotors that are kept (rms). Speeds are not compared:
they are limited by the rotors' own diffusion, which no analysis removes.
"""

from __future__ import annotations

import math
import tempfile
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, stamped

if TYPE_CHECKING:
    from rotortrack.simulate.scene import Scene
    from rotortrack.tradeoff.summary import Measure

TITLE: Final = "the whole run: --accuracy fast, balanced, best"

DEFAULT: Final = "balanced"
SETTINGS: Final = ("fast", "balanced", "best", "paper")

SCENES: Final[dict[str, dict[str, Any]]] = {
    "apart": {"rotors": [{"count": 12}, {"count": 4, "motion": "brownian"}]},
    "dim": {"rotors": [{"count": 16, "photons": [60.0, 120.0]}]},
    "crowded": {"rotors": [{"count": 60}], "lattice": {"pitch_nm": 800.0}},
}
_WARM_FRAMES: Final = 150

_FILM: Final[dict[str, Any]] = {
    "film": {"exposure_s": 0.002, "height_px": 160, "width_px": 160},
    "background": {},
    "camera": {},
}

MEASURES: Final = {
    "apart": ("positions (nm)", "rmse_nm"),
    "dim": ("radii (nm)", "radius_rmse_nm"),
    "crowded": ("positions (nm)", "rmse_nm"),
}
"""What is compared in each scene; of dim rotors the spots that are found differ, of crowded ones
many are refused, so that neither positions nor radii serve for all."""


@dataclass(frozen=True)
class Sizes:
    """Frames of a film, films of each scene, and analyses of each by which the time is told.

    Crowded films show more spots in a frame, and need fewer frames.
    """

    frames: int
    films: int
    repeats: int = 1
    crowded: int = 0

    def of(self, kind: str) -> int:
        """Frames of a film of a scene."""
        return self.crowded if kind == "crowded" and self.crowded else self.frames


SIZES: Final = {
    "quick": Sizes(300, 1, crowded=100),
    "usual": Sizes(1500, 1),
    "thorough": Sizes(6000, 4, 2),
}


def answer(effort: Effort, progress: Progress) -> Answer:
    """Film both scenes and analyse the films at every level, the levels in turns."""
    sizes = SIZES[effort.name]
    points = []
    progress("compiled code", 0, 0)
    measure("apart", Sizes(_WARM_FRAMES, 1), _unheard)
    for kind in SCENES:
        points += measure(kind, sizes, progress)
    return stamped(
        question="run",
        effort=effort,
        points=points,
        error_unit="nm rms",
        seconds_unit="s per 1000 frames of 160 x 160 pixels",
        bounds=dict.fromkeys(dict.fromkeys(point.group for point in points)),
        advice=advice(points),
    )


def group_of(kind: str) -> str:
    """Name the group of a scene."""
    return f"{kind}: {MEASURES[kind][0]}"


def advice(points: list[Point]) -> str:
    """Say what the points mean."""
    of = {(point.group, point.setting): point for point in points}
    told = []
    for level in ("fast", "best"):
        parts = []
        for kind in SCENES:
            own, usual = of[group_of(kind), level], of[group_of(kind), DEFAULT]
            time, error = own.seconds / usual.seconds, own.error / usual.error
            parts.append(f"{time:.2f} times the time for {error:.2f} times the error ({kind})")
        told.append(f"{level} takes {', '.join(parts)}")
    return f"Beside balanced, {'; '.join(told)}."


def measure(kind: str, sizes: Sizes, progress: Progress) -> list[Point]:
    """Analyse films of one scene in every way; what an analysis warns of is the film's matter."""
    with warnings.catch_warnings():
        # A run shows its warnings whatever the filters are.
        warnings.showwarning = _unheard
        return _measured(kind, sizes, progress)


def _unheard(*_: Any, **__: Any) -> None:
    """Show nothing."""


def _measured(kind: str, sizes: Sizes, progress: Progress) -> list[Point]:
    from rotortrack.pipeline.accuracy import LEVELS, accuracy_layer
    from rotortrack.pipeline.presets import preset_layer
    from rotortrack.simulate.film.filming import film_scene
    from rotortrack.tradeoff.closed_loop import analyse, reseeded
    from rotortrack.tradeoff.score import Score, read_truth, score
    from rotortrack.tradeoff.summary import summarise

    layers = {
        name: accuracy_layer(name) if name in LEVELS else preset_layer(name) for name in SETTINGS
    }
    scores: dict[str, list[Score]] = {name: [] for name in SETTINGS}
    seconds = dict.fromkeys(SETTINGS, 0.0)
    frames = sizes.of(kind)
    scene = _scene(kind, frames)
    total = sizes.films * sizes.repeats * len(SETTINGS)
    with tempfile.TemporaryDirectory(prefix="rotortrack-") as name:
        folder = Path(name)
        for number in range(sizes.films):
            progress("film", number, sizes.films)
            filmed = film_scene(reseeded(scene, number), folder / f"film-{number}.tif")
            truth = read_truth(filmed.truth)
            best = dict.fromkeys(SETTINGS, math.inf)
            for repeat in range(sizes.repeats):
                for at, (setting, layer) in enumerate(layers.items()):
                    done = (number * sizes.repeats + repeat) * len(SETTINGS) + at
                    progress(kind, done, total)
                    run = folder / f"run-{number}-{repeat}-{setting}"
                    begun = time.process_time()
                    tables = analyse(filmed, run, [layer], workers=1)
                    best[setting] = min(best[setting], time.process_time() - begun)
                    if not repeat:
                        scores[setting].append(
                            score(truth, tables["localisations"], tables["rotors"])
                        )
            for setting in SETTINGS:
                seconds[setting] += 1e3 * best[setting] / (frames * sizes.films)
    measures = {setting: summarise(own) for setting, own in scores.items()}
    return [
        _point(setting, group_of(kind), measures[setting][MEASURES[kind][1]], seconds[setting])
        for setting in SETTINGS
    ]


def _scene(kind: str, frames: int) -> Scene:
    from rotortrack.settings import Layer
    from rotortrack.simulate.scene import make_scene

    values = {**_FILM, **SCENES[kind], "film": {**_FILM["film"], "n_frames": frames}}
    return make_scene([Layer(f"question run, {kind}", values)])


def _point(setting: str, group: str, told: Measure, seconds: float) -> Point:
    failed = "" if math.isfinite(told.value) else "no rotor was kept"
    return Point(
        setting, group, told.value, told.low, told.high, seconds, setting == DEFAULT, failed
    )
