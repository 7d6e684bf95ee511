"""Speeds before and after a change of voltage, and speeds against voltage."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rotortrack.motion.voltage_speeds import StepChange, step_changes
from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.units import TURN_RAD

_MOST_LINES = 60
_VISIBLE_SHARE = 2e-3


@canvas.in_house_style
def figure(
    voltage_speeds: pd.DataFrame, voltages: pd.DataFrame, *, frame_interval_s: float
) -> Figure:
    """Draw voltage against time, the largest change of speeds, and speeds against voltage.

    Parameters
    ----------
    voltage_speeds
        One row a rotor and voltage step.
    voltages
        One row a frame.
    frame_interval_s
        Time from frame to frame (s).
    """
    made = canvas.new_figure(9.6, 6.4)
    strip = canvas.place(made, 0.8, 4.95, 8.5, 0.85)
    scatter = canvas.place(made, 0.8, 0.6, 3.4, 3.4)
    lines = canvas.place(made, 5.6, 0.6, 3.7, 3.4)
    number = voltage_speeds["rotor"].nunique()
    canvas.heading(made, f"Voltage and speed of {words.count(number, 'rotor')}", 0.2)
    _draw_voltage(strip, voltages, frame_interval_s)
    changes = step_changes(voltage_speeds)
    tested = [change for change in changes if math.isfinite(change.line.p_slope)]
    # The change that most rotors show is the one of interest; among equals the first.
    draw_change(scatter, voltage_speeds, max(tested, key=lambda c: c.line.n, default=None))
    _draw_speeds(lines, voltage_speeds)
    return made


def draw_change(axes: Axes, voltage_speeds: pd.DataFrame, change: StepChange | None) -> None:
    """Draw each rotor's speeds before and after a change of voltage, with both error bars.

    The dashed line is what a speed proportional to the voltage gives; the full one is fitted
    through the origin, errors in both axes.
    """
    if change is None:
        axes.set_xlabel("speed before (rev/s)")
        axes.set_ylabel("speed after (rev/s)")
        canvas.notice(axes, "no change of voltage with three rotors")
        return
    before, after = (
        voltage_speeds[voltage_speeds["step"] == step].set_index("rotor")
        for step in (change.step, change.step + 1)
    )
    after = after.loc[before.index]
    x, x_sd, y, y_sd = (
        part[name].to_numpy(np.float64) / TURN_RAD
        for part in (before, after)
        for name in ("omega_rad_s", "omega_sd_rad_s")
    )
    good = np.isfinite(x) & np.isfinite(y)
    axes.errorbar(
        x[good], y[good], xerr=x_sd[good], yerr=y_sd[good], fmt="o", ms=3.5, mew=0,
        color=style.BLUE, ecolor=style.SKY, elinewidth=0.7,
    )  # fmt: skip
    axes.set_xlabel(f"rev/s at {_volts(change.before_v)}")
    axes.set_ylabel(f"rev/s at {_volts(change.after_v)}")
    _limits(axes.set_xlim, x[good], x_sd[good])
    _limits(axes.set_ylim, y[good], y_sd[good])
    for place in (axes.axhline, axes.axvline):
        place(0, color=style.PALE, lw=0.8, zorder=0)
    line = change.line
    ends = np.array(axes.get_xlim())
    shown = axes.get_ylim()
    factor = words.minus(f"{line.ratio:.3g}")
    axes.plot(ends, line.ratio * ends, "--", color=style.INK, lw=0.9, label=f"v₂ = {factor} v₁")
    if math.isfinite(line.slope):
        fitted = f"v₂ = ({words.plus_minus(line.slope, line.slope_sd, '')}) v₁, fitted"
        axes.plot(ends, line.slope * ends, color=style.VERMILLION, lw=1.0, label=fitted)
    axes.set_ylim(shown)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(6))
    axes.set_title(f"p = {line.p_slope:.2g} for the dashed line, {words.count(line.n, 'rotor')}")
    axes.legend(loc="lower right" if line.ratio > 0 else "upper right")


def _draw_voltage(axes: Axes, voltages: pd.DataFrame, frame_interval_s: float) -> None:
    """Draw the mean voltage of each frame, and shade frames in transition."""
    time = voltages["frame"].to_numpy(np.float64) * frame_interval_s
    value = voltages["voltage_v"].to_numpy(np.float64)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("voltage (V)")
    if not np.isfinite(value).any():
        canvas.notice(axes, "no frame has a voltage")
        return
    axes.plot(*canvas.thin(time, value), color=style.INK)
    axes.fill_between(
        time, 0, 1, where=voltages["transition"].to_numpy(bool), color=style.ORANGE, alpha=0.4,
        lw=0, transform=axes.get_xaxis_transform(), label="not constant or not known",
    )  # fmt: skip
    axes.set_xlim(time[0], max(time[-1], 1e-9))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    if voltages["transition"].mean() > _VISIBLE_SHARE:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0))


def _draw_speeds(axes: Axes, voltage_speeds: pd.DataFrame) -> None:
    """Draw each rotor's speed at each voltage, joined in order of time, with the median of all."""
    axes.set_xlabel("voltage (V)")
    axes.set_ylabel("speed (rev/s)")
    known = voltage_speeds[np.isfinite(voltage_speeds["omega_rad_s"].to_numpy(np.float64))]
    if len(known) == 0:
        canvas.notice(axes, "no rotor has a speed at a voltage")
        return
    for _, part in list(known.sort_values(["rotor", "step"]).groupby("rotor"))[:_MOST_LINES]:
        axes.errorbar(
            part["voltage_v"], part["omega_rad_s"] / TURN_RAD,
            yerr=part["omega_sd_rad_s"] / TURN_RAD,
            color=style.GREY, ecolor=style.INK, marker="o", ms=2.5, lw=0.5, elinewidth=0.9,
            capsize=1.8,
        )  # fmt: skip
    by_step = known.assign(size=known["omega_rad_s"].abs() / TURN_RAD).groupby("step")
    volts, size = by_step["voltage_v"].first(), by_step["size"].median()
    axes.plot(
        volts, size, color=style.VERMILLION, marker="D", ms=4.5, lw=1.2, zorder=5,
        label="median speed without sign",
    )  # fmt: skip
    axes.axhline(0, color=style.PALE, lw=0.8, zorder=0)
    spread = max(float(np.ptp(known["voltage_v"])), 1e-3)
    axes.set_xlim(
        known["voltage_v"].min() - 0.12 * spread, known["voltage_v"].max() + 0.12 * spread
    )
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(6))
    shown = min(known["rotor"].nunique(), _MOST_LINES)
    axes.set_title(f"bars: standard deviation; {words.count(shown, 'rotor')}")
    axes.legend(loc="upper left")


def _limits(set_limits: Callable[[float, float], object], value: Floats, sd: Floats) -> None:
    """Show all points with their bars, and the origin."""
    low, high = min(float((value - sd).min()), 0.0), max(float((value + sd).max()), 0.0)
    spare = 0.06 * max(high - low, 1e-3)
    set_limits(low - spare, high + spare)


def _volts(value: float) -> str:
    """Write a voltage in mV below 1 V."""
    if abs(value) < 1.0:
        return words.minus(f"{1e3 * value:.3g} mV")
    return words.minus(f"{value:.3g} V")
