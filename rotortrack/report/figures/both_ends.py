"""Where both ends of a rotor go (Fig. 3b-d), and how end-to-end axes lie (Fig. S8)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats, NothingToDrawError

MOST_ROTORS = 24
_TILE_IN, _LABEL_IN = 1.75, 0.42
_MOST_POINTS = 1500
_BINS = 12


@canvas.in_house_style
def figure(
    of_frames: Mapping[int, pd.DataFrame],
    of_spots: Mapping[int, pd.DataFrame],
    rotors: pd.DataFrame,
    ends: pd.DataFrame,
) -> Figure:
    """Draw the places of both ends of every rotor about its centre, all on one scale.

    Parameters
    ----------
    of_frames, of_spots
        Rows of END_TO_END and of the localisations, by rotor.
    rotors, ends
        Tables of schemas ROTORS and END_TO_END_ROTORS.

    Raises
    ------
    NothingToDrawError
        No rotor shows both ends.
    """
    both = ends.merge(rotors[["rotor", "x_nm", "y_nm"]], on="rotor").sort_values("rotor")
    placed = np.isfinite(both[["x_nm", "y_nm"]].to_numpy(np.float64)).all(axis=1)
    both = both.loc[placed].head(MOST_ROTORS)
    if both.empty:
        raise NothingToDrawError("no rotor shows both ends")
    places = [_places(of_frames, of_spots, row) for row in both.to_dict("records")]
    half = max(float(np.percentile(np.abs(np.concatenate(pair)), 99)) for pair in places)
    half = 1.15 * max(half, 50.0)
    across = min(len(both), 6)
    down = math.ceil(len(both) / across)
    page = max(across * (_TILE_IN + 0.1) + 0.4, 5.2)
    tall = down * (_TILE_IN + _LABEL_IN) + 0.85
    made = canvas.new_figure(page, tall)
    canvas.heading(
        made, f"Both ends of {words.count(len(both), 'rotor')}, tiles of {2 * half:.0f} nm", 0.2
    )
    for number, (row, (first, second)) in enumerate(
        zip(both.to_dict("records"), places, strict=True)
    ):
        line, place = divmod(number, across)
        axes = canvas.place(
            made,
            0.2 + place * (_TILE_IN + 0.1),
            tall - 0.45 - (line + 1) * (_TILE_IN + _LABEL_IN),
            _TILE_IN,
            _TILE_IN,
        )
        for points, colour, marker in (
            (first, style.VERMILLION, "o"),
            (second, style.BLUE, "s"),
        ):
            thinned = points[:: max(len(points) // _MOST_POINTS, 1)]
            axes.plot(*thinned.T, marker, color=colour, ms=1.2, mew=0, alpha=0.5, ls="none")
        axes.plot(0, 0, "+", color=style.INK, ms=5, mew=0.7)
        axes.set_xlim(-half, half)
        axes.set_ylim(half, -half)
        axes.set_xticks([])
        axes.set_yticks([])
        for side in ("top", "right"):
            axes.spines[side].set_visible(True)
        axes.set_title(
            f"rotor {int(row['rotor'])}: {row['end_to_end_nm']:.0f} nm\n{row['arrangement']}",
            fontsize=7.5,
        )
    handles = [
        Line2D([], [], color=colour, marker=marker, ls="none", ms=4, label=label)
        for colour, marker, label in (
            (style.VERMILLION, "o", "first end"),
            (style.BLUE, "s", "second end"),
        )
    ]
    made.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.02, 0.0), ncols=2)
    return made


@canvas.in_house_style
def axes_figure(ends: pd.DataFrame, pore_axis_deg: float | None = None) -> Figure:
    """Draw the directions of the end-to-end axes, and how firmly each rotor keeps its own.

    Parameters
    ----------
    ends
        Table of schema END_TO_END_ROTORS.
    pore_axis_deg
        Long axis of elongated pores, which is drawn where it is given.

    Raises
    ------
    NothingToDrawError
        No rotor has an axis.
    """
    known = ends[np.isfinite(ends[["axis_deg", "order"]]).all(axis=1)]
    if known.empty:
        raise NothingToDrawError("no rotor has an end-to-end axis")
    made = canvas.new_figure(8.2, 4.0)
    canvas.heading(made, f"End-to-end axes of {words.count(len(known), 'rotor')}", 0.3)
    rose = made.add_axes((0.04, 0.08, 0.38, 0.64), projection="polar")
    angles = np.deg2rad(known["axis_deg"].to_numpy(np.float64))
    firm = known["order"].to_numpy(np.float64)
    edges = np.linspace(0, 2 * math.pi, 2 * _BINS + 1)
    # An axis has two directions: half a turn later the histogram repeats.
    counts, _ = np.histogram(np.concatenate([angles, angles + math.pi]) % (2 * math.pi), edges)
    rose.bar(
        edges[:-1],
        counts,
        width=np.diff(edges),
        align="edge",
        color=style.SKY,
        ec=style.BLUE,
        lw=0.5,
    )
    top = max(int(counts.max()), 1)
    if pore_axis_deg is not None:
        for angle in (math.radians(pore_axis_deg), math.radians(pore_axis_deg) + math.pi):
            rose.plot([angle, angle], [0, 1.1 * top], color=style.VERMILLION, lw=1.5)
    rose.set_yticks([])
    rose.tick_params(labelsize=7)
    rose.set_title(
        "rotors by mean axis" + (", pore axis red" if pore_axis_deg is not None else ""), y=1.13
    )
    right = canvas.place(made, 4.5, 0.6, 3.3, 2.6)
    chance = known["order_p"].to_numpy(np.float64)
    for clear, colour, marker, label in (
        (chance < 0.05, style.BLUE, "o", "p < 0.05"),
        (~(chance < 0.05), style.GREY, "s", "no preferred axis"),
    ):
        if clear.any():
            right.plot(
                known["axis_deg"].to_numpy()[clear], firm[clear], marker, color=colour, ls="none",
                label=label,
            )  # fmt: skip
    if pore_axis_deg is not None:
        right.axvline(pore_axis_deg % 180.0, color=style.VERMILLION, lw=1.2, label="pore axis")
    right.set_xlim(0, 180)
    right.set_ylim(0, 1.02)
    right.set_xticks([0, 45, 90, 135, 180])
    right.set_xlabel("direction of the axis (°), counter-clockwise from the right")
    right.set_ylabel("order parameter")
    right.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    return made


def _places(
    of_frames: Mapping[int, pd.DataFrame],
    of_spots: Mapping[int, pd.DataFrame],
    row: Mapping[Any, Any],
) -> tuple[Floats, Floats]:
    """Give the places of both ends about the rotor's centre, (frames, 2) each."""
    number = int(row["rotor"])
    spots = of_spots[number][["frame", "x_nm", "y_nm"]].drop_duplicates("frame")
    joined = of_frames[number][["frame", "dx_nm", "dy_nm"]].merge(spots, on="frame")
    first = joined[["x_nm", "y_nm"]].to_numpy(np.float64) - [row["x_nm"], row["y_nm"]]
    return first, first + joined[["dx_nm", "dy_nm"]].to_numpy(np.float64)
