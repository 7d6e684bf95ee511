"""`rotortrack rotors`: localisations to rotors."""

from __future__ import annotations

import time
from pathlib import Path

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, output_option, stage_options
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages


@click.command("rotors", cls=StageCommand)
@click.argument("locs", metavar="LOCS", type=FILE)
@output_option("RUN", "The run folder.")
@click.option("--overwrite", is_flag=True, help="Replace results of another table in RUN.")
@stage_options(
    "movie.pixel_size_nm",
    "movie.frame_interval_s",
    "movie.exposure_s",
    "cluster",
    "circle",
    "screen",
)
@click.pass_obj
def command(console: Console, locs: Path, output: Path, overwrite: bool, given: Given) -> None:
    """Group the localisations in LOCS into rotors, fit circles and screen them.

    LOCS may come from any program (.parquet, ThunderSTORM .csv, Picasso .hdf5) and is taken as it
    is: use `rotortrack drift` and `rotortrack filter` before, where that was not done yet.
    """
    start = time.perf_counter()
    layers = gather(given)
    from rotortrack.pipeline.folder_runs import rotors_from_table
    from rotortrack_cli.summary import conclude

    with Stages(console) as stages:
        result = rotors_from_table(locs, layers, output, overwrite=overwrite, progress=stages)
    conclude(console, result, seconds=time.perf_counter() - start, strict=given.strict)
