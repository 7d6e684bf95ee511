"""`rotortrack end-to-end`: the distances of both ends of every rotor."""

from __future__ import annotations

import time
from pathlib import Path

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, stage_options
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages


@click.command("end-to-end", cls=StageCommand)
@click.argument("run", metavar="RUN", type=FILE)
@click.option("--no-figures", is_flag=True, help="Write tables alone.")
@stage_options("ends", "channels.line_time_s")
@click.pass_obj
def command(console: Console, run: Path, no_figures: bool, given: Given) -> None:
    """Measure end-to-end distances in the run folder RUN, which shows two colours.

    `rotortrack run --channels` does so, too; this changes how it is done.
    """
    start = time.perf_counter()
    layers = gather(given)
    from rotortrack.errors import NothingFoundError
    from rotortrack.pipeline.ends_run import end_to_end_of_run
    from rotortrack_cli.figures import draw
    from rotortrack_cli.summary import show_ends

    with Stages(console) as stages:
        result = end_to_end_of_run(
            run,
            layers,
            progress=stages,
            draw=None if no_figures else lambda result: draw(result, stages),
        )
    show_ends(console, result)
    seconds = time.perf_counter() - start
    console.text(f"\n{seconds:.1f} s; results in {run / 'end_to_end_rotors.csv'}")
    rotors = result.tables["end_to_end_rotors"]
    console.json(
        {
            "rotors": rotors.to_dict("records"),
            **result.record.content["end_to_end"],
            "seconds": round(seconds, 3),
        }
    )
    if given.strict and rotors.empty:
        raise NothingFoundError(f"no rotor of {run} shows both ends")
