"""`rotortrack motion`: rotors to speeds."""

from __future__ import annotations

import time
from pathlib import Path

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, stage_options
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages


@click.command("motion", cls=StageCommand)
@click.argument("run", metavar="RUN", type=FILE)
@click.option(
    "--daq",
    type=FILE,
    metavar="TRACE",
    help="Recorded trace (.csv: time_s, trigger_v, voltage_v) of camera trigger and voltage.",
)
@click.option("--no-figures", is_flag=True, help="Write tables alone.")
@stage_options("movie.frame_interval_s", "movie.exposure_s", "motion")
@click.pass_obj
def command(console: Console, run: Path, daq: Path | None, no_figures: bool, given: Given) -> None:
    """Measure angles, speeds, diffusion and behaviour of the rotors in the run folder RUN.

    With --daq every frame gets its voltage and every rotor a speed at each voltage.
    """
    start = time.perf_counter()
    layers = gather(given)
    from rotortrack.pipeline.folder_runs import motion_of_run
    from rotortrack_cli.figures import draw
    from rotortrack_cli.summary import conclude

    with Stages(console) as stages:
        result = motion_of_run(
            run,
            layers,
            trace=daq,
            progress=stages,
            draw=None if no_figures else lambda result: draw(result, stages),
        )
    conclude(console, result, seconds=time.perf_counter() - start, strict=given.strict)
