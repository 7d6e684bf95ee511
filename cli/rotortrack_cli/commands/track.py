"""`rotortrack track`: mobile particles to tracks and diffusion coefficients."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rotortrack.errors import NothingFoundError
from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, output_option, stage_options
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages

if TYPE_CHECKING:
    from rotortrack.motion.particles import Particles
    from rotortrack.pipeline.track_run import Tracked


@click.command("track", cls=StageCommand)
@click.argument("locs", metavar="LOCS", type=FILE)
@output_option("TRACKS", "Table to write; particles, their MSD and a figure are written beside.")
@stage_options("movie.pixel_size_nm", "movie.frame_interval_s", "movie.exposure_s", "link")
@click.pass_obj
def command(console: Console, locs: Path, output: Path, given: Given) -> None:
    """Follow mobile particles (free rods, vesicles, beads) and measure how they diffuse.

    LOCS may come from any program (.parquet, ThunderSTORM .csv, Picasso .hdf5). TRACKS is .parquet
    or .csv; beside it lie TRACKS-particles.csv, TRACKS-msd.csv and TRACKS.png.
    """
    start = time.perf_counter()
    layers = gather(given)
    from rotortrack.pipeline.track_run import track_table
    from rotortrack.report.draw import draw_particles

    def draw(path: Path, found: Particles, frame_interval_s: float) -> None:
        draw_particles(
            path,
            found.tracks,
            found.particles,
            found.ensemble,
            frame_interval_s=frame_interval_s,
        )

    with Stages(console) as stages:
        tracked = track_table(locs, output, layers, draw=draw, progress=stages)
    seconds = time.perf_counter() - start
    _show(console, tracked, seconds)
    console.json(_result(tracked, seconds))
    if given.strict and not len(tracked.found.particles):
        raise NothingFoundError(f"no particle of {locs} was seen in enough frames (min_frames)")


def _show(console: Console, tracked: Tracked, seconds: float) -> None:
    """Print one screen: how spots were linked, and what all particles tell together."""
    found, whole = tracked.found, tracked.found.ensemble
    lines = [f"spots           {tracked.localisations}, {len(found.tracks)} of them in tracks"]
    if found.unplaced:
        lines.append(f"  left out      {found.unplaced} without a position")
    chosen = found.chosen
    if chosen is None:
        lines.append(f"search range    {found.search_range_nm:g} nm, given")
    else:
        lines.append(
            f"search range    {chosen.range_nm:g} nm, chosen: steps of {chosen.step_sd_nm:.3g} nm "
            f"per axis, {chosen.spots_per_um2:.2g} other spots per um2, {chosen.false_share:.1%} "
            "of steps confused at most"
        )
    lines.append(f"particles       {whole.n_particles}, {found.short} more seen too briefly")
    if whole.n_particles:
        lines += _ensemble_lines(tracked)
    console.text("\n".join(lines))
    names = ", ".join(str(tracked.files[name]) for name in ("particles", "msd", "figure"))
    console.text(f"\n{seconds:.1f} s; tracks in {tracked.files['tracks']}, beside it {names}")


def _ensemble_lines(tracked: Tracked) -> list[str]:
    whole, particles = tracked.found.ensemble, tracked.found.particles
    quartiles = particles["diffusion_um2_s"].quantile([0.25, 0.5, 0.75])
    directed = int((particles["directed_q"] < 0.05).sum())
    speed = (whole.flow_nm_s[0] ** 2 + whole.flow_nm_s[1] ** 2) ** 0.5
    lines = [
        f"mean D          {whole.diffusion_nm2_s / 1e6:.4g} +- "
        f"{whole.diffusion_sd_nm2_s / 1e6:.2g} um2/s",
        "D of each       median {:.4g}, half of them {:.4g} to {:.4g} um2/s".format(
            *quartiles.loc[[0.5, 0.25, 0.75]]
        ),
        f"localisation    {whole.localisation_sd_nm:.3g} nm per axis, by the steps themselves",
    ]
    if whole.alpha == whole.alpha:
        lines.append(
            f"MSD exponent    {whole.alpha:.3f} +- {whole.alpha_sd:.3f} (1: free diffusion)"
        )
    lines.append(f"directed        {directed} of them by more than chance (5 % false ones)")
    if any(abs(v) > 3.0 * sd for v, sd in zip(whole.flow_nm_s, whole.flow_sd_nm_s, strict=True)):
        lines.append(
            f"common flow     {speed:.3g} nm/s: stage drift (`rotortrack drift`) or a real flow; "
            "D does not contain it"
        )
    return lines


def _result(tracked: Tracked, seconds: float) -> dict[str, Any]:
    """Give the numbers that others build on."""
    found, whole = tracked.found, tracked.found.ensemble
    return {
        "localisations": tracked.localisations,
        "linked_localisations": len(found.tracks),
        "particles": whole.n_particles,
        "short_particles": found.short,
        "search_range_nm": found.search_range_nm,
        "search_range_chosen": found.chosen is not None,
        "diffusion_um2_s": whole.diffusion_nm2_s / 1e6,
        "diffusion_sd_um2_s": whole.diffusion_sd_nm2_s / 1e6,
        "median_diffusion_um2_s": found.particles["diffusion_um2_s"].median(),
        "localisation_sd_nm": whole.localisation_sd_nm,
        "alpha": whole.alpha,
        "alpha_sd": whole.alpha_sd,
        "flow_x_nm_s": whole.flow_nm_s[0],
        "flow_y_nm_s": whole.flow_nm_s[1],
        "directed": int((found.particles["directed_q"] < 0.05).sum()),
        "output": tracked.files["tracks"],
        "seconds": round(seconds, 3),
    }
