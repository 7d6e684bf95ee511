"""`rotortrack info`: what is in a movie or a run folder, and what was understood of it."""

from __future__ import annotations

from pathlib import Path

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, stage_options
from rotortrack_cli.stage_option import StageCommand


@click.command("info", cls=StageCommand)
@click.argument("path", metavar="MOVIE|RUN", type=FILE)
@stage_options("movie", "camera")
@click.pass_obj
def command(console: Console, path: Path, given: Given) -> None:
    """Show what is in a movie or a run folder.

    Of a movie: its frames, its metadata with the origin of each value, and the gain that its
    variance-against-mean slope shows, held against --gain-e-per-adu where that is given.
    """
    layers = gather(given)
    if path.is_dir():
        _show_run(console, path)
        return
    from rotortrack.cameras.photon_transfer import gain_from_movie, warn_if_contradicted
    from rotortrack.movies.select import select
    from rotortrack.movies.tiff import open_movie
    from rotortrack.pipeline.localise_run import settings_for_movie

    with open_movie(path) as whole:
        settings = settings_for_movie(whole, layers)
        movie = select(whole, settings["movie"].region, settings["movie"].frames)
        frames, height, width = movie.shape
        console.text(f"{path}: {frames} frames of {width} x {height} pixels, {movie.dtype}")
        known = {
            key: {"value": getattr(settings["movie"], key), "origin": origin}
            for key in ("pixel_size_nm", "frame_interval_s", "exposure_s")
            if (origin := settings.origins[f"movie.{key}"]) != "default"
        }
        others = {
            key: {"value": value.value, "origin": value.origin}
            for key, value in movie.metadata.items()
            if key not in known
        }
        rows = [[key, e["value"], e["origin"]] for key, e in {**known, **others}.items()]
        rows += [
            [key, None, f"unknown: give --{key.replace('_', '-')}"]
            for key in ("pixel_size_nm", "frame_interval_s", "exposure_s")
            if key not in known
        ]
        console.table(["", "value", "origin"], rows)
        with console.stage("gain"):
            saturation = settings["camera"].saturation_adu
            estimate = gain_from_movie(movie, saturation_adu=saturation)
        given_gain = settings["camera"].gain_e_per_adu
        if given_gain is not None:
            warn_if_contradicted(estimate, given_gain)
    console.text(
        f"gain from variance against mean: {estimate.gain_e_per_adu:.3g} +- "
        f"{estimate.sd:.2g} electrons per count"
        if estimate.reason is None
        else f"gain from variance against mean: unknown, {estimate.reason}"
    )
    console.json(
        {
            "frames": frames,
            "height_px": height,
            "width_px": width,
            "dtype": str(movie.dtype),
            "metadata": {**known, **others},
            "gain_e_per_adu": estimate.gain_e_per_adu,
            "gain_sd_e_per_adu": estimate.sd,
        }
    )


def _show_run(console: Console, path: Path) -> None:
    from rotortrack.pipeline.store import RunFolder

    folder = RunFolder.open(path)
    manifest = folder.read_manifest()
    for key in ("command", "inputs", "counts", "seconds", "notes", "warnings"):
        console.text(f"{key}: {manifest.get(key)}")
    rows = [
        [section, key, str(entry["value"]), entry["origin"]]
        for section, entries in manifest.get("options", {}).items()
        for key, entry in entries.items()
    ]
    console.table(["section", "option", "value", "origin"], rows)
    console.json(manifest)
