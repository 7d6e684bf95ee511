"""How many rotors do what: unsigned speeds, the paper's classes, behaviours (Fig. S5)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator

from rotortrack.motion.population import of_rotors
from rotortrack.report import style, words
from rotortrack.report.figures import canvas, columns
from rotortrack.report.figures.canvas import Floats, NothingToDrawError
from rotortrack.report.figures.columns import column

FAST_DEG_S, SLOW_DEG_S = 720.0, 100.0
PAPER_CLASSES = {
    "fast": (f"> {FAST_DEG_S:.0f} °/s", style.BLUE),
    "slow": (f"{SLOW_DEG_S:.0f} to {FAST_DEG_S:.0f} °/s", style.SKY),
    "between": (f"< {SLOW_DEG_S:.0f} °/s", style.ORANGE),
    "none": ("no driven motion", style.GREY),
}
_Z = 1.959963984540054
_BAR_IN = 0.24


@canvas.in_house_style
def figure(rotors: pd.DataFrame) -> Figure:
    """Draw the published fit's speeds by the paper's classes, and counts with 95 % intervals.

    Parameters
    ----------
    rotors
        The rotors table (msd_speed_deg_s, paper_class, behaviour, drift_p); refused rotors do not
        count.

    Raises
    ------
    NothingToDrawError
        No kept rotor has a class or behaviour.
    """
    kept = columns.kept(rotors)
    kinds = _texts(kept, "behaviour")
    classes = _texts(kept, "paper_class")
    if not any(kinds) and not any(classes):
        raise NothingToDrawError("no kept rotor has a behaviour or a class of the paper")
    made = canvas.new_figure(12.0, 4.4)
    canvas.heading(made, f"Behaviour of {words.count(len(kept), 'kept rotor')}", 0.3)
    speeds = np.abs(column(kept, "msd_speed_deg_s"))
    _draw_speeds(canvas.place(made, 0.85, 0.6, 3.9, 2.9), speeds, classes)
    looks = style.BEHAVIOURS
    _draw_counts(
        canvas.place(made, 6.9, 0.6 + 2.9 - 8 * _BAR_IN, 1.6, 8 * _BAR_IN), kinds,
        {name: (look.label, look.colour) for name, look in looks.items()}, "behaviour",
    )  # fmt: skip
    _draw_counts(
        canvas.place(made, 10.1, 0.6 + 2.9 - 4 * _BAR_IN, 1.6, 4 * _BAR_IN), classes,
        PAPER_CLASSES, "class of the paper",
    )  # fmt: skip
    fraction = _driven(rotors)
    if fraction:
        made.text(6.9 / 12.0, 0.62 / 4.4, fraction, va="top")
    return made


def wilson(count: Floats, total: int) -> tuple[Floats, Floats]:
    """Return the 95 % interval of a share by Wilson's score."""
    share = count / total
    spread = _Z * np.sqrt(share * (1 - share) / total + _Z**2 / (4 * total**2))
    middle = share + _Z**2 / (2 * total)
    scale = 1 + _Z**2 / total
    return (middle - spread) / scale, (middle + spread) / scale


def _texts(table: pd.DataFrame, name: str) -> list[str]:
    if name not in table:
        return [""] * len(table)
    return [value if isinstance(value, str) else "" for value in table[name]]


def _draw_speeds(axes: Axes, speeds: Floats, classes: list[str]) -> None:
    """Stack the histograms of the classes; rotors without drive count at 0, as in the paper."""
    kinds = np.array(classes)
    speeds = np.where(kinds == "none", 0.0, speeds)
    known = np.isfinite(speeds)
    axes.set_xlabel("speed v of MSD = v²τ² + 2Dτ (°/s)")
    if not known.any():
        axes.set_ylabel("rotors")
        canvas.notice(axes, "no rotor has a speed of the published fit")
        return
    most = max(float(speeds[known].max()), FAST_DEG_S)
    width = canvas.nice(most / 12)
    edges = np.arange(0.0, most + 1.001 * width, width)
    base = np.zeros(len(edges) - 1)
    listed = {**PAPER_CLASSES, "": ("no class", style.PALE)}
    for name, (label, colour) in listed.items():
        counts, _ = np.histogram(speeds[known & (kinds == name)], edges)
        if counts.any():
            axes.stairs(
                base + counts, edges, baseline=base, fill=True, facecolor=colour,
                edgecolor="white", lw=0.4, label=label,
            )  # fmt: skip
            base = base + counts
    for limit in (SLOW_DEG_S, FAST_DEG_S):
        axes.axvline(limit, color=style.INK, lw=0.8, dashes=(2, 2))
    axes.set_xlim(0, edges[-1])
    axes.set_ylim(0, 1.1 * max(base.max(), 1))
    axes.set_ylabel(f"rotors per {width:g} °/s")
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    axes.xaxis.set_major_locator(MaxNLocator(5))
    factor, power = canvas.thousands(float(edges[-1]))
    if power:
        axes.xaxis.set_major_formatter(lambda value, _: f"{value / factor:g}")
        axes.set_xlabel(f"speed v of MSD = v²τ² + 2Dτ ({power}°/s)")
    axes.legend(loc="upper right")


def _draw_counts(
    axes: Axes, values: list[str], listed: Mapping[str, tuple[str, str]], title: str
) -> None:
    """Draw counts as bars with 95 % intervals, number and share at their right."""
    total = sum(value != "" for value in values)
    canvas.caption(axes, title)
    axes.set_xlabel("rotors")
    if total == 0:
        canvas.notice(axes, "not known")
        return
    counts = np.array([values.count(name) for name in listed], np.float64)
    low, high = (total * end for end in wilson(counts, total))
    rank = np.arange(len(counts), dtype=np.float64)
    axes.barh(rank, counts, height=0.72, color=[colour for _, colour in listed.values()])
    axes.hlines(rank, low, high, color=style.INK, lw=1.1)
    reach = max(float(high.max()), 1.0)
    for k, count in enumerate(counts):
        axes.annotate(
            f"{count:.0f}  ({_percent(count / total)})", (max(high[k], count), k), xytext=(4, 0),
            textcoords="offset points", va="center_baseline", fontsize=6.5,
            annotation_clip=False,
        )  # fmt: skip
    axes.set_xlim(0, 1.6 * reach)
    axes.set_ylim(len(counts) - 0.5, -0.5)
    axes.yaxis.set_major_locator(FixedLocator(rank.tolist()))
    axes.set_yticklabels([label for label, _ in listed.values()])
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))


def _percent(share: float) -> str:
    """Write a share without decimals, a small one with a digit."""
    return f"{100 * share:.{1 if 0 < share < 0.01 else 0}f} %"


def _driven(rotors: pd.DataFrame) -> str:
    """Write the driven share with its lower limit, empty where it is not known."""
    share = of_rotors(rotors).driven.at_least
    if not math.isfinite(share.value):
        return ""
    sure = f"at least {100 * share.low:.0f} % (97.5 % sure)"
    return f"driven beyond chance (p < 5 %): {100 * share.value:.0f} %, {sure}"
