"""Angles and speeds of rotors against time under a changing voltage (Fig. 2j and Fig. S6)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rotortrack.motion.windowed_speed import WindowedSpeed
from rotortrack.report import style, words
from rotortrack.report.figures import canvas, columns, cumulative_angle, speed_trace
from rotortrack.report.figures.canvas import NothingToDrawError
from rotortrack.report.figures.columns import column
from rotortrack.units import TURN_RAD

EXAMPLES = 8
_ACROSS = 2


@canvas.in_house_style
def all_rotors(
    rotors: pd.DataFrame,
    tracks: Mapping[int, pd.DataFrame],
    voltages: pd.DataFrame,
    *,
    frame_interval_s: float,
) -> Figure:
    """Draw the voltage above the cumulative angles of all kept rotors (Fig. 2j).

    Parameters
    ----------
    rotors, voltages
        Tables of the run.
    tracks
        Rows of the tracks by rotor number.
    frame_interval_s
        Time from frame to frame (s).

    Raises
    ------
    NothingToDrawError
        No frame has a voltage, or no kept rotor has angles.
    """
    columns.need(voltages, "voltages", ["voltage_v"])
    made = canvas.new_figure(9.3, 6.1)
    axes = canvas.place(made, 0.8, 0.55, 4.9, 3.95)
    drawn = cumulative_angle.draw_all(axes, rotors, tracks, frame_interval_s=frame_interval_s)
    if not drawn:
        raise NothingToDrawError("no kept rotor has angles")
    canvas.heading(made, f"Voltage and angles of {words.count(len(drawn), 'rotor')}", 0.2)
    strip = canvas.place(made, 0.8, 4.75, 4.9, 0.75)
    _draw_voltage(strip, voltages, frame_interval_s)
    strip.set_xlim(axes.get_xlim())
    _mark_changes(axes, voltages, frame_interval_s)
    made.legend(
        handles=columns.handles(drawn, line=True), loc="upper left",
        bbox_to_anchor=(6.85 / 9.3, 4.6 / 6.1),
    )  # fmt: skip
    return made


@canvas.in_house_style
def examples(
    rotors: pd.DataFrame,
    tracks: Mapping[int, pd.DataFrame],
    voltages: pd.DataFrame,
    *,
    frame_interval_s: float,
    exposure_s: float,
    switches: pd.DataFrame | None = None,
) -> Figure:
    """Draw voltage, angle and windowed speed with its band for up to eight rotors (Fig. S6).

    The rotors are those whose speed is surest, |omega| over its standard deviation.

    Parameters
    ----------
    rotors, voltages, switches
        Tables of the run.
    tracks
        Rows of the tracks by rotor number.
    frame_interval_s, exposure_s
        Time from frame to frame and exposure within it (s).

    Raises
    ------
    NothingToDrawError
        No frame has a voltage, or no kept rotor a speed within windows.
    """
    columns.need(voltages, "voltages", ["voltage_v"])
    kept = columns.kept(rotors)
    sure = np.abs(column(kept, "omega_rad_s")) / column(kept, "omega_sd_rad_s")
    order = np.argsort(-np.nan_to_num(sure), kind="stable")
    chosen: list[tuple[dict[str, object], pd.DataFrame, tuple[WindowedSpeed, float]]] = []
    for record in kept.iloc[order].to_dict("records"):
        row = {str(name): value for name, value in record.items()}
        number = int(record["rotor"])
        if number not in tracks:
            continue
        of_rotor = None if switches is None else switches[switches["rotor"] == number]
        found = speed_trace.speeds_of(
            tracks[number], row, of_rotor, frame_interval_s=frame_interval_s, exposure_s=exposure_s
        )
        if found is not None:
            chosen.append((row, tracks[number], found))
        if len(chosen) == EXAMPLES:
            break
    if not chosen:
        raise NothingToDrawError("no kept rotor has a speed within windows of time")
    across = min(_ACROSS, len(chosen))
    down = -(-len(chosen) // across)
    width, height = 0.3 + 6.3 * across, 0.5 + 3.45 * down
    made = canvas.new_figure(width, height)
    canvas.heading(made, "Angle (blue, left) and speed (orange, right) under a voltage", 0.3)
    for k, (row, track, found) in enumerate(chosen):
        line, place = divmod(k, across)
        left, bottom = 0.85 + 6.3 * place, height - 0.5 - 3.45 * (line + 1) + 0.55
        strip = canvas.place(made, left, bottom + 1.95, 4.6, 0.55)
        axes = canvas.place(made, left, bottom, 4.6, 1.8)
        _draw_voltage(strip, voltages, frame_interval_s)
        strip.set_xlabel("")
        strip.set_xticklabels([])
        strip.set_title(words.wrap(words.title(row), 80, 1), y=1.06)
        _draw_example(axes, track, found, frame_interval_s)
        strip.set_xlim(axes.get_xlim())
        _mark_changes(axes, voltages, frame_interval_s)
    return made


def _draw_example(
    axes: Axes, track: pd.DataFrame, found: tuple[WindowedSpeed, float], frame_interval_s: float
) -> None:
    """Draw the angle on the left scale, the speed with two standard deviations on the right."""
    time = track["frame"].to_numpy(np.float64) * frame_interval_s
    turns = column(track, "cumulative_rad") / TURN_RAD
    axes.plot(*canvas.thin(time, turns, 800), color=style.BLUE, lw=1.1)
    axes.set_xlim(0, max(float(time[-1]), 1e-9))
    axes.set_xlabel("time (s)")
    axes.set_ylabel("revolutions", color=style.BLUE)
    right = axes.twinx()
    speeds = found[0]
    value, sd = speeds.omega_rad_s / TURN_RAD, speeds.sd_rad_s / TURN_RAD
    right.fill_between(
        speeds.time_s, value - 2 * sd, value + 2 * sd, color=style.VERMILLION, alpha=0.25, lw=0
    )
    right.plot(speeds.time_s, value, color=style.VERMILLION)
    right.axhline(0, color=style.PALE, lw=0.8, zorder=0)
    right.set_ylabel("speed (rev/s), ±2 sd", color=style.VERMILLION)
    right.spines["right"].set_visible(True)
    for axis in (axes.yaxis, right.yaxis, axes.xaxis):
        axis.set_major_locator(MaxNLocator(5))


def _draw_voltage(axes: Axes, voltages: pd.DataFrame, frame_interval_s: float) -> None:
    """Draw the mean voltage of each frame."""
    time = voltages["frame"].to_numpy(np.float64) * frame_interval_s
    value = 1e3 * column(voltages, "voltage_v")
    axes.plot(*canvas.thin(time, value), color=style.INK)
    low, high = float(np.nanmin(value)), float(np.nanmax(value))
    spare = 0.15 * max(high - low, 0.05 * abs(high), 1e-3)
    axes.set_ylim(low - spare, high + spare)
    axes.set_ylabel("mV")
    axes.yaxis.set_major_locator(MaxNLocator(3))
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xticklabels([])


def _mark_changes(axes: Axes, voltages: pd.DataFrame, frame_interval_s: float) -> None:
    """Mark the frames between the voltage steps."""
    if "step" not in voltages:
        return
    step = voltages["step"].to_numpy(np.int64)
    frame = voltages["frame"].to_numpy(np.float64)
    on_step = np.flatnonzero(step >= 0)
    changes = np.flatnonzero(np.diff(step[on_step]) != 0)
    for before, after in zip(on_step[changes], on_step[changes + 1], strict=True):
        middle = 0.5 * (frame[before] + frame[after] + 1) * frame_interval_s
        axes.axvline(middle, color=style.INK, lw=0.8, dashes=(2, 2), zorder=0)
