"""`rotortrack run`: the whole workflow."""

from __future__ import annotations

import time
from pathlib import Path

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, output_option, stage_options
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages


@click.command("run", cls=StageCommand)
@click.argument("movie", metavar="MOVIE", type=FILE)
@output_option("RUN", "The run folder.")
@click.option("--no-figures", is_flag=True, help="Write tables alone.")
@stage_options("movie", "camera")
@click.pass_obj
def command(console: Console, movie: Path, output: Path, no_figures: bool, given: Given) -> None:
    """Analyse MOVIE from frames to rotor speeds.

    Options of every stage go into a configuration file (-c), or behind --set.
    """
    start = time.perf_counter()
    layers = gather(given)
    from rotortrack.pipeline.run import run_movie
    from rotortrack_cli.figures import draw
    from rotortrack_cli.summary import conclude

    with Stages(console) as stages:
        result = run_movie(movie, layers, output, workers=given.workers, progress=stages)
        if not no_figures:
            draw(result, stages)
    conclude(console, result, seconds=time.perf_counter() - start, strict=given.strict)
