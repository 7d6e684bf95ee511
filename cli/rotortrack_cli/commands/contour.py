"""`rotortrack contour`: trace rods in an image of an atomic force microscope."""

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
    from rotortrack.afm.trace import Traced
    from rotortrack.pipeline.contour_run import Contours

_MOVIE = ("pixel_size_nm", "frames", "axes", "channel", "max_frame_megapixels")


@click.command("contour", cls=StageCommand)
@click.argument("image", metavar="IMAGE", type=FILE)
@output_option("RODS", "Table to write; a summary and a picture are written beside.")
@stage_options(*(f"movie.{name}" for name in _MOVIE), "contour")
@click.pass_obj
def command(console: Console, image: Path, output: Path, given: Given) -> None:
    """Trace rods in an AFM image: contour and end-to-end lengths, persistence length.

    IMAGE holds heights: .tif, .png, .npy, or a matrix as text (.txt, .asc, .csv, .dat). RODS is
    .csv or .parquet; beside it lie RODS-summary.json and RODS.png. With --contour-length-nm,
    lengths are calibrated by it.
    """
    start = time.perf_counter()
    layers = gather(given)
    from rotortrack.pipeline.contour_run import trace_image
    from rotortrack.report.draw import draw_contours

    def draw(path: Path, traced: Traced) -> None:
        draw_contours(path, traced)

    with Stages(console) as stages:
        found = trace_image(image, output, layers, draw=draw, progress=stages)
    seconds = time.perf_counter() - start
    _show(console, found, seconds)
    console.json({**found.summary, "output": output, "seconds": round(seconds, 3)})
    if given.strict and not found.summary["rods"]:
        raise NothingFoundError(f"no rod of {image} could be measured: {output} tells why")


def _show(console: Console, found: Contours, seconds: float) -> None:
    """Print one screen."""
    from rotortrack.afm.verdicts import Reason

    told = found.summary
    lines = [f"rods            {told['rods']} measured, {told['refused']} refused"]
    lines += [
        f"  {count:>4} {name:<15}{Reason(name).sentence}" for name, count in told["reasons"].items()
    ]
    if told["rods"]:
        lines += _lengths(told)
        lines += _stiffness(told)
    console.text("\n".join(lines))
    names = ", ".join(str(found.files[name]) for name in ("summary", "figure"))
    console.text(f"\n{seconds:.1f} s; rods in {found.files['rods']}, beside it {names}")


def _lengths(told: dict[str, Any]) -> list[str]:
    lines = [
        f"contour         {_spread(told, 'contour')}",
        f"end to end      {_spread(told, 'end_to_end')}",
        f"cross section   {told['height_nm']:.3g} nm high, {told['width_nm']:.3g} nm wide in the "
        f"image; noise {told['noise_nm']:.2g} nm",
    ]
    if told["scale"] is not None:
        sd = f" +- {told['scale_sd']:.2g}" if told["scale_sd"] is not None else ""
        lines.append(
            f"scale           {told['scale']:.4f}{sd}, applied: a pixel is "
            f"{told['pixel_size_nm']:.4g} nm"
        )
    return lines


def _spread(told: dict[str, Any], name: str) -> str:
    sd = told[f"{name}_sd_nm"]
    return f"{told[f'{name}_nm']:.1f} nm" + (f", sd {sd:.1f} nm" if sd is not None else "")


def _stiffness(told: dict[str, Any]) -> list[str]:
    if told["persistence_ci_low_nm"] is None:
        return ["persistence     not told: no rod is two segments long (segment_nm)"]
    if told["persistence_is_lower_limit"]:
        text = f"above {told['persistence_ci_low_nm']:.3g} nm (97.5 %)"
    else:
        text = (
            f"{told['persistence_nm']:.3g} nm, 95 %: {told['persistence_ci_low_nm']:.3g} to "
            f"{told['persistence_ci_high_nm']:.3g} nm"
        )
    others = [
        f"{told[key]:.3g} nm by {words}"
        for key, words in (
            ("persistence_by_tangents_nm", "the tangent correlation"),
            ("persistence_by_end_to_end_nm", "end-to-end distances"),
        )
        if told[key] is not None
    ]
    return [
        f"persistence     {text}, if equilibrated in the plane",
        *([f"                {', '.join(others)}"] if others else []),
    ]
