"""`rotortrack info`: what is in a file or a run folder, and what was understood of it."""

from __future__ import annotations

from pathlib import Path

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, stage_options
from rotortrack_cli.stage_option import StageCommand

_TABLES = (".parquet", ".csv", ".csv.gz", ".hdf5", ".h5")
_MAPS = ".npz"


@click.command("info", cls=StageCommand)
@click.argument(
    "paths", metavar="MOVIE...|LOCS|MAPS|CONFIG|RUN", type=FILE, nargs=-1, required=True
)
@stage_options("movie", "camera")
@click.pass_obj
def command(console: Console, paths: tuple[Path, ...], given: Given) -> None:
    """Show what is in a movie, a table of localisations, camera maps, a configuration or a run.

    Of a movie (several files are one recording, in their order): frames, metadata with the origin
    of each value, recorded times, the gain that its variance-against-mean slope shows (held against
    --gain-e-per-adu where that is given), noise that columns or rows share, saturated and dead
    pixels, and frames without a picture. Of a ThunderSTORM protocol: what was not taken over, too.
    """
    from rotortrack.pipeline.describe_configuration import is_configuration

    layers = gather(given)
    others = [
        path
        for path in paths
        if path.is_dir() or _ends(path, (*_TABLES, _MAPS)) or is_configuration(path)
    ]
    if others and len(paths) > 1:
        raise click.UsageError(
            f"{others[0]} is no movie: give a table, camera maps, a configuration or a run folder "
            "alone",
            click.get_current_context(),
        )
    path = paths[0]
    if path.is_dir():
        from rotortrack_cli.run_state import show_run

        show_run(console, path)
    elif _ends(path, _TABLES):
        from rotortrack.pipeline.describe_table import describe_table
        from rotortrack.pipeline.presets import SECTIONS
        from rotortrack.settings import resolve
        from rotortrack_cli.description import show_table

        pixel_size_nm = resolve(SECTIONS, layers)["movie"].pixel_size_nm
        show_table(console, describe_table(path, pixel_size_nm=pixel_size_nm))
    elif _ends(path, (_MAPS,)):
        from rotortrack.pipeline.describe_table import describe_maps
        from rotortrack_cli.description import show_maps

        show_maps(console, describe_maps(path))
    elif others:
        from rotortrack.pipeline.describe_configuration import describe_configuration
        from rotortrack_cli.description import show_configuration

        show_configuration(console, describe_configuration(path))
    else:
        from rotortrack.pipeline.describe_movie import describe_movie
        from rotortrack_cli.description import show_movie
        from rotortrack_cli.stages import Stages

        with Stages(console) as stages:
            report = describe_movie(paths, layers, progress=stages)
        show_movie(console, report)


def _ends(path: Path, endings: tuple[str, ...]) -> bool:
    return path.name.lower().endswith(endings)
