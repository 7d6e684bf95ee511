"""`rotortrack simulate`: movies of rotors whose motion is known."""

from __future__ import annotations

from pathlib import Path

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import output_flags, output_option
from rotortrack_cli.stage_option import StageCommand


@click.group("simulate")
def command() -> None:
    """Make movies of rotors whose motion is known."""


@command.command("sample", cls=StageCommand)
@output_option("FOLDER", "Where movie.tif, config.toml and truth/ are written.")
@output_flags
@click.pass_obj
def sample(console: Console, output: Path) -> None:
    """Make the sample movie of eight rotors, with its configuration and truth."""
    from rotortrack.simulate.sample import make_sample

    with console.stage("simulate"):
        make_sample(output)
    console.text(f"sample written to {output}: try `rotortrack run {output / 'movie.tif'}`")
    console.json({"output": output})
