"""`rotortrack simulate film`, `check` and `sample`: movies of rotors whose motion is known."""

from __future__ import annotations

from pathlib import Path

import click

from rotortrack.errors import UsageError
from rotortrack.simulate.scene import Scene
from rotortrack_cli.commands.simulate_check import ANALYSES, FILMS, check_twin
from rotortrack_cli.commands.simulate_check import check as compare
from rotortrack_cli.console import Console
from rotortrack_cli.flags import output_flags, output_option
from rotortrack_cli.scene_flags import scene_flags
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages

SAMPLE_NAMES = ("rotors", "salt", "two_colours", "fiducials")

_POINTS = "fiducials"
"""The sample without rotors."""


@click.command("film", cls=StageCommand)
@scene_flags()
@output_option("MOVIE.tif", "Where the movie is written; the truth lies beside it.")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Threads to use. The movie does not depend on it. [default: all processors]",
)
@output_flags
@click.pass_obj
def film(console: Console, scene: Scene, output: Path, workers: int | None) -> None:
    """Film the [[rotors]] of a scene as a camera would, and write the truth beside the movie."""
    scene.require("film")
    if output.suffix.lower() not in (".tif", ".tiff"):
        raise UsageError(f"{output} does not end in .tif or .ome.tif: name the movie so with -o")
    from rotortrack.movies.write import is_ome
    from rotortrack.simulate.film.filming import film_scene, truth_folder

    if output.exists() and not (truth_folder(output) / "scene.toml").exists():
        raise UsageError(
            f"{output} is there already without a truth beside it, so it may be no simulated film: "
            "name another file with -o"
        )
    with Stages(console) as stages:
        made = film_scene(scene, output, workers=workers, progress=stages)
    console.text(
        f"{made.frames} frames of {made.rotors} rotors in {output}, the truth in {made.truth}: "
        f"{made.frames / made.seconds:.0f} frames/s"
    )
    console.text("in the scene: " + ", ".join(made.effects))
    timed = [f"[{name}]" for name in ("dropped", "timestamps") if name in made.effects]
    if timed and not is_ome(output):
        console.text(
            f"{output.name} does not tell when frames were taken, so that an analysis cannot know "
            f"of {' and '.join(timed)}: name it .ome.tif if it should"
        )
    console.text(f"try `rotortrack run {output} -c {made.truth / 'config.toml'} -o RUN`")
    console.json(
        {
            "frames": made.frames,
            "rotors": made.rotors,
            "effects": list(made.effects),
            "movie": made.movie,
            "truth": made.truth,
            "seconds": made.seconds,
        }
    )


@click.command("check", cls=StageCommand)
@scene_flags(optional=True)
@output_option("FOLDER", "Where films, truths, runs and the comparison are written.")
@click.option(
    "--from-run",
    "run",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="RUN",
    help="Film rotors like those of a finished run instead of a scene, analyse them by its "
    "options, and write error_budget.json into it.",
)
@FILMS
@ANALYSES
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Threads to use. The result does not depend on it. [default: all processors]",
)
@click.option("--no-figures", is_flag=True, help="Write numbers alone.")
@output_flags
@click.pass_obj
def check(
    console: Console,
    scene: Scene | None,
    output: Path,
    run: Path | None,
    films: int,
    presets: tuple[str, ...],
    workers: int | None,
    no_figures: bool,
) -> None:
    """Film a scene, analyse the film, and compare with the truth: how good is the analysis here."""
    if (scene is None) == (run is None):
        raise UsageError("give SCENE.toml or --from-run RUN, one of them")
    if run is not None:
        if presets:
            raise UsageError(
                "--analysis is for SCENE.toml: a twin is analysed by its run's options"
            )
        check_twin(console, run, output, films=films, workers=workers)
        return
    assert scene is not None
    compare(
        console,
        scene,
        output,
        films=films,
        presets=presets,
        workers=workers,
        figures=not no_figures,
    )


@click.command("sample", cls=StageCommand)
@click.argument("name", metavar="[NAME]", type=click.Choice(SAMPLE_NAMES), default="rotors")
@output_option("FOLDER", "Where movie.tif, config.toml, scene.toml and truth/ are written.")
@output_flags
@click.pass_obj
def sample(console: Console, name: str, output: Path) -> None:
    """Make a sample film of simulated rods: rotors, salt, two_colours or fiducials."""
    from rotortrack.simulate.sample import make_sample

    with console.stage("simulate"):
        make_sample(output, name)
    command, target = ("localise", "POINTS.csv") if name == _POINTS else ("run", "RUN")
    console.text(
        f"sample written to {output}: try `rotortrack {command} {output / 'movie.tif'} "
        f"-c {output / 'config.toml'} -o {target}`"
    )
    console.json({"output": output})
