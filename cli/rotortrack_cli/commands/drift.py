"""`rotortrack drift`: subtract stage drift from localisations."""

from __future__ import annotations

from pathlib import Path

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, output_option, stage_options
from rotortrack_cli.stage_option import StageCommand


@click.command("drift", cls=StageCommand)
@click.argument("locs", metavar="LOCS", type=FILE)
@output_option("LOCS", "Table to write; drift.csv is written beside it.")
@stage_options("movie.pixel_size_nm", "drift")
@click.pass_obj
def command(console: Console, locs: Path, output: Path, given: Given) -> None:
    """Estimate the drift that the localisations in LOCS show, and subtract it."""
    layers = gather(given)
    from rotortrack.pipeline.table_runs import correct_drift

    with console.stage("drift"):
        drift, beside = correct_drift(locs, output, layers)
    table = drift.table
    reach = {axis: float(table[axis].max() - table[axis].min()) for axis in ("dx_nm", "dy_nm")}
    if not len(table):
        reach = {"dx_nm": 0.0, "dy_nm": 0.0}
    console.text(
        f"drift over {len(table)} frames: {reach['dx_nm']:.1f} nm in x, {reach['dy_nm']:.1f} nm "
        f"in y; written to {output} and {beside}"
    )
    console.json({"frames": len(table), "estimated": drift.estimated, **reach})
