"""`rotortrack simulate check`: film a scene, analyse the film, compare with the truth."""

from __future__ import annotations

import json
import time
from pathlib import Path

import click

from rotortrack.simulate.scene import Scene
from rotortrack_cli.console import Console
from rotortrack_cli.stages import Stages


def check(
    console: Console,
    scene: Scene,
    output: Path,
    *,
    films: int,
    presets: tuple[str, ...],
    workers: int | None,
    figures: bool,
) -> None:
    """Show how far the analysis of a scene's films agrees with their truth."""
    scene.require("film")
    from rotortrack.files import write_text
    from rotortrack.tradeoff.closed_loop import PRESETS, check_scene

    begun = time.perf_counter()
    with Stages(console) as stages:
        loop = check_scene(
            scene,
            output,
            films=films,
            presets=presets or PRESETS,
            workers=workers,
            progress=stages,
        )
    told = {**loop.as_dict(), "seconds": time.perf_counter() - begun}
    write_text(output / "check.json", json.dumps(told, indent=1) + "\n")
    for one in loop.analyses:
        one.rotors.to_csv(output / f"rotors-{one.preset}.csv", index=False, lineterminator="\n")
    if figures:
        from rotortrack.report.figures import canvas, closed_loop

        tables = {one.preset: one.rotors for one in loop.analyses}
        confusions = {one: told["verdicts"][one] for one in tables}
        behaviours = {one: told["behaviours"][one] for one in tables}
        canvas.save_as(closed_loop.figure(tables, confusions, behaviours), output / "check.png")
    headings, rows = loop.table()
    console.table(headings, rows)
    best = "* the best one; " if len(loop.analyses) > 1 else ""
    console.text(f"{best}in brackets the 95 % interval")
    first = loop.analyses[0]
    for name, found in told["verdicts"][first.preset].items():
        console.text(f"{name}: " + ", ".join(f"{n} {word}" for word, n in found.items()))
    made = "films with their truth, runs, check.json, rotors-*.csv" + ", check.png" * figures
    console.text(f"in {output}: {made}")
    console.json(told)


def check_twin(
    console: Console, run: Path, output: Path, *, films: int, workers: int | None
) -> None:
    """Show what the analysis makes of films like those of a finished run."""
    from rotortrack.pipeline.store import BUDGET
    from rotortrack.tradeoff.summary import AIMS
    from rotortrack.tradeoff.twin import error_budget

    with Stages(console) as stages:
        told = error_budget(run, output, films=films, workers=workers, progress=stages)
    columns = ("rotor", "kept", "omega_bias", "omega_rms_error", "speed_reported_sd_rad_s")
    console.table(
        ("rotor", "kept", "bias rad/s", "rms error", "reported sd"),
        [
            ["" if row[name] is None else f"{row[name]:.4g}" for name in columns]
            for row in told["rotors"]
        ],
    )
    for name, measure in told["all"].items():
        if measure["value"] is not None:
            console.text(f"{AIMS[name][0]}: {measure['value']:.4g}")
    for number, why in told["left_out"].items():
        console.text(f"rotor {number} is not in the twin: {why}")
    console.text(f"in {run / BUDGET}; films and their analyses in {output}")
    console.json(told)


FILMS = click.option(
    "--films",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="How many films, each with the next seed.",
)
ANALYSES = click.option(
    "--analysis",
    "presets",
    multiple=True,
    metavar="NAME",
    help="Analysis to compare: default, or the name of a preset; may be repeated. "
    "[default: default and paper]",
)
