"""Mean-square angular displacement on log axes, of one rotor and of all (Fig. 2f of the paper)."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rotortrack.motion.msd import msd
from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.report.words import Row
from rotortrack.units import DEGREES_PER_RADIAN

Curve = tuple[Floats, Floats]


def curve(track: pd.DataFrame, frame_interval_s: float, points: int = 160) -> Curve:
    """Return lags (s) and MSD (deg²) up to half the record, evenly spaced on a log axis.

    Longer lags are left out: their few, overlapping pairs say nothing reliable.
    """
    frames = track["frame"].to_numpy(np.int64)
    angles = track["cumulative_rad"].to_numpy(np.float64)
    good = np.isfinite(angles)
    frames, angles = frames[good], angles[good]
    nothing = np.empty(0)
    if len(frames) < 3:
        return nothing, nothing
    trace = np.full(int(frames.max() - frames.min()) + 1, np.nan)
    trace[frames - frames.min()] = angles
    longest = len(trace) // 2
    result = msd(trace, longest)
    at = np.unique(np.geomspace(1, longest, points).round().astype(np.int64)) - 1
    values = result.values[at] * DEGREES_PER_RADIAN**2
    known = np.isfinite(values) & (values > 0)
    return (result.lags[at][known] * frame_interval_s).astype(np.float64), values[known]


@canvas.in_house_style
def figure(track: pd.DataFrame, rotor: Row, *, frame_interval_s: float) -> Figure:
    """Draw one rotor's MSD on its own (parameters as `cumulative_angle.figure`)."""
    made = canvas.new_figure(5.2, 4.4)
    canvas.heading(made, words.wrap(words.title(rotor), 60, 2), 0.2)
    draw(canvas.place(made, 0.8, 0.55, 4.1, 3.1), curve(track, frame_interval_s), rotor)
    return made


def draw(axes: Axes, points: Curve, rotor: Row) -> None:
    """Draw an MSD curve with v² τ² + 2 D τ, the lags of that fit, and guides of slope 1 and 2.

    The fit is solid inside its range of lags and dashed outside it.
    """
    axes.set_xlabel("lag τ (s)")
    axes.set_ylabel("MSD (deg²)")
    lags, values = points
    if len(lags) < 2:
        canvas.notice(axes, "no mean-square displacement")
        return
    first, last = words.number(rotor, "msd_lag_min_s"), words.number(rotor, "msd_lag_max_s")
    if first <= last:
        axes.axvspan(first, last, color=style.PALE, alpha=0.6, lw=0, label="lags of the fit")
    _guides(axes, lags, values)
    axes.plot(
        lags,
        values,
        "o",
        ms=3,
        mew=0,
        color=style.behaviour(rotor.get("behaviour")).colour,
        label="MSD",
    )
    speed = words.number(rotor, "msd_speed_deg_s")
    diffusion = words.number(rotor, "msd_diffusion_rad2_s") * DEGREES_PER_RADIAN**2
    if math.isfinite(speed) and math.isfinite(diffusion):
        fit = speed**2 * lags**2 + 2 * diffusion * lags
        inside = (lags >= first * (1 - 1e-9)) & (lags <= last * (1 + 1e-9))
        axes.plot(lags, fit, "--", color=style.INK, lw=0.8)
        axes.plot(lags[inside], fit[inside], "-", color=style.INK, lw=1.6, label="v²τ² + 2Dτ")
        axes.set_title(f"v = {_short(speed)} deg/s, D = {_short(diffusion)} deg²/s")
    _scale(axes, lags, values)
    axes.legend(loc="upper left", labelspacing=0.25)


@canvas.in_house_style
def all_rotors(rotors: pd.DataFrame, curves: dict[int, Curve]) -> Figure:
    """Draw the MSD of all kept rotors, coloured by behaviour; `curves` by rotor number."""
    made = canvas.new_figure(7.4, 5.0)
    axes = canvas.place(made, 0.8, 0.55, 4.3, 3.95)
    axes.set_xlabel("lag τ (s)")
    axes.set_ylabel("MSD (deg²)")
    kept = rotors[rotors["verdict"] == "kept"] if "verdict" in rotors else rotors
    seen: dict[str, int] = {}
    shown: list[Curve] = []
    for row in kept.to_dict("records"):
        lags, values = curves.get(int(row["rotor"]), (np.empty(0), np.empty(0)))
        if len(lags) < 2:
            continue
        look = style.behaviour(row.get("behaviour"))
        axes.plot(lags, values, color=look.colour, lw=0.8)
        seen[look.label] = seen.get(look.label, 0) + 1
        shown.append((lags, values))
    canvas.heading(
        made, f"Mean-square angular displacement of {words.count(len(shown), 'rotor')}", 0.2
    )
    if not shown:
        canvas.notice(axes, "no rotors")
        return made
    lags = np.concatenate([entry[0] for entry in shown])
    values = np.concatenate([entry[1] for entry in shown])
    order = np.argsort(lags, kind="stable")
    middle = np.array([np.median([entry[1][0] for entry in shown])])
    _guides(axes, lags[order], middle)
    _scale(axes, lags, values)
    handles = [
        Line2D([], [], color=look.colour, label=f"{look.label} ({seen[look.label]})")
        for look in style.BEHAVIOURS.values()
        if look.label in seen
    ]
    handles += axes.get_legend_handles_labels()[0]  # type: ignore[arg-type]
    made.legend(handles=handles, loc="upper left", bbox_to_anchor=(5.25 / 7.4, 4.55 / 5.0))
    return made


def _guides(axes: Axes, lags: Floats, values: Floats) -> None:
    """Draw lines of slope 1 (diffusion) and 2 (driven) from the first point."""
    ends = lags[[0, -1]]
    for slope, dashes in ((1, (1, 1.5)), (2, (4, 2))):
        axes.plot(
            ends,
            values[0] * (ends / ends[0]) ** slope,
            color=style.GREY,
            lw=0.8,
            dashes=dashes,
            label=f"slope {slope}",
        )


def _scale(axes: Axes, lags: Floats, values: Floats) -> None:
    """Set logarithmic limits from the data, with room for the legend above."""
    left, right = lags.min() / 1.2, lags.max() * 1.2
    low, high = values.min() / 2, values.max() * 2
    if high / low < 30:
        low, high = low / 3, high * 3
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    canvas.log_ticks(axes.xaxis, left, right)
    canvas.log_ticks(axes.yaxis, low, high)


def _short(value: float) -> str:
    """Write three significant digits without an exponent up to a million."""
    return f"{value:.3g}" if value < 1000 else f"{float(f'{value:.3g}'):.0f}"
