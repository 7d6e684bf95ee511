"""`rotortrack simulate`: rotors whose motion is known, from the field of a pore to a movie."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rotortrack.errors import UsageError
from rotortrack.simulate.scene import Scene
from rotortrack_cli.commands import simulate_film
from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, output_flags, output_option
from rotortrack_cli.scene_flags import scene_flags
from rotortrack_cli.stage_option import StageCommand
from rotortrack_cli.stages import Stages

if TYPE_CHECKING:
    from rotortrack.simulate.field.table import FieldTable
    from rotortrack.simulate.rod.run import RodRun
    from rotortrack.simulate.scene_field import SceneField

_Function = TypeVar("_Function", bound=Callable[..., Any])


@click.group("simulate")
def command() -> None:
    """Simulate the field of a pore, rods in it, and movies of rotors."""


for _made in (simulate_film.film, simulate_film.check, simulate_film.sample):
    command.add_command(_made)


def _field_flags(function: _Function) -> _Function:
    """Add the choice of the field: `solve` and `table`."""
    plain = click.option("--no-figures", is_flag=True, help="Write numbers alone.")
    solve = click.option(
        "--solve/--no-solve",
        default=None,
        help="Solve the field in any case, or never. [default: where the built-in table is not "
        "that of the scene]",
    )
    table = click.option(
        "--field",
        "table",
        type=FILE,
        metavar="FIELD.npz",
        help="Take the field that `rotortrack simulate field` wrote.",
    )
    return solve(table(plain(function)))


@command.command("field", cls=StageCommand)
@scene_flags()
@output_option("FIELD.npz", "Where the field is written.")
@_field_flags
@output_flags
@click.pass_obj
def field(
    console: Console,
    scene: Scene,
    output: Path,
    solve: bool | None,
    table: Path | None,
    no_figures: bool,
) -> None:
    """Solve potential, concentrations and flow around a pore: the section [field] of a scene."""
    _check_ending(output)
    scene.require("field")
    found = _field(console, scene, solve, table)
    assert found is not None
    found.table.save(output)
    made = found.table
    if not no_figures:
        from rotortrack.report.figures import canvas, nanopore

        canvas.save_as(nanopore.figure(made), output.with_suffix(".png"))
    console.text(f"field of {found.origin}, in {output}")
    console.text(
        f"current {made.current_a:.4g} A (error {made.current_error_rel:.1g}), flow "
        f"{made.flow_m3_s:.4g} m3/s (error {made.flow_error_rel:.1g}) at {made.voltage_v:g} V"
    )
    console.json({**_told(found), "unknowns": found.unknowns, "seconds": found.seconds})


@command.command("rod", cls=StageCommand)
@scene_flags()
@output_option("ROD.npz", "Where shapes and angle over time are written.")
@_field_flags
@click.option(
    "--animate",
    "animation",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.gif|FILE.mp4",
    help="Write the rod's motion as an animation, too.",
)
@click.option(
    "--equilibrium",
    is_flag=True,
    help="Tell the steadily rotating shape's own rate, by Newton's method, and if it is stable.",
)
@click.option(
    "--budget", is_flag=True, help="Tell the error of a steady rate by field, vertices and steps."
)
@output_flags
@click.pass_obj
def rod(
    console: Console,
    scene: Scene,
    output: Path,
    solve: bool | None,
    table: Path | None,
    no_figures: bool,
    animation: Path | None,
    equilibrium: bool,
    budget: bool,
) -> None:
    """Simulate one rod: [rod] of a scene, in its [field] and with [thermal] noise, if any."""
    _check_ending(output)
    if animation is not None:
        from rotortrack.report.rod_animation import check_ending

        check_ending(animation)
    scene.require("rod")
    found = _field(console, scene, solve, table)
    from rotortrack.simulate.single import simulate_rod

    assert scene.rod is not None
    field = None if found is None else found.table
    with console.stage("rod"):
        simulated = simulate_rod(scene.rod, scene.start, scene.stepping, field, scene.thermal)
    run, seen = simulated.run, dataclasses.asdict(simulated.seen)
    run.save(output)
    if not no_figures:
        from rotortrack.report.figures import canvas, rod_run

        picture = rod_run.figure(run, simulated.seen, field)
        canvas.save_as(picture, output.with_suffix(".png"))
    if animation is not None:
        from rotortrack.report.rod_animation import animate

        animate(run, animation, field)
    console.text(run.end.sentence)
    depth = run.numbers.deepest_nm
    if depth > 0.0:
        console.text(
            f"Its axis went {depth:.1f} nm into the membrane, whose rim gives way: a larger "
            "wall_stiffness_pn_nm may end otherwise."
        )
    console.table(("", ""), [[name, value] for name, value in seen.items()])
    errors = steady = None
    if equilibrium and field is not None:
        steady = _equilibrium(console, run, field)
    if budget and field is not None:
        errors = _errors(console, run, field, scene)
    origin = "none" if found is None else found.origin
    console.text(f"in {output}; field: {origin}")
    console.json(
        {
            "end": run.end.value,
            **seen,
            "simulated_us": run.simulated_us,
            "n_steps": run.n_steps,
            "seconds": run.seconds,
            "field": origin,
            "deepest_nm": depth,
            "equilibrium": steady,
            "rate_error_rel": errors,
        }
    )


@command.command("scan", cls=StageCommand)
@scene_flags()
@output_option("FOLDER", "Where runs.parquet, shapes.npz and scan.json are written.")
@_field_flags
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processors to use. The result does not depend on it. [default: all]",
)
@click.option("--overwrite", is_flag=True, help="Replace the results of another scan.")
@output_flags
@click.pass_obj
def scan(
    console: Console,
    scene: Scene,
    output: Path,
    solve: bool | None,
    table: Path | None,
    no_figures: bool,
    workers: int | None,
    overwrite: bool,
) -> None:
    """Simulate the rods of [scan]: every start, charge and flow. Goes on where it was stopped."""
    scene.require("rod", "scan")
    found = _field(console, scene, solve, table)
    from rotortrack.pipeline.scan_run import run_scan
    from rotortrack.simulate.scan import phase_diagram

    begun = time.perf_counter()
    with Stages(console, "runs") as stages:
        done = run_scan(scene, found, output, workers=workers, overwrite=overwrite, progress=stages)
    if not no_figures:
        from rotortrack.report.figures import canvas, rod_scan

        picture = rod_scan.figure(done.runs, done.time_us, done.turned_rad)
        canvas.save_as(picture, output / "scan.png")
    console.table(*phase_diagram(done.runs))
    ends = {end: count for end, count in done.facts["ends"].items() if count}
    console.text(f"\n{len(done.runs)} runs in {output}: " + _counted(ends))
    console.text(
        "N not docked, D docked and still, R rotating, T translocated, u undecided, "
        "m in the membrane"
    )
    problems = [sentence for sentence in done.runs["problem"] if sentence]
    if problems:
        console.text(f"x could not be simulated, {len(problems)} runs; the first: {problems[0]}")
    seconds = time.perf_counter() - begun
    console.json(
        {
            "runs": len(done.runs),
            "ends": done.facts["ends"],
            "seconds": seconds,
            "field": "none" if found is None else found.origin,
            "output": output,
        }
    )


def _field(
    console: Console, scene: Scene, solve: bool | None, table: Path | None
) -> SceneField | None:
    """Give the field of the scene, None where it names none."""
    if scene.field is None:
        if table is not None or solve:
            raise UsageError(f"{scene.origin} has no [field] section: add one to use a field")
        return None
    from rotortrack.simulate.scene_field import field_for

    with console.stage("field"):
        return field_for(scene.field, solve=solve, file=table)


def _equilibrium(console: Console, run: RodRun, field: FieldTable) -> dict[str, Any]:
    """Tell the steadily rotating shape near the end of a run."""
    from rotortrack.simulate.rod.relative_equilibrium import find_equilibrium

    with console.stage("equilibrium"):
        found = find_equilibrium(run.rod, field, run.positions_nm[-1])
    slowest = float(found.rates_per_us.real.max())
    console.text(
        f"steadily rotating shape: {found.rate_rev_s:.6g} rev/s, "
        + (f"stable, back in {-1 / slowest:.3g} us" if found.is_stable else "not stable")
    )
    return {
        "rate_rev_s": found.rate_rev_s,
        "is_stable": found.is_stable,
        "growth_per_us": slowest,
        "newton_steps": found.iterations,
    }


def _errors(
    console: Console, run: RodRun, field: FieldTable, scene: Scene
) -> dict[str, float] | None:
    """Tell the error budget of a steady rate, None where there is none."""
    if run.end.value != "rotating_steadily" or scene.thermal is not None:
        console.text("no error budget: it belongs to a steady rate without noise")
        return None
    from rotortrack.simulate.rod.budget import rate_budget

    with console.stage("budget"):
        made = rate_budget(run, field)
    console.text(
        f"error of the rate: {made.total:.1%} (field {made.field:.1%}, vertices "
        f"{made.vertices:.1%}, steps {made.stepping:.2g})"
    )
    return {**dataclasses.asdict(made), "total": made.total}


def _told(found: SceneField) -> dict[str, Any]:
    table = found.table
    return {
        "current_a": table.current_a,
        "flow_m3_s": table.flow_m3_s,
        "current_error_rel": table.current_error_rel,
        "flow_error_rel": table.flow_error_rel,
        "voltage_v": table.voltage_v,
        "field": found.origin,
    }


def _counted(ends: dict[str, int]) -> str:
    return ", ".join(f"{count} {end.replace('_', ' ')}" for end, count in ends.items())


def _check_ending(output: Path) -> None:
    if output.suffix.lower() != ".npz":
        raise UsageError(f"{output} does not end in .npz: name the result so with -o")
