"""The closed loop: film a scene, analyse the film, and compare with what is known to be true.

An error that the simulator and the analysis share cancels here. What anchors both to the world is
tested elsewhere: the gain by the photon-transfer slope, x and y by the centroid of a rendered
point, the sign by a drawn turning spot, and movies from another generator.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pandas as pd

from rotortrack.errors import ConfigurationError
from rotortrack.pipeline.presets import PRESETS as KNOWN
from rotortrack.pipeline.presets import preset_layer
from rotortrack.pipeline.run import run_movie
from rotortrack.settings import Layer, read_toml
from rotortrack.simulate.film.filming import film_scene, shapes_for
from rotortrack.simulate.scene import Scene, make_scene, read_scene
from rotortrack.tradeoff.score import Score, read_truth, score
from rotortrack.tradeoff.summary import AIMS, Measure, better, summarise

if TYPE_CHECKING:
    from rotortrack.simulate.film.filming import Filmed

PRESETS: Final = ("default", "paper")
"""Analyses that are compared."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Analysis:
    """What one preset made of all films.

    Attributes
    ----------
    preset
        Its name.
    scores
        One for each film.
    measures
        The numbers of `summary.AIMS`, films pooled.
    seconds
        Time of the analyses.
    """

    preset: str
    scores: tuple[Score, ...]
    measures: dict[str, Measure]
    seconds: float

    @property
    def rotors(self) -> pd.DataFrame:
        """All true rotors with what was found of them, and the number of their `film`."""
        tables = [one.rotors.assign(film=film) for film, one in enumerate(self.scores)]
        return pd.concat(tables, ignore_index=True)

    @property
    def false_rotors(self) -> int:
        """Rotors kept where there is none."""
        return sum(one.false_rotors for one in self.scores)


