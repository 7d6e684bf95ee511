"""End-to-end distances per frame and per rotor, measured and simulated (after Fig. 3e and 3j)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.twocolour.compare import Comparison
from rotortrack.twocolour.compare_facts import CLOSED, Histogram, comparison_histograms

COLOURS = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY)
"""Colours of measured groups, in turns; a group's twins have its colour."""

_LINES = {"measured": "-", "twins": "--", "rods": ":"}
_AXES_IN = 2.7
_LONGEST_NAME = 24


@canvas.in_house_style
def figure(comparison: Comparison) -> Figure:
    """Draw the share of frames, and of rotors, in bins of distance.

    Measured groups are filled, simulated twins with the noise of a group dashed, and the scan's
    own distances without noise dotted.

    Parameters
    ----------
    comparison
        What was compared.
    """
    shown = comparison_histograms(comparison)
    below = 0.8 + 0.17 * len(shown)
    made = canvas.new_figure(10.4, below + _AXES_IN + 0.75)
    canvas.heading(made, "End-to-end distance", 0.2)
    edges = comparison.edges_nm
    for k, (name, what) in enumerate((("frames", "frame"), ("rotors", "rotor"))):
        axes = canvas.place(made, 0.85 + 5.0 * k, below, 4.2, _AXES_IN)
        _draw(axes, comparison, shown, name)
        axes.set_title(f"each {what} counts the same" if k == 0 else "mean of each rotor")
        axes.set_xlabel("end-to-end distance as seen from above (nm)")
        axes.set_ylabel(f"{name} (%) per {edges[1] - edges[0]:g} nm")
        if k == 0:
            axes.legend(
                loc="upper left", bbox_to_anchor=(-0.1, -0.5 / _AXES_IN), borderaxespad=0.0,
                labelspacing=0.35,
            )  # fmt: skip
    made.text(
        0.85 / 10.4, 0.1 / made.get_figheight(), f"bins {CLOSED}, from {edges[0]:g} to "
        f"{edges[-1]:g} nm in steps of {edges[1] - edges[0]:g} nm", color=style.GREY, va="bottom",
    )  # fmt: skip
    return made


def colour_of(comparison: Comparison, name: str) -> str:
    """Give the colour of a measured group."""
    names = [group.name for group in comparison.groups]
    return COLOURS[names.index(name) % len(COLOURS)] if name in names else style.INK


def short_name(name: str) -> str:
    """Leave out the middle of a name that is longer than a legend has room for."""
    if len(name) <= _LONGEST_NAME:
        return name
    half = _LONGEST_NAME // 2
    return f"{name[: half - 1]}…{name[-half:]}"


def _draw(axes: Axes, comparison: Comparison, shown: Sequence[Histogram], name: str) -> None:
    """Draw one kind of histogram of all groups."""
    edges = comparison.edges_nm
    highest = 0.0
    for one in shown:
        counts = one.frames if name == "frames" else one.rotors
        share = 100.0 * counts / counts.sum()
        highest = max(highest, float(share.max()))
        colour = colour_of(comparison, one.of or one.name)
        filled = one.kind == "measured"
        axes.stairs(
            share, edges, fill=filled, color=colour, alpha=0.35 if filled else 1.0,
            lw=1.2, ls=_LINES[one.kind], label=_label(one),
        )  # fmt: skip
        if filled:
            axes.stairs(share, edges, color=colour, lw=0.8)
    axes.set_xlim(0, _last_nm(edges, shown))
    axes.set_ylim(0, 1.08 * highest)
    axes.xaxis.set_major_locator(MaxNLocator(7))
    axes.yaxis.set_major_locator(MaxNLocator(5))


def _last_nm(edges: Floats, shown: Sequence[Histogram]) -> float:
    """Give the edge beyond which a group has but one in 2000 frames."""
    counts = np.array([one.frames for one in shown])
    beyond = 1.0 - np.cumsum(counts, axis=1) / counts.sum(axis=1, keepdims=True)
    last = int(np.sum(beyond > 5e-4, axis=1).max()) + 1
    return float(edges[min(last, len(edges) - 1)])


def _label(one: Histogram) -> str:
    """Say what a line is, and how much it is of."""
    name = short_name(one.name)
    if one.kind == "rods":
        return f"{name}: simulated, without noise, weighted (Fig. 3j)"
    n = f"{words.count(round(one.n_rotors), 'rotor')}, {words.count(round(one.n_frames), 'frame')}"
    if one.kind == "twins":
        of = short_name(one.of)
        return f"{name}: simulated, with the noise and screening of {of} (as n {n})"
    return f"{name}: measured, n = {n}"
