"""Histogram of angle steps between adjacent frames with normal fits (Fig. S4 of the paper)."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.report.words import Row
from rotortrack.units import DEGREES_PER_RADIAN


@canvas.in_house_style
def figure(track: pd.DataFrame, rotor: Row) -> Figure:
    """Draw one rotor's step sizes on their own (its rows of the tracks: step_rad, used)."""
    made = canvas.new_figure(5.2, 4.0)
    canvas.heading(made, words.wrap(words.title(rotor), 60, 2), 0.2)
    draw(canvas.place(made, 0.8, 0.55, 4.1, 2.65), track, rotor)
    return made


def draw(axes: Axes, track: pd.DataFrame, rotor: Row) -> None:
    """Draw the histogram of steps (degrees), a normal density and the rotor's wrapped normal one.

    Mean and sd are the maximum-likelihood fit of a normal distribution to all steps. The 180-degree
    rule folds wide steps back, which the wrapped normal distribution allows for.
    """
    axes.set_xlabel("step between adjacent frames (°)")
    steps = _steps(track)
    if len(steps) == 0:
        axes.set_ylabel("steps")
        canvas.notice(axes, "no steps")
        return
    mean, sd = float(steps.mean()), float(steps.std())
    bins = _bins(mean, sd)
    width = bins[1] - bins[0]
    axes.set_ylabel(f"steps per {width:g}°")
    counts, _ = np.histogram(steps, bins)
    colour = style.behaviour(rotor.get("behaviour")).colour
    axes.stairs(counts, bins, fill=True, color=colour, alpha=0.35)
    axes.stairs(counts, bins, color=colour, lw=0.8)
    if sd > 0:
        at = np.linspace(bins[0], bins[-1], 201)
        density = np.exp(-0.5 * ((at - mean) / sd) ** 2) / (sd * math.sqrt(2 * math.pi))
        axes.plot(
            at, len(steps) * width * density, color=style.INK, lw=1.2, label=f"normal, sd {sd:.2f}°"
        )
    _draw_wrapped(axes, rotor, bins, len(steps) * width)
    axes.axvline(0, color=style.GREY, lw=0.8, dashes=(1, 1.5), zorder=0)
    axes.set_xlim(bins[0], bins[-1])
    axes.set_ylim(0, 1.3 * max(counts.max(), 1))
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 1.5, 3, 4.5, 6, 9, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", labelspacing=0.25)
    factor, power = canvas.thousands(float(counts.max()))
    if power:
        axes.yaxis.set_major_formatter(lambda value, _: f"{value / factor:g}")
        axes.set_ylabel(f"{power}steps per {width:g}°")
    axes.set_title(
        words.minus(f"mean {mean:.2f}°, sd {sd:.2f}°, ") + words.count(len(steps), "step")
    )


def _draw_wrapped(axes: Axes, rotor: Row, bins: Floats, area: float) -> None:
    """Draw the wrapped normal density of the rotors table, where it has one."""
    mean = words.number(rotor, "wrapped_step_rad") * DEGREES_PER_RADIAN
    sd = words.number(rotor, "wrapped_step_sd_rad") * DEGREES_PER_RADIAN
    if not (math.isfinite(mean) and sd > 0):
        return
    at = np.linspace(bins[0], bins[-1], 201)
    turns = 360.0 * np.arange(-3, 4)[:, np.newaxis]
    density = np.exp(-0.5 * ((at - mean + turns) / sd) ** 2).sum(axis=0)
    density *= area / (sd * math.sqrt(2 * math.pi))
    dashes = (4, 2)
    axes.plot(
        at, density, color=style.VERMILLION, lw=1.2, dashes=dashes, label=f"wrapped, sd {sd:.2f}°"
    )


def _steps(track: pd.DataFrame) -> Floats:
    """Return the steps of used frames in degrees, those across a gap left out."""
    steps = track["step_rad"].to_numpy(np.float64) * DEGREES_PER_RADIAN
    good = np.isfinite(steps)
    good[1:] &= np.diff(track["frame"].to_numpy(np.int64)) == 1
    if "used" in track:
        good &= track["used"].to_numpy(bool)
    return steps[good].astype(np.float64)


def _bins(mean: float, sd: float) -> Floats:
    """Return edges, symmetric about zero, that show mean ± 5 sd within ±180 degrees."""
    reach = min(180.0, max(abs(mean) + 5 * sd, 1.0))
    width = next((w for w in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0) if w >= reach / 45), 5.0)
    half = math.ceil(reach / width - 1e-9)
    return np.arange(-half, half + 1, dtype=np.float64) * width
