"""`rotortrack filter`: keep localisations that can be trusted."""

from __future__ import annotations

from pathlib import Path

import click

from rotortrack.errors import NothingFoundError
from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, output_option, stage_options
from rotortrack_cli.stage_option import StageCommand


@click.command("filter", cls=StageCommand)
@click.argument("locs", metavar="LOCS", type=FILE)
@output_option("LOCS", "Table to write.")
@stage_options("movie.pixel_size_nm", "quality", "density")
@click.pass_obj
def command(console: Console, locs: Path, output: Path, given: Given) -> None:
    """Keep the localisations in LOCS that are precise and have neighbours in the whole movie."""
    layers = gather(given)
    from rotortrack.pipeline.table_runs import filter_table

    with console.stage("filter"):
        read, precise, kept = filter_table(locs, output, layers)
    console.text(
        f"{read} localisations read, {precise} precise enough, {kept} of those with enough "
        f"neighbours written to {output}"
    )
    console.json({"localisations": read, "precise": precise, "kept": kept})
    if given.strict and kept == 0:
        raise NothingFoundError(f"no localisation of {locs} passes the filters")
