"""Cumulative angle against time, of one rotor (Fig. 2d of the paper) and of all (Fig. 2e)."""

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
from rotortrack.report.figures.canvas import Floats
from rotortrack.report.figures.columns import handles, kept
from rotortrack.report.style import Look
from rotortrack.report.words import Row
from rotortrack.units import TURN_RAD


@canvas.in_house_style
def figure(
    track: pd.DataFrame,
    rotor: Row,
    *,
    frame_interval_s: float,
    switches: pd.DataFrame | None = None,
) -> Figure:
    """Draw one rotor's cumulative angle.

    Parameters
    ----------
    track
        The rotor's rows of the tracks (frame, cumulative_rad).
    rotor
        Its row of the rotors table.
    frame_interval_s
        Time from frame to frame (s).
    switches
        Its switches of speed, if any.
    """
    made = canvas.new_figure(6.4, 3.6)
    canvas.heading(made, words.wrap(words.title(rotor), 75, 2), 0.2)
    axes = canvas.place(made, 0.8, 0.55, 4.8, 2.4)
    draw(axes, track, rotor, frame_interval_s=frame_interval_s, switches=switches)
    return made


def draw(
    axes: Axes,
    track: pd.DataFrame,
    rotor: Row,
    *,
    frame_interval_s: float,
    switches: pd.DataFrame | None = None,
) -> None:
    """Draw one rotor's cumulative angle into axes, revolutions at the left, degrees at the right.

    Positive is counter-clockwise on the displayed image. The dashed line has the measured speed as
    its slope; where the rotor switches, its pieces have the slopes of the segments, and each switch
    is marked with its 95 % interval.
    """
    axes.set_xlabel("time (s)")
    axes.set_ylabel("revolutions")
    time, turns = _trace(track, frame_interval_s)
    if len(time) == 0:
        canvas.notice(axes, "no angles")
        return
    axes.plot(*canvas.thin(time, turns), color=style.behaviour(rotor.get("behaviour")).colour)
    speed, _ = words.rev_per_s(rotor)
    _frame(axes, time[-1], turns)
    if switches is not None and len(switches):
        _draw_switches(axes, time, turns, switches)
        axes.legend(
            loc="upper right" if turns[-1] < 0 else "lower right",
            frameon=True,
            framealpha=0.85,
            edgecolor="none",
        )
    elif math.isfinite(speed):
        limits = axes.get_ylim()
        ends = time[[0, -1]]
        line = turns.mean() + speed * (ends - time.mean())
        axes.plot(ends, line, "--", color=style.INK, lw=0.9, label="measured speed")
        axes.set_ylim(limits)
        axes.legend(loc="upper right" if speed < 0 else "lower right")
    _degrees_axis(axes)


@canvas.in_house_style
def all_rotors(
    rotors: pd.DataFrame, tracks: Mapping[int, pd.DataFrame], *, frame_interval_s: float
) -> Figure:
    """Draw the cumulative angles of all kept rotors, coloured by behaviour.

    Curves carry their rotor's number at the right wherever numbers do not collide, the fastest
    first. `tracks` maps a rotor's number to its rows of the tracks.
    """
    made = canvas.new_figure(9.3, 5.0)
    axes = canvas.place(made, 0.8, 0.55, 4.9, 3.95)
    drawn = draw_all(axes, rotors, tracks, frame_interval_s=frame_interval_s)
    canvas.heading(made, f"Cumulative angle of {words.count(len(drawn), 'rotor')}", 0.2)
    made.legend(
        handles=handles(drawn, line=True), loc="upper left", bbox_to_anchor=(6.85 / 9.3, 4.6 / 5.0)
    )
    return made


def draw_all(
    axes: Axes, rotors: pd.DataFrame, tracks: Mapping[int, pd.DataFrame], *, frame_interval_s: float
) -> list[Look]:
    """Draw all kept rotors' cumulative angles into axes; return the looks of those that have any.

    Parameters as `all_rotors`.
    """
    drawn = kept(rotors)
    ends: list[tuple[float, int, str]] = []
    shown: list[Look] = []
    last, extremes = 0.0, [0.0]
    for row in drawn.to_dict("records"):
        number = int(row["rotor"])
        if number not in tracks:
            continue
        time, turns = _trace(tracks[number], frame_interval_s)
        if len(time) == 0:
            continue
        look = style.behaviour(row.get("behaviour"))
        axes.plot(*canvas.thin(time, turns, 500), color=look.colour, lw=0.8)
        shown.append(look)
        ends.append((float(turns[-1]), number, look.colour))
        last = max(last, time[-1])
        extremes += [float(turns.min()), float(turns.max())]
    axes.set_xlabel("time (s)")
    axes.set_ylabel("revolutions")
    if not ends:
        canvas.notice(axes, "no rotors")
        return shown
    _frame(axes, last, np.array(extremes))
    _number_ends(axes, ends)
    _degrees_axis(axes, offset_points=24)
    return shown


