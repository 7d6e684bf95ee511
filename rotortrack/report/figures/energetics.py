"""Diffusion, torque, power and friction of all kept rotors with their 95 % intervals."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rotortrack.report import style, words
from rotortrack.report.figures import canvas, columns
from rotortrack.report.figures.canvas import Floats, NothingToDrawError
from rotortrack.report.figures.columns import column

PANELS = (
    ("diffusion", "rad2_s", "rotational diffusion D (rad²/s)", True),
    ("friction", "pn_nm_s", "friction kT / D (pN nm s)", True),
    ("torque", "pn_nm", "torque kT ω / D (pN nm), positive = counter-clockwise", False),
    ("power", "pn_nm_s", "power kT ω² / D (pN nm/s)", True),
)
"""Column (without _UNIT), its unit, words of the axis, and whether that is logarithmic."""

NUMBERED_ROTORS = 40
_DECADES_BEYOND = 1.0
_LEAST_RATIO = 5.0


@canvas.in_house_style
def figure(rotors: pd.DataFrame) -> Figure:
    """Draw four ranked plots, coloured by behaviour; an arrow is an upper limit alone.

    Parameters
    ----------
    rotors
        The rotors table; refused rotors are left out.

    Raises
    ------
    NothingToDrawError
        No kept rotor has any of the four.
    """
    kept = columns.kept(rotors)
    found = [
        (panel, values)
        for panel in PANELS
        if np.isfinite(values := column(kept, f"{panel[0]}_{panel[1]}")).any()
    ]
    if not found:
        raise NothingToDrawError("no kept rotor has D, torque, power or friction")
    number = max(int(np.isfinite(values).sum()) for _, values in found)
    tall = float(np.clip(0.125 * number, 1.6, 5.0))
    across = min(len(found), 2)
    down = -(-len(found) // across)
    width, height = 0.95 + 4.95 * across, 0.75 + (tall + 1.0) * down
    made = canvas.new_figure(width, height)
    heading = f"Diffusion and energy of {words.count(number, 'rotor')}, 95 % intervals"
    shown = columns.looks(kept)
    limits = False
    for k, (panel, values) in enumerate(found):
        row, place = divmod(k, across)
        axes = canvas.place(
            made, 0.85 + 4.95 * place, height - 0.6 - tall - row * (tall + 1.0), 4.1, tall
        )
        limits |= _draw_ranked(axes, kept, panel, values)
    heading += " (arrows: upper limits)" if limits else ""
    canvas.heading(made, words.wrap(heading, int(11 * width), 2), 0.3)
    made.legend(
        handles=columns.handles(shown), loc="lower left", bbox_to_anchor=(0.6 / width, 0.02),
        ncols=2 * across, columnspacing=1.2,
    )  # fmt: skip
    return made


def _draw_ranked(
    axes: Axes, kept: pd.DataFrame, panel: tuple[str, str, str, bool], values: Floats
) -> bool:
    """Draw one panel; return whether it has upper limits."""
    name, unit, label, logarithmic = panel
    low, high = columns.interval(kept, name, unit, values, column(kept, f"{name}_sd_{unit}"))
    # What may vanish has an upper limit alone, and its best value says nothing.
    bounded = np.isfinite(values) & ((low > 0) | (not logarithmic))
    limited = logarithmic & ~bounded & (high > 0)
    at = np.where(bounded, values, high)
    order = np.lexsort((at, bounded))
    order = order[(bounded | limited)[order]]
    at, low, high, bounded = at[order], low[order], high[order], bounded[order]
    axes.set_xlabel(label)
    if len(order) == 0:
        canvas.notice(axes, "not known")
        return False
    rank = np.arange(len(order), dtype=np.float64)
    low = np.where(bounded, low, at / 1.5)
    left, right = _limits(at, low, high, logarithmic)
    if logarithmic:
        axes.set_xscale("log")
        canvas.log_ticks(axes.xaxis, left, right)
    else:
        axes.axvline(0, color=style.INK, lw=0.8, zorder=0)
        axes.xaxis.set_major_locator(MaxNLocator(6))
    shown = columns.looks(kept.iloc[order])
    few = len(order) <= NUMBERED_ROTORS
    for look in style.BEHAVIOURS.values():
        own = np.array([other is look for other in shown], bool)
        if not own.any():
            continue
        axes.hlines(
            rank[own], np.clip(low[own], left, right), np.clip(high[own], left, right),
            color=look.colour, lw=0.9, alpha=1.0 if few else 0.45,
        )  # fmt: skip
        for some, marker in ((own & bounded, look.marker), (own & ~bounded, "<")):
            axes.scatter(
                at[some], rank[some], s=20.0 if few else 7.0, marker=marker, color=look.colour,
                lw=0, zorder=3,
            )  # fmt: skip
    axes.set_xlim(left, right)
    axes.set_ylim(-0.8, len(order) - 0.2)
    if few:
        axes.set_yticks(rank, [str(int(n)) for n in kept["rotor"].iloc[order]], fontsize=6.0)
        axes.set_ylabel("rotor")
    else:
        axes.yaxis.set_major_locator(MaxNLocator(6, integer=True))
        axes.set_ylabel("rotors, sorted")
    return not bool(bounded.all())


def _limits(at: Floats, low: Floats, high: Floats, logarithmic: bool) -> tuple[float, float]:
    """Show all marks, and intervals unless they are far wider than all else."""
    if logarithmic:
        reach = 10**_DECADES_BEYOND
        least = max(float(low.min()), float(at.min()) / reach) / 1.3
        most = min(float(high.max()), float(at.max()) * reach) * 1.3
        widen = max(1.0, math.sqrt(_LEAST_RATIO * least / most))
        return least / widen, most * widen
    span = max(float(np.ptp(at)), float(np.abs(at).max()), 1e-12)
    left = min(max(float(low.min()), float(at.min()) - span / 2), 0.0)
    right = max(min(float(high.max()), float(at.max()) + span / 2), 0.0)
    spare = 0.04 * max(right - left, 1e-12)
    return left - spare, right + spare
