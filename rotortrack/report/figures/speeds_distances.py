"""Speed against end-to-end distance, measured and simulated (after Fig. S10 A, B)."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rotortrack.report import words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.report.figures.distances import colour_of, short_name
from rotortrack.twocolour.compare import AgainstRods, Comparison
from rotortrack.twocolour.correlation import RESOLVED_SD, Correlation
from rotortrack.twocolour.measured import MeasuredGroup

_MOST = 3
_WIDTH_IN, _HEIGHT_IN = 3.4, 3.0
_Z = 1.959963984540054
_MARKERS = ("o", "s", "^", "D", "v", "P")


@canvas.in_house_style
def figure(comparison: Comparison) -> Figure:
    """Draw the end-to-end distance of rotors against their speed, with 95 % intervals.

    Beside measured groups stand up to three pairs of a group and a scan, whose rods have the
    group's speeds, the faster rod the faster one. On logarithmic axes rotors are shown whose speed
    and distance exceed two standard deviations; the others are counted as unresolved.

    Parameters
    ----------
    comparison
        What was compared.
    """
    pairs = comparison.against[:_MOST]
    logarithmic = next(iter(comparison.correlations.values())).axes == "log"
    rows = len(comparison.groups)
    below = 0.65 + 0.17 * rows
    made = canvas.new_figure(
        max(0.4 + 4.3 * (1 + len(pairs)), 6.8), below + _HEIGHT_IN + 0.75
    )  # fmt: skip
    canvas.heading(made, "End-to-end distance and speed", 0.2)
    axes = canvas.place(made, 0.85, below, _WIDTH_IN, _HEIGHT_IN)
    axes.set_title("measured, 95 % intervals")
    speeds, distances = [], []
    for k, group in enumerate(comparison.groups):
        x, y = _draw_group(axes, comparison, group, _MARKERS[k % len(_MARKERS)], logarithmic)
        speeds.append(x)
        distances.append(y)
    axes.legend(
        loc="upper left", bbox_to_anchor=(-0.1, -0.45 / _HEIGHT_IN), borderaxespad=0.0,
        labelspacing=0.35,
    )  # fmt: skip
    shown = [axes]
    for k, pair in enumerate(pairs):
        other = canvas.place(made, 0.85 + 4.3 * (k + 1), below, _WIDTH_IN, _HEIGHT_IN)
        x, y = _draw_rods(other, comparison, pair)
        other.set_title(f"{short_name(pair.scan)}: speeds of {short_name(pair.group)}")
        speeds.append(x)
        distances.append(y)
        shown.append(other)
    for one in shown:
        _scale(one, np.concatenate(speeds), np.concatenate(distances), logarithmic)
    return made


def _draw_group(
    axes: Axes, comparison: Comparison, group: MeasuredGroup, marker: str, logarithmic: bool
) -> tuple[Floats, Floats]:
    """Draw a measured group; give what is shown, speed in rev/s and distance."""
    speed, speed_sd = np.abs(group.speed_deg_s) / 360, np.nan_to_num(group.speed_sd_deg_s) / 360
    distance, distance_sd = group.true_nm, group.true_sd_nm
    good = np.isfinite(speed) & np.isfinite(distance)
    both = int(good.sum())
    if logarithmic:
        good &= (speed > RESOLVED_SD * speed_sd) & (distance > RESOLVED_SD * distance_sd)
    x, y = speed[good], distance[good]
    x_sd, y_sd = speed_sd[good], distance_sd[good]
    colour = colour_of(comparison, group.name)
    # Two standard deviations stay above 0 where the axis is logarithmic.
    floor = 1e-3 * x if logarithmic else np.zeros_like(x)
    axes.hlines(y, np.maximum(x - _Z * x_sd, floor), x + _Z * x_sd, color=colour, lw=0.6, alpha=0.6)
    axes.vlines(x, y - _Z * y_sd, y + _Z * y_sd, color=colour, lw=0.6, alpha=0.6)
    unresolved = f" + {both - len(x)} unresolved" if both > len(x) else ""
    told = _correlation(comparison.correlations[group.name])
    axes.scatter(
        x, y, s=16, marker=marker, color=colour, lw=0,
        label=f"{short_name(group.name)} (n = {len(x)}{unresolved}): {told}",
    )  # fmt: skip
    return x, y


def _draw_rods(axes: Axes, comparison: Comparison, pair: AgainstRods) -> tuple[Floats, Floats]:
    """Draw the rods of a scan, their area by their weight."""
    rods = comparison.scans[pair.scan]
    x, y = np.abs(pair.speed_deg_s) / 360, rods.distance_nm
    size = 24.0 * rods.weight / rods.weight.mean()
    axes.scatter(
        x, y, s=np.clip(size, 3.0, 120.0), marker="o", facecolor="none",
        edgecolor=colour_of(comparison, pair.group), lw=0.8,
    )  # fmt: skip
    if math.isfinite(pair.rho):
        axes.text(
            0.0, -0.45 / _HEIGHT_IN, f"simulated: weighted ρ = {words.minus(f'{pair.rho:.2f}')}, "
            f"{words.count(len(x), 'rod')}, area by weight",
            transform=axes.transAxes, va="top", fontsize=7.5,
        )  # fmt: skip
    return x, y


def _correlation(found: Correlation) -> str:
    """Word a rank correlation with its interval."""
    if not math.isfinite(found.rho.value):
        return "too few for a correlation"
    ends = f"{found.rho.low:.2f} to {found.rho.high:.2f}"
    return words.minus(f"ρ = {found.rho.value:.2f} ({ends})")


def _scale(axes: Axes, speeds: Floats, distances: Floats, logarithmic: bool) -> None:
    """Give all panels the same axes."""
    axes.set_xlabel("|speed| (rev/s)")
    axes.set_ylabel("end-to-end distance (nm)")
    known = np.isfinite(speeds) & np.isfinite(distances)
    if logarithmic:
        known &= (speeds > 0) & (distances > 0)
    if not known.any():
        canvas.notice(axes, "no rotor has both")
        return
    x, y = speeds[known], distances[known]
    if logarithmic:
        for name, axis, values in (("x", axes.xaxis, x), ("y", axes.yaxis, y)):
            widen = max(1.3, math.sqrt(4.0 * float(values.min()) / float(values.max())))
            low, high = float(values.min()) / widen, float(values.max()) * widen
            axes.set(**{f"{name}scale": "log", f"{name}lim": (low, high)})
            canvas.log_ticks(axis, low, high)
        return
    axes.set_xlim(0, 1.08 * max(float(x.max()), 1e-9))
    axes.set_ylim(0, 1.15 * max(float(y.max()), 1.0))
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(6))