def _draw_switches(axes: Axes, time: Floats, turns: Floats, switches: pd.DataFrame) -> None:
    """Mark switch times with their intervals, and draw each segment's speed through its middle."""
    switches = switches.sort_values("time_s")
    at = switches["time_s"].to_numpy(np.float64)
    for low, high in zip(switches["time_ci_low_s"], switches["time_ci_high_s"], strict=True):
        axes.axvspan(low, high, color=style.ORANGE, alpha=0.3, lw=0, zorder=0)
    marks = axes.vlines(
        at, 0, 1, transform=axes.get_xaxis_transform(), color=style.ORANGE, lw=0.9, zorder=1
    )
    marks.set_label("switch, 95 % interval")
    limits = axes.get_ylim()
    ends = np.concatenate([time[:1], at, time[-1:]])
    rates = np.append(switches["before_rad_s"], switches["after_rad_s"].iloc[-1:]) / TURN_RAD
    for k, rate in enumerate(rates):
        here = (time >= ends[k]) & (time <= ends[k + 1])
        if here.any():
            segment = ends[k : k + 2]
            line = turns[here].mean() + rate * (segment - time[here].mean())
            label = None if k else "measured speeds"
            axes.plot(segment, line, "--", color=style.INK, lw=0.9, label=label)
    axes.set_ylim(limits)


def _trace(track: pd.DataFrame, frame_interval_s: float) -> tuple[Floats, Floats]:
    """Return time (s) and cumulative revolutions where both are known."""
    time = track["frame"].to_numpy(np.float64) * frame_interval_s
    turns = track["cumulative_rad"].to_numpy(np.float64) / TURN_RAD
    good = np.isfinite(time) & np.isfinite(turns)
    return time[good], turns[good]


def _frame(axes: Axes, last: float, turns: Floats) -> None:
    """Set limits with a margin, at least one revolution high, and draw the zero line."""
    low, high = min(float(turns.min()), 0.0), max(float(turns.max()), 0.0)
    spare = max(0.06 * (high - low), (1.0 - (high - low)) / 2)
    axes.set_xlim(0, max(last, 1e-9))
    axes.set_ylim(low - spare, high + spare)
    axes.axhline(0, color=style.PALE, lw=0.8, zorder=0)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(6))
    factor, power = canvas.thousands(max(abs(low), high))
    if power:
        axes.yaxis.set_major_formatter(lambda value, _: words.minus(f"{value / factor:g}"))
        axes.set_ylabel(f"{power}revolutions")


def _degrees_axis(axes: Axes, offset_points: float = 0) -> None:
    """Add the same scale in degrees at the right."""
    right = axes.twinx()
    low, high = axes.get_ylim()
    right.set_ylim(360 * low, 360 * high)
    factor, power = canvas.thousands(360 * max(abs(low), abs(high)))
    right.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 1.8, 3.6, 9, 10]))
    right.yaxis.set_major_formatter(lambda value, _: words.minus(f"{value / factor:g}"))
    right.set_ylabel(f"cumulative angle ({power}°)")
    right.spines["right"].set_visible(True)
    right.spines["right"].set_position(("outward", offset_points))


def _number_ends(axes: Axes, ends: list[tuple[float, int, str]]) -> None:
    """Write rotor numbers at the ends of their curves, each only where there is room."""
    low, high = axes.get_ylim()
    height = axes.get_window_extent().height / axes.figure.dpi * 72
    room = 8.0 / height * (high - low)
    taken: list[float] = []
    for end, number, colour in sorted(ends, key=lambda entry: (-abs(entry[0]), entry[1])):
        if all(abs(end - other) >= room for other in taken):
            taken.append(end)
            axes.annotate(
                str(number),
                (1, end),
                xycoords=("axes fraction", "data"),
                xytext=(3, 0),
                textcoords="offset points",
                va="center",
                fontsize=6.5,
                color=colour,
            )
