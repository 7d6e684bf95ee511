"""`rotortrack compare`: measured rotors against measured ones and against simulated rods."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, stage_options
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages

if TYPE_CHECKING:
    from rotortrack.pipeline.compare_run import Compared

_WORDS = {
    ("distance", "frames"): "distance of every frame",
    ("distance", "rotors"): "the same, rotors weighted alike",
    ("mean_distance", "rotors"): "mean distance of a rotor",
    ("true_distance", "rotors"): "the same freed of noise",
    ("speed", "rotors"): "|speed| of a rotor",
    ("ccw_share", "rotors"): "share counter-clockwise",
}


@click.command("compare", cls=StageCommand)
@click.argument("paths", metavar="RUN [RUN|SCAN]...", type=FILE, nargs=-1, required=True)
@click.option(
    "--output",
    "-o",
    type=FILE,
    metavar="FOLDER",
    help="Where the comparison is written. [default: RUN/comparison]",
)
@stage_options("movie.mirrored", "compare")
@click.pass_obj
def command(console: Console, paths: tuple[Path, ...], output: Path | None, given: Given) -> None:
    """Compare end-to-end distances, speeds and handedness of runs with other runs and with scans.

    Distances of a scan's rods get the noise, registration error, blur and screening of the measured
    rotors. Effect sizes have 95 % intervals from drawing whole rotors; p-values, from permuting
    them, are between runs, or against a scan with --prior. FOLDER gets comparison.csv,
    comparison.json, distances.png and speeds.png.
    """
    start = time.perf_counter()
    layers = gather(given)
    from rotortrack.pipeline.compare_run import compare_folders
    from rotortrack.report.draw import draw_distances, draw_speeds

    pictures = {"distances.png": draw_distances, "speeds.png": draw_speeds}
    with Stages(console, "folders") as stages:
        found = compare_folders(paths, output, layers, pictures=pictures, progress=stages)
    seconds = time.perf_counter() - start
    _show(console, found, seconds)
    told = {key: value for key, value in found.facts.items() if key != "provenance"}
    console.json({**told, "output": found.files[0].parent, "seconds": round(seconds, 3)})


def _show(console: Console, found: Compared, seconds: float) -> None:
    """Print one screen."""
    told = found.facts
    for group in told["groups"]:
        console.text(_group(group))
    for scan in told["scans"]:
        console.text(
            f"{scan['name']}: {scan['rods']} rotating rods, {scan['shapes']} shapes in "
            f"{scan['cells']} cells"
        )
    rhos = {(pair["group"], pair["scan"]): pair["rho"] for pair in told["against"]}
    pairs: dict[tuple[str, str], list[list[object]]] = {}
    for row in told["comparisons"]:
        pairs.setdefault((row["first"], row["second"]), []).append(_row(row))
    for pair, rows in pairs.items():
        console.text(f"\n{pair[0]} against {pair[1]}")
        console.table(["of", "means", "W1 (95 %)", "KS", "p"], rows)
        if rhos.get(pair) is not None:
            console.text(f"simulated speed and distance: weighted rho {rhos[pair]:.2f}")
    console.text("")
    for sentence in dict.fromkeys([*told["notes"], *_reasons(told["comparisons"])]):
        console.text(f"note: {sentence}")
    names = ", ".join(path.name for path in found.files)
    console.text(f"\n{seconds:.1f} s; {names} in {found.files[0].parent}")


def _group(group: dict[str, Any]) -> str:
    line = f"{group['name']}: {group['rotors']} rotors, {group['frames']} frames with both ends"
    if group["left_out"]:
        line += f"; {group['left_out']} rotors with fewer frames left out"
    found = group["correlation"]
    rho, slope = found["rho"], found["slope"]
    if rho["value"] is not None:
        line += (
            f"\n  |speed| and distance: rho {_with_ends(rho)}, p {found['p']:.2g}, "
            f"n {found['n']} (tells |rho| > {_number(found['detectable'])} from 0)"
        )
    if slope["value"] is not None:
        kind = "power" if found["axes"] == "log" else "slope, deg/s per nm,"
        line += (
            f"\n  {kind} of |speed| in distance, errors in both: {_with_ends(slope)}, "
            f"n {found['slope_n']}"
        )
    return line


def _row(row: dict[str, Any]) -> list[object]:
    means = f"{_number(row['first_mean'])}, {_number(row['second_mean'])}"
    apart = {"value": row["wasserstein"]}
    apart |= {end: row[f"wasserstein_ci_{end}"] for end in ("low", "high")}
    return [
        _WORDS[row["quantity"], row["weight"]],
        f"{means} {row['unit']}".strip(),
        "-" if apart["value"] is None else _with_ends(apart),
        math.nan if row["ks"] is None else row["ks"],
        math.nan if row["p"] is None else row["p"],
    ]


def _reasons(rows: list[dict[str, Any]]) -> list[str]:
    """Say once why rows have no p."""
    return [f"no p-value: {row['p_reason']}" for row in rows if row["p"] is None]


def _with_ends(interval: dict[str, Any]) -> str:
    ends = f"{_number(interval['low'])} to {_number(interval['high'])}"
    return f"{_number(interval['value'])} ({ends})"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
