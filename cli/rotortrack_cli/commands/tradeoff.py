"""`rotortrack tradeoff`: what accuracy costs in time, measured on this machine."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from rotortrack.tradeoff.questions import ON_MOVIES, QUESTIONS
from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, stage_options
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages

if TYPE_CHECKING:
    from rotortrack.settings import Layer
    from rotortrack.tradeoff.point import Answer, Point

_EFFECTS = "effects"
_ALL = (*QUESTIONS, _EFFECTS)


@click.command("tradeoff", cls=StageCommand, epilog=f"Questions: {', '.join(_ALL)}.")
@click.argument("questions", metavar="[QUESTION...]", nargs=-1)
@click.option("--quick", is_flag=True, help="Some 15 s a question instead of two minutes.")
@click.option("--thorough", is_flag=True, help="As long as it takes for narrow intervals.")
@click.option(
    "--output",
    "-o",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Where QUESTION.json, .csv and .png are written.",
)
@click.option(
    "--on",
    "movie",
    type=FILE,
    metavar="MOVIE",
    help="Ask about spots and drift as in this movie; its flags are those of `localise`.",
)
@stage_options("movie", "camera")
@click.pass_obj
def command(
    console: Console,
    questions: tuple[str, ...],
    quick: bool,
    thorough: bool,
    output: Path | None,
    movie: Path | None,
    given: Given,
) -> None:
    """Show what accuracy costs in time on this machine, one table a QUESTION; all without any.

    Defaults are marked, and so are the settings that no other beats in both error and time. The
    question `effects` takes a SCENE.toml behind it, whose effects are left out one by one. With
    `--on MOVIE` the questions `localiser` and `drift` are asked about what is measured there.
    """
    scene, names = _scene_of(questions)
    unknown = [name for name in names if name not in _ALL]
    if unknown:
        raise click.UsageError(
            f"{', '.join(unknown)} is not a question: known are {', '.join(_ALL)}",
            click.get_current_context(),
        )
    if quick and thorough:
        raise click.UsageError(
            "--quick and --thorough exclude each other: give one", click.get_current_context()
        )
    layers = gather(given)
    from rotortrack.files import make_folder
    from rotortrack.tradeoff.ask import ask, title, write_answer
    from rotortrack.tradeoff.point import Effort
    from rotortrack_cli.effects import tell_effects

    word: Literal["quick", "usual", "thorough"] = "quick" if quick else "usual"
    effort = Effort("thorough" if thorough else word)
    chosen = names or (_ALL if movie is None else ON_MOVIES)
    if output is not None:
        # Before minutes are spent on answers that have no place.
        make_folder(output)
    told: dict[str, Any] = {}
    groups = None if movie is None else _groups_of(console, movie, layers, given.workers, chosen)
    for name in chosen:
        if len(chosen) > 1:
            console.text(f"\n{name}")
        if name == _EFFECTS:
            told[name] = tell_effects(console, scene, output, quick=quick)
            continue
        console.text(f"{title(name)}\n")
        with Stages(console, "") as stages:
            answer = ask(name, effort, stages, None if groups is None else groups[name])
        _show(console, answer)
        if output is not None:
            write_answer(answer, output)
        told[name] = answer.plain()
    console.json(told[chosen[0]] if len(chosen) == 1 else {"questions": told})


def _groups_of(
    console: Console,
    movie: Path,
    layers: list[Layer],
    workers: int | None,
    names: tuple[str, ...],
) -> Mapping[str, Mapping[str, Any]]:
    """Measure what spots and drift of a movie are like, and tell it."""
    others = [name for name in names if name not in ON_MOVIES]
    if others:
        raise click.UsageError(
            f"--on MOVIE goes with {' and '.join(ON_MOVIES)}, not with {', '.join(others)}",
            click.get_current_context(),
        )
    from rotortrack.pipeline.localise_run import opened
    from rotortrack.tradeoff.own_movie import groups, measure

    with opened(movie, layers, "movie.pixel_size_nm") as source, Stages(console) as stages:
        measured = measure(source, workers=workers, progress=stages)
    console.text(f"{measured.sentence}\n")
    return groups(measured)


def _scene_of(words: tuple[str, ...]) -> tuple[Path | None, tuple[str, ...]]:
    """Tell the scene behind `effects` from the names of questions."""
    if len(words) == 2 and words[0] == _EFFECTS and words[1] not in _ALL:
        return Path(words[1]), words[:1]
    return None, words


def _show(console: Console, answer: Answer) -> None:
    from rotortrack.tradeoff.point import pareto

    front = pareto(answer.points)
    for group in answer.groups:
        own = [point for point in answer.points if point.group == group]
        bound = answer.bounds.get(group)
        console.text(group + ("" if bound is None else f" (bound {bound:.3g})"))
        console.table(
            ("setting", "error", "95 % interval", "seconds", ""),
            [_row(point, is_best=point in front) for point in own],
        )
        console.text("")
    console.text(f"error: {answer.error_unit}; seconds: {answer.seconds_unit}")
    console.text(answer.advice)


def _row(point: Point, *, is_best: bool) -> list[str]:
    marks = ["default"] * point.is_default + ["Pareto"] * is_best
    if point.failed:
        marks.append(point.failed)
    return [
        point.setting,
        f"{point.error:.3g}",
        f"{point.error_low:.3g} to {point.error_high:.3g}",
        f"{point.seconds:.3g}",
        ", ".join(marks),
    ]
