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
def figure(
    track: pd.DataFrame,
    rotor: Row,
    *,
    frame_interval_s: float,
    exposure_s: float | None = None,
    table: pd.DataFrame | None = None,
) -> Figure:
    """Draw one rotor's MSD on its own (parameters as `rotor_sheet.figure`, the table as msds)."""
    made = canvas.new_figure(5.2, 4.4)
    canvas.heading(made, words.wrap(words.title(rotor), 60, 2), 0.2)
    points = curve(track, frame_interval_s)
    draw(canvas.place(made, 0.8, 0.55, 4.1, 3.1), points, rotor, table=table, exposure_s=exposure_s)
    return made


def draw(
    axes: Axes,
    points: Curve,
    rotor: Row,
    *,
    table: pd.DataFrame | None = None,
    exposure_s: float | None = None,
) -> None:
    """Draw an MSD curve with v² τ² + 2 D τ, the lags of that fit, and guides of slope 1 and 2.

    The fit is solid inside its range of lags and dashed outside it. Beside it is the curve of the
    likelihood's speed, diffusion and noise, ω² τ² + 2 D (τ - exposure / 3) + 2 σ², to which no
    displacement was fitted. With the rotor's rows of the msd table, points are those, each with
    its standard deviation.
    """
    points, errors = (points, None) if table is None or table.empty else _of_table(table)
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
    colour = style.behaviour(rotor.get("behaviour")).colour
    if errors is not None:
        _band(axes, lags, values, errors, colour)
    axes.plot(
        lags, values, "o", ms=3, mew=0, color=colour, label="MSD" if errors is None else "MSD ± sd"
    )
    speed = words.number(rotor, "msd_speed_deg_s")
    diffusion = words.number(rotor, "msd_diffusion_rad2_s") * DEGREES_PER_RADIAN**2
    if math.isfinite(speed) and math.isfinite(diffusion):
        fit = speed**2 * lags**2 + 2 * diffusion * lags
        inside = (lags >= first * (1 - 1e-9)) & (lags <= last * (1 + 1e-9))
        axes.plot(lags, fit, "--", color=style.INK, lw=0.8)
        axes.plot(lags[inside], fit[inside], "-", color=style.INK, lw=1.6, label="v²τ² + 2Dτ")
        axes.set_title(f"fit: v = {_short(speed)} deg/s, D = {_short(diffusion)} deg²/s")
    expected = _likelihood(rotor, lags, exposure_s)
    if expected is not None:
        axes.plot(
            lags,
            expected,
            color=style.VERMILLION,
            lw=1.2,
            label="speed, D and noise\nof the likelihood",
        )
    _scale(axes, lags, values)
    axes.legend(loc="upper left", labelspacing=0.25)


@canvas.in_house_style
def all_rotors(
    rotors: pd.DataFrame, curves: dict[int, Curve], whole: pd.DataFrame | None = None
) -> Figure:
    """Draw the MSD of all kept rotors, coloured by behaviour, and their mean with its error.

    `curves` are by rotor number, `whole` the rows of the msd table for all rotors.
    """
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
    if whole is not None and len(whole) > 1 and len(shown) > 1:
        (mean_lags, mean), errors = _of_table(whole)
        _band(axes, mean_lags, mean, errors, style.INK)
        axes.plot(mean_lags, mean, color=style.INK, lw=1.8, label="mean ± sd of the mean")
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


def _of_table(table: pd.DataFrame) -> tuple[Curve, Floats]:
    """Return lags (s) and MSD (deg²) of rows of the msd table, and the standard deviations."""
    lags, values, errors = (
        table[name].to_numpy(np.float64)
        for name in ("lag_s", "angle_msd_rad2", "angle_msd_sd_rad2")
    )
    known = np.isfinite(values) & (values > 0)
    scale = DEGREES_PER_RADIAN**2
    return (lags[known], values[known] * scale), errors[known] * scale


def _band(axes: Axes, lags: Floats, values: Floats, errors: Floats, colour: str) -> None:
    """Draw one standard deviation either way; on log axes it ends above zero."""
    low = np.maximum(values - errors, 1e-3 * values)
    axes.fill_between(lags, low, values + errors, color=colour, alpha=0.25, lw=0)


def _likelihood(rotor: Row, lags: Floats, exposure_s: float | None) -> Floats | None:
    """Return the MSD (deg²) that the rotor's likelihood expects, where it was asked."""
    speed = words.number(rotor, "omega_rad_s")
    diffusion = words.number(rotor, "diffusion_rad2_s")
    noise = words.number(rotor, "theta_noise_rad")
    if rotor.get("speed_method") == "paper":
        return None
    if exposure_s is None or not math.isfinite(speed + diffusion + noise):
        return None
    blurred = np.maximum(lags - exposure_s / 3, 0)
    made = (speed * lags) ** 2 + 2 * diffusion * blurred + 2 * noise**2
    return np.asarray(made * DEGREES_PER_RADIAN**2, np.float64)


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
