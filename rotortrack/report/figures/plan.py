"""Plans: which speeds movies of any length resolve, and what the rotors of a run resolved."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rotortrack.motion.plan import Setting, smallest_speed
from rotortrack.motion.plan_movie import MoviePlan
from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats

_DECADES = (0.1, 1.0, 10.0, 100.0)
_POINTS = 60
_DASHES = ("-", "--", "-.", ":")


@canvas.in_house_style
def figure(plan: MoviePlan) -> Figure:
    """Draw the smallest speed that is resolved against the duration, for several D.

    The plan's own D is a thick line with its movie as a point; its speed is a horizontal line.
    """
    setting = plan.setting
    made = canvas.new_figure(6.6, 4.4)
    canvas.heading(made, _title(plan), 0.2)
    axes = canvas.place(made, 0.85, 0.6, 3.7, 3.35)
    axes.set_xlabel("duration (s)")
    axes.set_ylabel("smallest speed resolved (deg/s)")
    wanted = None if plan.omega_rad_s is None else abs(math.degrees(plan.omega_rad_s))
    needed = plan.frames_needed * setting.frame_interval_s
    marks = [setting.duration_s, *([needed] if math.isfinite(needed) else [])]
    left = min(1.0, *(m / 5.0 for m in marks), 1.0)
    right = max(100.0, *(5.0 * m for m in marks), 100.0)
    duration = np.geomspace(left, right, _POINTS)
    colours = (style.SKY, style.GREEN, style.ORANGE, style.PURPLE)
    shown: list[Floats] = []
    handles = []
    for diffusion, colour, line in zip(_DECADES, colours, _DASHES, strict=True):
        curve = _curve(replace(setting, diffusion_rad2_s=diffusion), duration, plan.driven_z)
        handles += axes.plot(
            duration, curve, line, color=colour, lw=1.0, label=f"D = {diffusion:g} rad²/s"
        )
        shown.append(curve)
    own = _curve(setting, duration, plan.driven_z)
    name = f"D = {setting.diffusion_rad2_s:.3g} rad²/s, yours"
    handles += axes.plot(duration, own, color=style.BLUE, lw=2.2, label=name)
    shown.append(own)
    if math.isfinite(plan.smallest_rad_s):
        handles += axes.plot(
            [setting.duration_s],
            [math.degrees(plan.smallest_rad_s)],
            "o",
            ms=8,
            mfc="white",
            mew=2.0,
            color=style.BLUE,
            label="your movie",
        )
    if wanted is not None:
        handles.append(axes.axhline(wanted, color=style.VERMILLION, lw=1.0, label="your speed"))
        shown.append(np.array([wanted]))
        if math.isfinite(needed):
            handles += axes.plot(
                [needed], [wanted], "D", ms=6, color=style.VERMILLION, label="duration it needs"
            )
    values = np.concatenate(shown)
    values = values[np.isfinite(values) & (values > 0.0)]
    _scale(axes, (left, right), (float(values.min()) / 1.5, float(values.max()) * 1.5))
    made.legend(handles=handles, loc="upper left", bbox_to_anchor=(4.65 / 6.6, 4.0 / 4.4))
    return made


@canvas.in_house_style
def resolved(rotors: pd.DataFrame, driven_z: float) -> Figure:
    """Draw the measured speeds of a run's rotors against the smallest that each resolves.

    Parameters
    ----------
    rotors
        Table of a :class:`rotortrack.pipeline.plan_run.RunPlan`.
    driven_z
        Errors by which the speed of a driven rotor differs from zero.
    """
    made = canvas.new_figure(7.0, 4.4)
    axes = canvas.place(made, 0.85, 0.6, 3.6, 3.35)
    axes.set_xlabel(f"smallest speed resolved at {driven_z:g} errors (deg/s)")
    axes.set_ylabel("speed measured, without sign (deg/s)")
    x = rotors["smallest_deg_s"].to_numpy(np.float64)
    y = rotors["speed_deg_s"].abs().to_numpy(np.float64)
    known = np.isfinite(x) & np.isfinite(y) & (y > 0.0)
    clear = int(np.count_nonzero(y[known] >= x[known]))
    canvas.heading(
        made, f"{clear} of {words.count(int(known.sum()), 'rotor')} above what they resolve", 0.2
    )
    if not known.any():
        canvas.notice(axes, "no speeds")
        return made
    sd = np.nan_to_num(rotors["speed_sd_deg_s"].to_numpy(np.float64))
    left, right = float(x[known].min()) / 1.6, float(x[known].max()) * 1.6
    foot = 0.1 * left
    high = max(1.7 * float((y + sd)[known].max()), 2.0 * right)
    # What is far slower lies at the foot of the axis, or it would take most of the page.
    shown = np.maximum(y, foot)
    handles = []
    kinds = rotors["behaviour"].astype(str).to_numpy()
    for look in style.BEHAVIOURS.values():
        of = known & (np.array([style.behaviour(k) for k in kinds]) == look)
        if not of.any():
            continue
        axes.errorbar(
            x[of],
            shown[of],
            yerr=np.stack([np.minimum(sd[of], shown[of] - foot), y[of] + sd[of] - shown[of]]).clip(
                0
            ),
            fmt=look.marker,
            color=look.colour,
            lw=0.8,
            ms=5,
        )
        handles.append(
            Line2D([], [], marker=look.marker, ls="", color=look.colour, label=look.label)
        )
    axes.plot([foot, high], [foot, high], color=style.INK, lw=0.9)
    handles.append(Line2D([], [], color=style.INK, lw=0.9, label="just resolved"))
    _scale(axes, (left, right), (foot / 1.15, high))
    made.legend(handles=handles, loc="upper left", bbox_to_anchor=(4.65 / 7.0, 4.0 / 4.4))
    return made


def _curve(setting: Setting, duration: Floats, driven_z: float) -> Floats:
    """Smallest speed resolved in deg/s; nan where none is."""
    return np.array(
        [
            math.degrees(
                smallest_speed(replace(setting, frames=t / setting.frame_interval_s), driven_z)
            )
            if t > 4.0 * setting.frame_interval_s / setting.detection
            else math.nan
            for t in duration
        ]
    )


def _title(plan: MoviePlan) -> str:
    setting = plan.setting
    smallest = math.degrees(plan.smallest_rad_s)
    if not math.isfinite(smallest):
        return f"{setting.duration_s:.3g} s resolve no speed"
    return f"{setting.duration_s:.3g} s resolve {smallest:.3g} deg/s and more"


def _scale(axes: Axes, across: tuple[float, float], up: tuple[float, float]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(*across)
    axes.set_ylim(*up)
    canvas.log_ticks(axes.xaxis, *across)
    canvas.log_ticks(axes.yaxis, *up)
    axes.grid(color=style.PALE, lw=0.5)
