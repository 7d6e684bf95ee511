"""Signed speeds of all kept rotors (after Fig. S5 of the paper, with sign and intervals)."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, NullFormatter

from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats

NUMBERED_ROTORS = 60
"""Up to here each rotor has a line of its own with its number."""


@canvas.in_house_style
def figure(rotors: pd.DataFrame) -> Figure:
    """Draw a histogram of signed speeds above the sorted speeds with their 95 % intervals.

    Parameters
    ----------
    rotors
        The rotors table; refused rotors and those without a speed are left out and counted.
    """
    kept = rotors[rotors["verdict"] == "kept"] if "verdict" in rotors else rotors
    rows = kept.to_dict("records")
    speeds = np.array([words.rev_per_s(row)[0] for row in rows], np.float64)
    measured = np.flatnonzero(np.isfinite(speeds))
    order = measured[np.argsort(speeds[measured], kind="stable")]
    dots_height = float(np.clip(0.145 * len(order), 1.2, 8.0))
    made = canvas.new_figure(8.7, 3.55 + dots_height)
    bottom = 0.6 + dots_height
    dots = canvas.place(made, 0.85, 0.5, 5.0, dots_height)
    bars = canvas.place(made, 0.85, bottom + 0.1, 5.0, 2.0)
    canvas.heading(made, f"Signed speed of {words.count(len(order), 'kept rotor')}", 0.2)
    dots.set_xlabel("speed (rev/s), positive = counter-clockwise on the displayed image")
    if len(order) == 0:
        canvas.notice(bars, "no rotors" if len(rows) == 0 else "no rotor has a speed")
        canvas.notice(dots, "")
        return made
    names = [str(rows[i].get("behaviour")) for i in order]
    numbers = [int(rows[i]["rotor"]) for i in order]
    low, high = _intervals([rows[i] for i in order], speeds[order])
    edges = _edges(speeds[order])
    _draw_histogram(bars, speeds[order], names, edges)
    _draw_dots(dots, speeds[order], low, high, names, numbers)
    limits = _limits(low, high, edges)
    for axes in (bars, dots):
        axes.set_xlim(limits)
        axes.axvline(0, color=style.INK, lw=0.8, zorder=0)
        axes.xaxis.set_major_locator(MaxNLocator(8))
    bars.xaxis.set_major_formatter(NullFormatter())
    _degrees_axis(bars)
    _legend(made, names, len(rows) - len(order))
    return made


def _intervals(rows: list[dict[str, object]], speeds: Floats) -> tuple[Floats, Floats]:
    """Return the ends of the 95 % intervals in rev/s; where unknown, the speed itself."""
    low = np.array([words.number(row, "speed_ci_low_deg_s") for row in rows]) / 360
    high = np.array([words.number(row, "speed_ci_high_deg_s") for row in rows]) / 360
    return (
        np.where(np.isfinite(low), low, speeds),
        np.where(np.isfinite(high), high, speeds),
    )


def _edges(speeds: Floats) -> Floats:
    """Return about 30 bins of a round width, with an edge at zero."""
    span = max(speeds.max(), 0.0) - min(speeds.min(), 0.0)
    width = canvas.nice(max(span, 1e-3) / 15)
    first, last = np.floor(min(speeds.min(), 0.0) / width), np.ceil(max(speeds.max(), 0.0) / width)
    return np.arange(first - 1, last + 2) * width


def _limits(low: Floats, high: Floats, edges: Floats) -> tuple[float, float]:
    """Show all speeds, and intervals unless they are wider than everything else."""
    span = edges[-1] - edges[0]
    return (
        float(min(edges[0], max(low.min(), edges[0] - span / 2))),
        float(max(edges[-1], min(high.max(), edges[-1] + span / 2))),
    )


def _draw_histogram(axes: Axes, speeds: Floats, names: list[str], edges: Floats) -> None:
    """Stack the histograms of the behaviours."""
    base = np.zeros(len(edges) - 1)
    kinds = np.array([style.behaviour(name).label for name in names])
    for look in style.BEHAVIOURS.values():
        counts, _ = np.histogram(speeds[kinds == look.label], edges)
        if counts.any():
            axes.stairs(
                base + counts, edges, baseline=base, fill=True, facecolor=look.colour,
                edgecolor="white", lw=0.4,
            )  # fmt: skip
            base = base + counts
    axes.set_ylim(0, 1.08 * base.max())
    axes.set_ylabel(f"rotors per {edges[1] - edges[0]:.3g} rev/s")
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))


def _draw_dots(
    axes: Axes, speeds: Floats, low: Floats, high: Floats, names: list[str], numbers: list[int]
) -> None:
    """Draw sorted speeds, slowest at the bottom, with interval bars."""
    rank = np.arange(len(speeds), dtype=np.float64)
    kinds = np.array([style.behaviour(name).label for name in names])
    size = 22.0 if len(speeds) <= NUMBERED_ROTORS else 8.0
    for look in style.BEHAVIOURS.values():
        of_kind = kinds == look.label
        if of_kind.any():
            axes.hlines(rank[of_kind], low[of_kind], high[of_kind], color=look.colour, lw=1.0)
            axes.scatter(
                speeds[of_kind], rank[of_kind], s=size, marker=look.marker, color=look.colour, lw=0
            )
    axes.set_ylim(-0.8, len(speeds) - 0.2)
    if len(speeds) <= NUMBERED_ROTORS:
        axes.set_yticks(rank, [str(number) for number in numbers], fontsize=6.5)
        axes.set_ylabel("rotor")
    else:
        axes.yaxis.set_major_locator(MaxNLocator(8, integer=True))
        axes.set_ylabel("rotors, sorted by speed")


def _degrees_axis(axes: Axes) -> None:
    """Add the same scale in degrees per second above."""
    upper = axes.twiny()
    low, high = axes.get_xlim()
    upper.set_xlim(360 * low, 360 * high)
    factor, power = canvas.thousands(360 * max(abs(low), abs(high)))
    upper.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 1.8, 3.6, 9, 10]))
    upper.xaxis.set_major_formatter(lambda value, _: words.minus(f"{value / factor:g}"))
    upper.set_xlabel(f"speed ({power}°/s)")
    upper.spines["top"].set_visible(True)


def _legend(made: Figure, names: list[str], without_speed: int) -> None:
    """Explain colours and markers at the right, with counts."""
    kinds = [style.behaviour(name).label for name in names]
    handles = [
        Line2D(
            [],
            [],
            color=look.colour,
            marker=look.marker,
            ms=5,
            mew=0,
            label=f"{look.label} ({kinds.count(look.label)})",
        )
        for look in style.BEHAVIOURS.values()
        if look.label in kinds
    ]
    if without_speed:
        label = f"kept without a speed ({without_speed})"
        handles.append(Line2D([], [], ls="none", label=label))
    width, height = made.get_size_inches()
    made.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(6.2 / width, 1 - 0.85 / height),
        title="bars: 95 % interval", alignment="left",
    )  # fmt: skip
