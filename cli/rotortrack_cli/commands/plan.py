"""`rotortrack plan`: what a movie will tell, before it is filmed or of one that was."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, stage_options
from rotortrack_cli.stage_option import StageCommand

if TYPE_CHECKING:
    from rotortrack.motion.plan_movie import MoviePlan
    from rotortrack.pipeline.plan_run import RunPlan

_SHOWN = 40


@click.command("plan", cls=StageCommand)
@click.argument("run", metavar="[RUN]", type=FILE, required=False)
@click.option(
    "--output",
    "-o",
    type=FILE,
    metavar="FIGURE",
    help="Figure to write (.png, .svg or .pdf): speeds that movies of any length resolve.",
)
@stage_options(
    "plan",
    *("movie.frame_interval_s", "movie.exposure_s", "movie.pixel_size_nm"),
    *("camera.read_noise_e", "motion.driven_z"),
)
@click.pass_obj
def command(console: Console, run: Path | None, output: Path | None, given: Given) -> None:
    """Tell which speed a movie resolves, and which photons, frames and exposure a speed needs.

    By the Fisher bound of speed and diffusion, which the analysis reaches. With RUN, a run folder:
    what its movie resolves, rotor by rotor; --duration-s then asks for a movie of another length.
    """
    layers = gather(given)
    if output is not None:
        _format_of(output)
    if run is None:
        from rotortrack.pipeline.plan_run import plan_from_options

        _movie(console, plan_from_options(layers), output)
    else:
        from rotortrack.pipeline.plan_run import plan_of_run

        _run(console, plan_of_run(run, layers), output)
    if output is not None:
        console.text(f"\nfigure in {output}")


def _movie(console: Console, plan: MoviePlan, output: Path | None) -> None:
    """Show one plan."""
    from rotortrack.motion.plan_movie import advice

    sentence = advice(plan)
    console.text("\n".join(_lines(plan)))
    console.text(f"\n{sentence}")
    console.json({**_result(plan), "advice": sentence, "output": output})
    if output is not None:
        from rotortrack.files import atomic_path
        from rotortrack.report.draw import draw_plan

        with atomic_path(output) as temporary:
            draw_plan(temporary, plan, _format_of(output))


def _run(console: Console, plan: RunPlan, output: Path | None) -> None:
    """Show what the rotors of a run resolve."""
    rows = plan.rotors
    z = f"{plan.driven_z:g}"
    header = ["rotor", "s", "seen", "R nm", "D rad2/s", "noise deg", "+- deg/s"]
    header += ["least 5 %", f"least {z} sd", "deg/s", "behaviour"]
    console.table(
        header,
        [
            [
                row["rotor"],
                row["duration_s"],
                row["detection"],
                row["radius_nm"],
                row["diffusion_rad2_s"],
                row["noise_deg"],
                row["expected_sd_deg_s"],
                row["smallest_5_deg_s"],
                row["smallest_deg_s"],
                row["speed_deg_s"],
                row["behaviour"],
            ]
            for row in rows.head(_SHOWN).to_dict("records")
        ],
    )
    if len(rows) > _SHOWN:
        console.text(f"... and {len(rows) - _SHOWN} more (--json lists all)")
    if plan.unmeasured:
        console.text(f"{plan.unmeasured} rotor(s) without a diffusion coefficient left out")
    if len(rows):
        middle = float(rows["smallest_deg_s"].median())
        console.text(
            f"\nleast: speeds in deg/s that are told from Brownian motion in 95 % of such rotors, "
            f"at 5 % and at {z} errors.\nHalf of the rotors resolve {middle:.3g} deg/s; where "
            "diffusion makes the error, half the speed takes four times the duration."
        )
    console.json({"rotors": rows.to_dict("records"), "output": output})
    if output is not None:
        from rotortrack.files import atomic_path
        from rotortrack.report.draw import draw_resolved

        with atomic_path(output) as temporary:
            draw_resolved(temporary, rows, plan.driven_z, _format_of(output))


def _lines(plan: MoviePlan) -> list[str]:
    """Write the plan as one screen."""
    setting, z = plan.setting, f"{plan.driven_z:g}"
    deg = math.degrees
    noise = setting.noise_rad(plan.omega_rad_s or 0.0)
    rows = [
        ("movie", f"{setting.frames:.0f} frames, {setting.duration_s:.4g} s"),
        (
            "angle error",
            f"{deg(noise):.3g} deg a frame ({setting.localisation_sd_nm:.3g} nm on a circle of "
            f"{setting.radius_nm:g} nm)",
        ),
        (
            "steps",
            f"{deg(plan.step_sd_rad):.3g} deg between frames"
            + (
                "; above 55 deg counting by the 180-degree rule is biased, the likelihood on the "
                "circle is not"
                if plan.folded
                else ""
            ),
        ),
        (
            "speed error",
            f"{deg(plan.speed_sd_rad_s):.4g} deg/s, {plan.diffusion_share:.0%} of its square by "
            "diffusion, 2 D / T",
        ),
        ("error of D", _percent(plan.diffusion_relative_sd)),
        (
            "smallest speed",
            f"{_number(deg(plan.smallest_5_rad_s))} deg/s at 5 %, "
            f"{_number(deg(plan.smallest_rad_s))} deg/s at {z} errors (told in 95 % of rotors)",
        ),
        (
            "fastest speed",
            f"{deg(plan.fastest_rad_s):.4g} deg/s (beyond it steps exceed half a turn)",
        ),
        (
            "exposure",
            f"{1e3 * plan.longest_exposure_s:.3g} ms at most (the circle shrinks by less than "
            f"5 %); now {1e3 * setting.exposure_s:.3g} ms, shrunk by "
            f"{1.0 - setting.blur(plan.omega_rad_s or 0.0):.1%}",
        ),
    ]
    if plan.omega_rad_s is not None:
        rows += [
            (
                f"{deg(plan.omega_rad_s):.4g} deg/s",
                f"told in {plan.power_5:.1%} of such rotors at 5 %, in {plan.power_z:.1%} at {z} "
                "errors",
            ),
            ("frames needed", _frames(plan)),
            (
                "photons needed",
                (f"{plan.photons_needed:.3g} a frame, " if plan.photons_needed > 0 else "")
                + f"an error of {plan.most_noise_nm:.3g} nm at most"
                if math.isfinite(plan.most_noise_nm)
                else "no number suffices in this duration",
            ),
        ]
    width = max(len(name) for name, _ in rows) + 2
    return [f"{name:<{width}}{text}" for name, text in rows]


def _frames(plan: MoviePlan) -> str:
    if not math.isfinite(plan.frames_needed):
        return "no number suffices"
    seconds = plan.frames_needed * plan.setting.frame_interval_s
    return f"{plan.frames_needed:.0f} ({seconds:.4g} s)"


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "no"


def _percent(value: float) -> str:
    return f"{100 * value:.2g} %" if math.isfinite(value) else "D is not told"


def _result(plan: MoviePlan) -> dict[str, Any]:
    """Give the numbers that others build on."""
    setting, deg = plan.setting, math.degrees
    return {
        "frames": setting.frames,
        "duration_s": setting.duration_s,
        "localisation_sd_nm": setting.localisation_sd_nm,
        "noise_rad": setting.noise_rad(plan.omega_rad_s or 0.0),
        "step_sd_deg": deg(plan.step_sd_rad),
        "speed_sd_deg_s": deg(plan.speed_sd_rad_s),
        "diffusion_share": plan.diffusion_share,
        "diffusion_relative_sd": plan.diffusion_relative_sd,
        "smallest_speed_5_percent_deg_s": deg(plan.smallest_5_rad_s),
        "smallest_speed_deg_s": deg(plan.smallest_rad_s),
        "driven_z": plan.driven_z,
        "fastest_speed_deg_s": deg(plan.fastest_rad_s),
        "longest_exposure_s": plan.longest_exposure_s,
        "speed_deg_s": None if plan.omega_rad_s is None else deg(plan.omega_rad_s),
        "power_5_percent": plan.power_5,
        "power": plan.power_z,
        "frames_needed": plan.frames_needed,
        "duration_needed_s": plan.frames_needed * setting.frame_interval_s,
        "largest_localisation_sd_nm": plan.most_noise_nm,
        "photons_needed": plan.photons_needed,
    }


def _format_of(path: Path) -> Any:
    """Tell the format of a figure from its ending."""
    ending = path.suffix.lower().removeprefix(".")
    if ending not in ("png", "svg", "pdf"):
        raise click.UsageError(f"{path} has no known ending: a figure is .png, .svg or .pdf")
    return ending
