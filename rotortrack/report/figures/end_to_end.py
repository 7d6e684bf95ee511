"""End-to-end distances: histograms of frames and rotors (Fig. 3e), and traces (Fig. S7)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats, NothingToDrawError

MOST_TRACES = 8
_MOST_BINS, _FEWEST_BINS = 40, 8
_TALL_IN, _WIDE_IN = 2.3, 4.1


@canvas.in_house_style
def histograms(frames: pd.DataFrame, rotors: pd.DataFrame) -> Figure:
    """Draw the distances as measured in frames, and the true mean distance of every rotor.

    Parameters
    ----------
    frames, rotors
        Tables of schemas END_TO_END and END_TO_END_ROTORS.

    Raises
    ------
    NothingToDrawError
        No rotor shows both ends.
    """
    measured = _finite(frames, "distance_nm")
    means = _finite(rotors, "end_to_end_nm")
    if not len(measured) or not len(means):
        raise NothingToDrawError("no rotor shows both ends")
    made = canvas.new_figure(2 * _WIDE_IN + 2.1, _TALL_IN + 1.4)
    canvas.heading(made, f"End-to-end distances of {words.count(len(means), 'rotor')}", 0.3)
    edges = _edges(np.concatenate([measured, means]))
    left = canvas.place(made, 0.8, 0.55, _WIDE_IN, _TALL_IN)
    right = canvas.place(made, 1.8 + _WIDE_IN, 0.55, _WIDE_IN, _TALL_IN)
    _histogram(left, measured, edges, style.GREY, "frames")
    left.set_title(f"{words.count(len(measured), 'frame')}, as measured: noise included")
    _histogram(right, means, edges, style.BLUE, "rotors")
    errors = rotors["end_to_end_sd_nm"].to_numpy(np.float64)
    told = errors[np.isfinite(errors)]
    typical = f", typical error {float(np.median(told)):.1f} nm" if len(told) else ""
    right.set_title(f"mean true distance of each rotor{typical}")
    return made


@canvas.in_house_style
def traces(
    of_frames: Mapping[int, pd.DataFrame], rotors: pd.DataFrame, *, frame_interval_s: float
) -> Figure:
    """Draw the distance over time of some rotors, with its moving median and true mean.

    Parameters
    ----------
    of_frames
        Rows of the table END_TO_END by rotor.
    rotors
        Table of schema END_TO_END_ROTORS.
    frame_interval_s
        Time from frame to frame.

    Raises
    ------
    NothingToDrawError
        No rotor shows both ends.
    """
    shown = _examples(rotors)
    if not len(shown):
        raise NothingToDrawError("no rotor shows both ends")
    down = math.ceil(len(shown) / 2)
    across = min(len(shown), 2)
    pitch = 1.75
    made = canvas.new_figure(across * 4.9 + 0.5, down * pitch + 0.7)
    canvas.heading(made, "End-to-end distance over time: frames, moving median, true mean", 0.3)
    for number, row in enumerate(shown.to_dict("records")):
        line, place = divmod(number, across)
        axes = canvas.place(made, 0.8 + place * 4.9, 0.55 + (down - 1 - line) * pitch, 3.9, 1.05)
        frames = of_frames[int(row["rotor"])]
        time_s = frames["frame"].to_numpy(np.float64) * frame_interval_s
        distance = frames["distance_nm"].to_numpy(np.float64)
        axes.plot(*canvas.thin(time_s, distance), color=style.PALE, lw=0.6)
        smooth = frames["moving_median_nm"].to_numpy(np.float64)
        axes.plot(*canvas.thin(time_s, smooth), color=style.BLUE, lw=1.0)
        axes.axhline(row["end_to_end_nm"], color=style.VERMILLION, lw=1.0, ls="--")
        axes.set_ylim(0, 1.15 * float(np.nanpercentile(distance, 99.5)))
        axes.set_title(
            f"rotor {int(row['rotor'])}: {row['end_to_end_nm']:.0f} ± "
            f"{row['end_to_end_sd_nm']:.1f} nm, breathing {row['breathing_nm']:.0f} nm"
        )
        if not place:
            axes.set_ylabel("distance (nm)")
        if line == down - 1 or number + across >= len(shown):
            axes.set_xlabel("time (s)")
    return made


def _examples(rotors: pd.DataFrame) -> pd.DataFrame:
    """Choose rotors from the shortest distance to the longest."""
    known = rotors.loc[np.isfinite(rotors["end_to_end_nm"].to_numpy(np.float64))]
    ordered: pd.DataFrame = known.sort_values(["end_to_end_nm", "rotor"], kind="stable")
    if len(ordered) <= MOST_TRACES:
        return ordered
    chosen: pd.DataFrame = ordered.iloc[
        np.linspace(0, len(ordered) - 1, MOST_TRACES).round().astype(int)
    ]
    return chosen


def _histogram(axes: Axes, values: Floats, edges: Floats, colour: str, what: str) -> None:
    counts, _ = np.histogram(values, edges)
    axes.stairs(counts, edges, fill=True, color=colour, alpha=0.4)
    axes.stairs(counts, edges, color=colour, lw=0.8)
    axes.set_xlim(0, edges[-1])
    axes.set_ylim(0, 1.08 * max(int(counts.max()), 1))
    axes.set_xlabel("end-to-end distance (nm)")
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    axes.set_ylabel(f"{what} per {edges[1] - edges[0]:g} nm")


def _edges(values: Floats) -> Floats:
    """Choose bins from 0 to the largest value, closed on the left, the last on both sides."""
    largest = max(float(np.percentile(values, 99.9)), 1.0)
    width = canvas.nice(largest / _FEWEST_BINS)
    while largest / width > _MOST_BINS:
        width *= 2.0
    return width * np.arange(math.ceil(max(values.max(), width) / width) + 1)


def _finite(table: pd.DataFrame, name: str) -> Floats:
    values: Floats = table[name].to_numpy(np.float64)
    return values[np.isfinite(values)]
