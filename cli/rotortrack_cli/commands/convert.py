"""`rotortrack convert`: localisations from one program's format to another's."""

from __future__ import annotations

from pathlib import Path

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, output_flags
from rotortrack_cli.stage_option import StageCommand


@click.command("convert", cls=StageCommand)
@click.argument("source", metavar="IN", type=FILE)
@click.argument("target", metavar="OUT", type=FILE)
@click.option(
    "--pixel-size-nm",
    type=click.FloatRange(min=0, min_open=True),
    help="Size of a pixel, where a format counts in pixels and IN does not say it.",
)
@output_flags
@click.pass_obj
def command(console: Console, source: Path, target: Path, pixel_size_nm: float | None) -> None:
    """Convert the localisations in IN to the format that the ending of OUT names.

    .parquet is rotortrack's own table, .csv has ThunderSTORM's columns, and .hdf5 with a .yaml
    beside it is Picasso's.
    """
    from rotortrack.exchange.tables import convert

    with console.stage("convert"):
        rows = convert(source, target, pixel_size_nm=pixel_size_nm)
    console.text(f"{rows} localisations written to {target}")
    console.json({"localisations": rows, "output": target})
