"""Angle of one rotor against time, frame by frame, with errors and the posterior's band."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, MaxNLocator

from rotortrack.report import style
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.report.figures.columns import column
from rotortrack.report.words import Row
from rotortrack.units import DEGREES_PER_RADIAN

FRAMES = 100
"""Frames that are shown: more could not be told apart."""


def draw(
    axes: Axes,
    track: pd.DataFrame,
    rotor: Row,
    posterior: pd.DataFrame | None = None,
    *,
    frame_interval_s: float,
) -> None:
    """Draw the stretch of 100 frames that has the most angles, each with its standard deviation.

    The band is the posterior angle, two standard deviations to either side; it knows missing
    frames, too.
    """
    axes.set_xlabel("time (s)")
    axes.set_ylabel("angle (°)")
    angle = column(track, "theta_rad")
    frame = track["frame"].to_numpy(np.int64)
    known = np.isfinite(angle)
    if not known.any():
        canvas.notice(axes, "no angles")
        return
    # Every frame is exposed at its own time, so that a stretch is one of frames, gaps included.
    seen = frame[known]
    ends = np.searchsorted(seen, seen + FRAMES)
    first = int(seen[np.argmax(ends - np.arange(len(seen)))])
    if posterior is not None:
        _draw_band(axes, _within(posterior, first), frame_interval_s)
    part = _within(track[known], first)
    time = part["frame"].to_numpy(np.float64) * frame_interval_s
    degrees = column(part, "theta_rad") * DEGREES_PER_RADIAN
    sd = np.nan_to_num(column(part, "theta_sd_rad")) * DEGREES_PER_RADIAN
    colour = style.behaviour(rotor.get("behaviour")).colour
    if posterior is None:
        axes.plot(*_broken(time, degrees), color=colour, lw=0.6, alpha=0.6)
    axes.errorbar(
        time, degrees, yerr=sd, fmt="o", ms=2.4, mew=0, color=colour, elinewidth=0.7,
        label="angle, sd",
    )  # fmt: skip
    start = first * frame_interval_s
    axes.set_xlim(start, start + FRAMES * frame_interval_s)
    axes.set_ylim(-180, 180)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(FixedLocator([-180, -90, 0, 90, 180]))
    canvas.caption(axes, f"frames {first} to {first + FRAMES - 1}")


def _within(table: pd.DataFrame, first: int) -> pd.DataFrame:
    frame = table["frame"].to_numpy()
    return table[(frame >= first) & (frame < first + FRAMES)]


def _draw_band(axes: Axes, part: pd.DataFrame, frame_interval_s: float) -> None:
    """Draw the posterior as a band that is repeated a turn above and below, where it wraps."""
    angle, sd = column(part, "theta_rad"), column(part, "theta_sd_rad")
    good = np.isfinite(angle) & np.isfinite(sd)
    if good.sum() < 2:
        return
    time = part["frame"].to_numpy(np.float64)[good] * frame_interval_s
    whole = np.unwrap(angle[good]) * DEGREES_PER_RADIAN
    reach = 2.0 * sd[good] * DEGREES_PER_RADIAN
    lowest = int(np.floor((whole - reach).min() / 360 + 0.5))
    highest = int(np.ceil((whole + reach).max() / 360 - 0.5))
    turns = range(lowest, highest + 1)
    for turn in turns:
        axes.fill_between(
            time, whole - reach - 360 * turn, whole + reach - 360 * turn, color=style.ORANGE,
            alpha=0.35, lw=0, label="posterior, ±2 sd" if turn == turns[0] else None,
        )  # fmt: skip


def _broken(time: Floats, degrees: Floats) -> tuple[Floats, Floats]:
    """Break a line where it would cross the whole plot to wrap."""
    jumps = np.flatnonzero(np.abs(np.diff(degrees)) > 180) + 1
    return np.insert(time, jumps, np.nan), np.insert(degrees, jumps, np.nan)
