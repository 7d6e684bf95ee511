"""`rotortrack run`: the whole workflow."""

from __future__ import annotations

import time
from pathlib import Path

import click

from rotortrack.pipeline.accuracy import LEVELS, accuracy_layer
from rotortrack.settings import Layer
from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, stage_options
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages


@click.command("run", cls=StageCommand)
@click.argument("movies", metavar="MOVIE...", type=FILE, nargs=-1)
@click.option("--output", "-o", type=FILE, metavar="RUN", help="The run folder.")
@click.option("--overwrite", is_flag=True, help="Replace results of another movie in RUN.")
@click.option("--no-figures", is_flag=True, help="Write tables alone.")
@click.option(
    "--reproduce",
    type=FILE,
    metavar="RUN",
    help="Repeat a finished run with its recorded options and compare the tables.",
)
@click.option(
    "--accuracy",
    type=click.Choice(LEVELS),
    help="Set the dials of all stages at once, and be told what that costs.",
)
@click.option(
    "--channels",
    type=FILE,
    metavar="CHANNELS.json",
    help="How the second colour lies on the first, made by `rotortrack register`.",
)
@stage_options(
    *("movie", "camera"),
    *("channels.split", "channels.swapped", "channels.first_region", "channels.second_region"),
    *("channels.second_movie", "channels.second_channel", "channels.line_time_s"),
)
@click.pass_obj
def command(
    console: Console,
    movies: tuple[Path, ...],
    output: Path | None,
    overwrite: bool,
    no_figures: bool,
    reproduce: Path | None,
    accuracy: str | None,
    channels: Path | None,
    given: Given,
) -> None:
    """Analyse MOVIE from frames to rotor speeds; several files are one recording, in their order.

    A run that was stopped goes on where it was when the same command is given again; a changed
    option reruns its stage and the later ones. Options of every stage go into a configuration file
    (-c), or behind --set. With --channels both ends of every rotor are localised, and end-to-end
    distances measured.
    """
    if channels is not None:
        given = given.adding("channels", registration=str(channels))
    if reproduce is not None:
        if overwrite or no_figures or accuracy:
            raise click.UsageError(
                "--reproduce draws no figures, replaces nothing and takes all options from the "
                "run: leave --overwrite, --no-figures and --accuracy out",
                click.get_current_context(),
            )
        from rotortrack_cli.reproduction import repeat

        repeat(console, reproduce, movies, output, given)
        return
    missing = [word for word, value in (("MOVIE", movies), ("-o RUN", output)) if not value]
    if missing or output is None:
        raise click.UsageError(
            f"{' and '.join(missing)} must be given", click.get_current_context()
        )
    start = time.perf_counter()
    layers = [*_dials(accuracy, given), *gather(given)]
    from rotortrack.pipeline.run import run_movie
    from rotortrack_cli.figures import draw
    from rotortrack_cli.summary import conclude

    with Stages(console) as stages:
        result = run_movie(
            movies,
            layers,
            output,
            workers=given.workers,
            overwrite=overwrite,
            progress=stages,
            draw=None if no_figures else lambda result: draw(result, stages),
        )
    conclude(console, result, seconds=time.perf_counter() - start, strict=given.strict)


def _dials(accuracy: str | None, given: Given) -> list[Layer]:
    """Give the layer of `--accuracy`, which everything else that is given wins over."""
    if accuracy is None:
        return []
    if given.preset is not None:
        raise click.UsageError(
            f"--accuracy {accuracy} and --preset {given.preset} both set the dials of all stages: "
            "leave one of them out",
            click.get_current_context(),
        )
    return [accuracy_layer(accuracy)]
