"""`rotortrack localise`: movie to localisations."""

from __future__ import annotations

import time
from pathlib import Path

import click

from rotortrack.errors import NothingFoundError
from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, output_option, stage_options
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages


@click.command("localise", cls=StageCommand)
@click.argument("movies", metavar="MOVIE...", type=FILE, nargs=-1, required=True)
@output_option("LOCS", "Table to write: .parquet, .csv (ThunderSTORM) or .hdf5 (Picasso).")
@stage_options("movie", "camera", "localise")
@click.pass_obj
def command(console: Console, movies: tuple[Path, ...], output: Path, given: Given) -> None:
    """Find and fit the spots of every frame of MOVIE; several files are one recording."""
    start = time.perf_counter()
    layers = gather(given)
    from rotortrack.pipeline.localise_run import localise_to_file, opened

    with opened(movies, layers, "movie.pixel_size_nm") as source, Stages(console) as stages:
        counts = localise_to_file(source, output, workers=given.workers, progress=stages)
        frames, notes = source.movie.shape[0], source.movie.notes
    seconds = time.perf_counter() - start
    console.text(
        f"{counts.localisations} localisations of {counts.candidates} candidates in {frames} "
        f"frames written to {output}"
    )
    for note in notes:
        console.text(note)
    for flag, count in counts.flags.items():
        if count:
            console.text(f"{count} {str(flag.name).lower()}: {flag.sentence}")
    if counts.masked_pixels:
        console.text(f"{counts.masked_pixels} pixels without a number were left out")
    console.json(
        {
            "localisations": counts.localisations,
            "frames": frames,
            "seconds": round(seconds, 3),
            "localisations_per_s": round(counts.localisations / seconds, 1),
        }
    )
    if given.strict and counts.localisations == 0:
        raise NothingFoundError(f"{movies[0]} has no spot above the threshold: lower --threshold")