@dataclass(frozen=True)
class ClosedLoop:
    """Films of a scene, analysed by some presets."""

    analyses: tuple[Analysis, ...]
    films: int

    def as_dict(self) -> dict[str, Any]:
        """All numbers, for JSON; those of the first preset stand in front by their bare names."""
        first = self.analyses[0]
        return {
            **{name: _plain(measure.value) for name, measure in first.measures.items()},
            "films": self.films,
            "rotors": len(first.rotors),
            "false_rotors": first.false_rotors,
            "presets": {
                one.preset: {
                    name: {key: _plain(value) for key, value in vars(measure).items()}
                    for name, measure in one.measures.items()
                }
                for one in self.analyses
            },
            "verdicts": {one.preset: confusion(one, "verdict") for one in self.analyses},
            "behaviours": {one.preset: confusion(one, "behaviour") for one in self.analyses},
        }

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Headings and rows: each number by each preset, the best one marked."""
        rows = []
        for name, (meaning, _) in AIMS.items():
            cells = [meaning]
            for one in self.analyses:
                others = [other for other in self.analyses if other is not one]
                measure = one.measures[name]
                wins = others and all(
                    not better(name, other.measures[name], measure) for other in others
                )
                cells.append(_written(measure) + (" *" if wins else ""))
            rows.append(cells)
        return ["", *(one.preset for one in self.analyses)], rows


def check_scene(
    scene: Scene,
    folder: Path,
    *,
    films: int = 1,
    presets: Sequence[str] = PRESETS,
    keep_movies: bool = True,
    workers: int | None = None,
    progress: Progress | None = None,
) -> ClosedLoop:
    """Film a scene some times, analyse every film by every preset, and compare with the truth.

    Parameters
    ----------
    scene
        With a section [film]. The films have its seed, the next one, and so on.
    folder
        Where films, truths and runs are kept.
    films
        How many.
    presets
        `default` and names of presets of the analysis.
    keep_movies
        Whether movies stay once they are analysed.
    workers
        Threads; the result does not depend on it.
    progress
        Called as films and analyses advance.

    Raises
    ------
    RotortrackError
        What filming or analysing raises.
    """
    # An unknown name is told before anything is filmed.
    layers = {preset: _layers_of(preset) for preset in presets}
    scores: dict[str, list[Score]] = {preset: [] for preset in presets}
    seconds = dict.fromkeys(presets, 0.0)
    scene.require("film")
    assert scene.film is not None
    # The analysis learns of lost frames from the times in the file.
    timed = scene.film.dropped is not None or scene.film.timestamps is not None
    ending = ".ome.tif" if timed else ".tif"
    shapes = shapes_for(scene)
    for number in range(films):
        if progress is not None:
            progress(f"film {number + 1} of {films}", 0, 0)
        movie = folder / f"film-{number:02d}{ending}"
        filmed = film_scene(reseeded(scene, number), movie, shapes=shapes, workers=workers)
        truth = read_truth(filmed.truth)
        for preset in presets:
            if progress is not None:
                progress(f"analysis of film {number + 1}, {preset}", 0, 0)
            begun = time.perf_counter()
            run = folder / f"run-{number:02d}-{preset}"
            result = analyse(filmed, run, layers[preset], workers=workers)
            seconds[preset] += time.perf_counter() - begun
            scores[preset].append(score(truth, result["localisations"], result["rotors"]))
        if not keep_movies:
            movie.unlink()
    analyses = tuple(
        Analysis(preset, tuple(own), summarise(own), seconds[preset])
        for preset, own in scores.items()
    )
    return ClosedLoop(analyses, films)


def analyse(
    filmed: Filmed, run: Path, layers: Sequence[Layer], *, workers: int | None = None
) -> dict[str, pd.DataFrame]:
    """Analyse a film as the command would, with the configuration beside its truth."""
    layers = [*layers, config_layer(filmed)]
    return dict(run_movie(filmed.movie, layers, run, workers=workers, overwrite=True).tables)


def _layers_of(preset: str) -> list[Layer]:
    if preset == "default":
        return []
    if preset not in KNOWN:
        raise ConfigurationError(
            f"--analysis {preset} is not known: known are default, {', '.join(KNOWN)}"
        )
    return [preset_layer(preset)]


def config_layer(filmed: Filmed) -> Layer:
    """Give the configuration beside a film's truth, of two colours that of the first one's half."""
    configuration = filmed.truth / "config.toml"
    values = read_toml(configuration)
    film = read_scene(filmed.truth / "scene.toml").film
    if film is not None and film.split is not None:
        height, width = film.field_px
        values["movie"]["region"] = [0, 0, width, height]
    maps = values["camera"].get("camera_maps")
    if maps is not None:
        values["camera"]["camera_maps"] = str(configuration.parent / maps)
    return Layer(f"config {configuration.name}", values)


def reseeded(scene: Scene, more: int) -> Scene:
    """Give the scene with another seed."""
    if not more:
        return scene
    values = scene.as_dict()
    values["film"]["seed"] += more
    return make_scene([Layer(scene.origin, values)], origin=scene.origin)


def confusion(analysis: Analysis, what: str) -> dict[str, dict[str, int]]:
    """Count what was found of each kind of rotor.

    Parameters
    ----------
    analysis
        By one preset.
    what
        `verdict`, or `behaviour` of kept rotors.

    Returns
    -------
    dict
        Counts by kind of true rotor, then by what was found; `not found` among it.
    """
    rotors = analysis.rotors
    kind = rotors["motion"].where(~rotors["double"], "two on a pore")
    if what == "verdict":
        found = rotors["found_verdict"].fillna("not found")
    else:
        kept = rotors["found_verdict"] == "kept"
        found = rotors["found_behaviour"].where(kept, "refused").fillna("unclassified")
        found = found.where(rotors["found"], "not found")
    counted = pd.crosstab(kind, found)
    return {
        str(row): {str(name): int(count) for name, count in counts.items() if count}
        for row, counts in counted.to_dict("index").items()
    }


def _written(measure: Measure) -> str:
    if not math.isfinite(measure.value):
        return "not told"
    return f"{measure.value:.4g} ({measure.low:.3g} to {measure.high:.3g})"


def _plain(value: float) -> float | None:
    """Give a number as JSON has it: none for what is not told."""
    return value if math.isfinite(value) else None
