"""Diffusion, torque, power and friction of all kept rotors with their 95 % intervals."""

from __future__ import annotations

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
_DECADES_BELOW = 2.0


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
    canvas.heading(
        made, f"Diffusion and energy of {words.count(number, 'rotor')}, 95 % intervals", 0.3
    )
    shown = columns.looks(kept)
    for k, (panel, values) in enumerate(found):
        row, place = divmod(k, across)
        axes = canvas.place(
            made, 0.85 + 4.95 * place, height - 0.6 - tall - row * (tall + 1.0), 4.1, tall
        )
        _draw_ranked(axes, kept, panel, values)
    made.legend(
        handles=columns.handles(shown), loc="lower left", bbox_to_anchor=(0.6 / width, 0.02),
        ncols=2 * across, columnspacing=1.2,
    )  # fmt: skip
    return made


def _draw_ranked(
    axes: Axes, kept: pd.DataFrame, panel: tuple[str, str, str, bool], values: Floats
) -> None:
    name, unit, label, logarithmic = panel
    sd = column(kept, f"{name}_sd_{unit}")
    low, high = columns.interval(kept, name, unit, values, sd)
    # A vanishing value of a positive quantity has an upper limit alone.
    order = np.argsort(np.where(np.isfinite(values), values, np.inf), kind="stable")
    order = order[np.isfinite(values[order])]
    values, low, high = values[order], low[order], high[order]
    rank = np.arange(len(order), dtype=np.float64)
    left, right = _limits(values, low, high, logarithmic)
    if logarithmic:
        axes.set_xscale("log")
        canvas.log_ticks(axes.xaxis, left, right)
    else:
        axes.axvline(0, color=style.INK, lw=0.8, zorder=0)
        axes.xaxis.set_major_locator(MaxNLocator(6))
    shown = columns.looks(kept.iloc[order])
    bounded = values > left if logarithmic else np.ones(len(values), bool)
    size = 20.0 if len(order) <= NUMBERED_ROTORS else 7.0
    for look in style.BEHAVIOURS.values():
        own = np.array([other is look for other in shown], bool)
        if not own.any():
            continue
        axes.hlines(
            rank[own], np.clip(low[own], left, right), np.clip(high[own], left, right),
            color=look.colour, lw=0.9,
        )  # fmt: skip
        for some, marker, at in (
            (own & bounded, look.marker, values), (own & ~bounded, "<", np.clip(high, left, right)),
        ):  # fmt: skip
            axes.scatter(at[some], rank[some], s=size, marker=marker, color=look.colour, lw=0)
    axes.set_xlim(left, right)
    axes.set_ylim(-0.8, len(order) - 0.2)
    axes.set_xlabel(label)
    if len(order) <= NUMBERED_ROTORS:
        axes.set_yticks(rank, [str(int(n)) for n in kept["rotor"].iloc[order]], fontsize=6.0)
        axes.set_ylabel("rotor")
    else:
        axes.yaxis.set_major_locator(MaxNLocator(6, integer=True))
        axes.set_ylabel("rotors, sorted")


def _limits(values: Floats, low: Floats, high: Floats, logarithmic: bool) -> tuple[float, float]:
    """Show all values, and intervals unless they are far wider than all else."""
    if logarithmic:
        positive = values[values > 0]
        positive = positive if len(positive) else high[high > 0]
        if len(positive) == 0:
            return 0.1, 10.0
        reach = 10**_DECADES_BELOW
        least = max(np.where(low > 0, low, positive.min() / reach).min(), positive.min() / reach)
        most = min(max(high.max(), positive.max()), positive.max() * reach)
        return float(least) / 1.3, float(most) * 1.3
    span = max(float(np.ptp(values)), float(np.abs(values).max()), 1e-12)
    left = max(float(low.min()), float(values.min()) - span / 2)
    right = min(float(high.max()), float(values.max()) + span / 2)
    left, right = min(left, 0.0), max(right, 0.0)
    spare = 0.04 * max(right - left, 1e-12)
    return left - spare, right + spare
