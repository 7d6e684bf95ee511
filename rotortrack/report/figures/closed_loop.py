"""The analysis of films against their truth: speeds, diffusion, radii, verdicts and behaviours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rotortrack.report import style
from rotortrack.report.figures import canvas

_COLOURS = (style.BLUE, style.ORANGE, style.GREEN, style.PURPLE)
_MOTIONS = ("driven", "brownian")
_PULLS = np.linspace(-4.0, 4.0, 25)

Confusion = Mapping[str, Mapping[str, int]]


@canvas.in_house_style
def figure(
    rotors: Mapping[str, pd.DataFrame],
    verdicts: Mapping[str, Confusion],
    behaviours: Mapping[str, Confusion],
) -> Figure:
    """Draw a closed loop.

    Parameters
    ----------
    rotors
        By analysis: the true rotors with what was found of them, as
        `rotortrack.tradeoff.closed_loop.Analysis.rotors` gives them.
    verdicts, behaviours
        By analysis: counts by kind of true rotor, then by what was found. The first is drawn.

    Returns
    -------
    Figure
        Found against true speed and D, errors over reported ones, radii, and both confusions.
    """
    made = canvas.new_figure(11.4, 7.4)
    first = next(iter(rotors))
    canvas.heading(made, f"{len(rotors[first])} rotors of films against their truth", 0.3)
    speeds = canvas.place(made, 0.85, 4.2, 2.7, 2.4)
    pulls = canvas.place(made, 4.6, 4.2, 2.7, 2.4)
    diffusions = canvas.place(made, 8.35, 4.2, 2.7, 2.4)
    radii = canvas.place(made, 0.85, 0.7, 2.7, 2.4)
    for colour, (name, table) in zip(_COLOURS, rotors.items(), strict=False):
        moving = table[
            table["motion"].isin(_MOTIONS)
            & (table["found_verdict"] == "kept")
            & ~table["double"].astype(bool)
        ]
        _speeds(speeds, moving, colour, name)
        _pulls(pulls, moving, colour, name)
        _points(diffusions, moving, "diffusion_rad2_s", colour, name)
        _points(radii, moving, "radius_nm", colour, name)
    diffusions.set_xscale("log")
    diffusions.set_yscale("log")
    _finish(speeds, "speed", "true (deg/s)", "found (deg/s)")
    _finish(diffusions, "diffusion", "true D (rad²/s)", "found D (rad²/s)")
    _finish(radii, "radius", "true (nm)", "found (nm)")
    pulls.set_title("errors over reported ones")
    pulls.set_xlabel("error of the speed over its standard deviation")
    pulls.set_ylabel("rotors")
    if pulls.has_data():
        pulls.legend(loc="upper right")
    _confusion(canvas.place(made, 5.15, 0.95, 1.5, 2.0), verdicts[first], f"verdict, {first}")
    _confusion(canvas.place(made, 8.35, 0.95, 2.7, 2.0), behaviours[first], f"behaviour, {first}")
    return made


def _speeds(axes: Axes, moving: pd.DataFrame, colour: str, name: str) -> None:
    true = np.degrees(moving["mean_omega_rad_s"].to_numpy(float))
    found = np.degrees(moving["found_omega_rad_s"].to_numpy(float))
    sds: Any = np.degrees(np.nan_to_num(moving["found_omega_sd_rad_s"].to_numpy(float)))
    axes.errorbar(
        true, found, yerr=sds, fmt="o", color=colour, markersize=2.5, linewidth=0.6, label=name
    )


def _points(axes: Axes, moving: pd.DataFrame, column: str, colour: str, name: str) -> None:
    axes.plot(
        moving[column],
        moving[f"found_{column}"],
        "o",
        color=colour,
        markersize=2.5,
        label=name,
    )


def _pulls(axes: Axes, moving: pd.DataFrame, colour: str, name: str) -> None:
    error = moving["found_omega_rad_s"] - moving["mean_omega_rad_s"]
    told = (error / moving["found_omega_sd_rad_s"]).to_numpy(float)
    told = told[np.isfinite(told)]
    if not told.size:
        return
    inside = np.clip(told, _PULLS[0], _PULLS[-1])
    axes.hist(inside, bins=_PULLS.tolist(), color=colour, alpha=0.6, label=name)
    grid = np.linspace(_PULLS[0], _PULLS[-1], 200)
    height = told.size * (_PULLS[1] - _PULLS[0]) / np.sqrt(2.0 * np.pi)
    axes.plot(grid, height * np.exp(-(grid**2) / 2.0), color=style.BLACK, label="normal")


def _finish(axes: Axes, title: str, across: str, up: str) -> None:
    axes.set_title(title)
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    low = min(axes.get_xlim()[0], axes.get_ylim()[0])
    high = max(axes.get_xlim()[1], axes.get_ylim()[1])
    axes.plot([low, high], [low, high], color=style.GREY, linewidth=0.8, zorder=0)
    axes.legend(loc="lower right")


def _confusion(axes: Axes, counts: Confusion, title: str) -> None:
    axes.set_title(title)
    if not counts:
        axes.set_axis_off()
        return
    kinds = list(counts)
    found: Sequence[str] = sorted({name for row in counts.values() for name in row})
    table = np.array([[counts[kind].get(name, 0) for name in found] for kind in kinds], float)
    shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1.0)
    axes.imshow(shares, cmap=style.COUNTS_MAP, vmin=0.0, vmax=1.6, aspect="auto")
    for row, column in np.argwhere(table > 0):
        axes.text(column, row, f"{table[row, column]:.0f}", ha="center", va="center", fontsize=7)
    axes.set_xticks(range(len(found)), [name.replace("_", " ") for name in found])
    axes.tick_params(axis="x", labelrotation=40)
    for label in axes.get_xticklabels():
        label.set_horizontalalignment("right")
    axes.set_yticks(range(len(kinds)), [kind.replace("_", " ") for kind in kinds])
