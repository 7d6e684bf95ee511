"""`rotortrack register`: the map of one colour onto the other, from films of beads."""

from __future__ import annotations

import time
from pathlib import Path

import click

from rotortrack.errors import UsageError
from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, output_option, stage_options
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages


@click.command("register", cls=StageCommand)
@click.argument("beads", metavar="BEADS...", type=FILE, nargs=-1, required=True)
@click.option(
    "--second",
    "seconds",
    type=FILE,
    multiple=True,
    metavar="MOVIE",
    help="The second colour's own film; once for each of BEADS.",
)
@click.option(
    "--apply",
    "table",
    type=FILE,
    metavar="TABLE",
    help="Map a table of the second colour onto the first; BEADS is then CHANNELS.json.",
)
@output_option("CHANNELS.json", "Where the map is written; its pictures lie beside.")
@stage_options(
    *("movie.pixel_size_nm", "movie.frames", "movie.axes", "movie.channel", "movie.region"),
    *("channels.split", "channels.swapped", "channels.first_region", "channels.second_region"),
    *("channels.second_channel", "channels.second_sigma_px"),
    *("register", "localise"),
)
@click.pass_obj
def command(
    console: Console,
    beads: tuple[Path, ...],
    seconds: tuple[Path, ...],
    table: Path | None,
    output: Path,
    given: Given,
) -> None:
    """Find how the second colour lies on the first, from films of beads that shine in both.

    Give one film, or one for each position of the stage: all are pooled. Use the result with
    `rotortrack run --channels CHANNELS.json`.
    """
    start = time.perf_counter()
    layers = gather(given)
    if table is not None:
        _apply(console, beads, table, output)
        return
    if output.suffix.lower() != ".json":
        raise UsageError(f"{output} does not end in .json: name the registration so with -o")
    from rotortrack.pipeline.register_run import register_movies

    with Stages(console) as stages:
        made = register_movies(beads, seconds, layers, workers=given.workers, progress=stages)
        stages("figures", 0, 0)
        from rotortrack.report.figures import canvas, registration

        found = made.registration
        found.write(output)
        pictures = [output.with_suffix(".overlay.png"), output.with_suffix(".residuals.png")]
        canvas.save_as(registration.overlay(found, made.images), pictures[0])
        canvas.save_as(registration.residuals(found), pictures[1])
    console.text(f"{found.n_beads} beads, {found.n_outliers} left out: {found.model}")
    console.text(
        f"target registration error {found.target_error_nm:.2f} nm rms per axis, of which "
        f"{found.systematic_nm:.2f} nm systematic; noise of a bead {found.bead_noise_nm:.2f} nm"
    )
    console.text(f"in {output}; pictures {pictures[0].name} and {pictures[1].name} beside")
    console.json(
        {
            "target_error_nm": found.target_error_nm,
            "bead_noise_nm": found.bead_noise_nm,
            "systematic_nm": found.systematic_nm,
            "beads": found.n_beads,
            "outliers": found.n_outliers,
            "model": found.model,
            "output": output,
            "seconds": time.perf_counter() - start,
        }
    )


def _apply(console: Console, beads: tuple[Path, ...], table: Path, output: Path) -> None:
    if len(beads) != 1:
        raise UsageError("--apply TABLE needs one CHANNELS.json in place of films of beads")
    from rotortrack.pipeline.register_run import apply_registration

    rows = apply_registration(beads[0], table, output)
    console.text(f"{rows} localisations on the first colour in {output}")
    console.json({"localisations": rows, "output": output})
