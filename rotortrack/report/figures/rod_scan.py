"""A scan of simulated rods: phase diagram (Fig. S11), end-to-end distances, angles and speeds."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from rotortrack.report import style
from rotortrack.report.figures import canvas

Floats = npt.NDArray[np.float64]

_ENDS: Final = {
    "not_docked": ("not docked", style.VERMILLION),
    "translocated": ("translocated", style.GREY),
    "docked_still": ("docked, still", style.SKY),
    "in_membrane": ("in the membrane", style.BLACK),
    "other": ("undecided", style.PALE),
}
_RATE_MAP: Final = "viridis"
_MOST_TRACES: Final = 60


@canvas.in_house_style
def figure(runs: pd.DataFrame, time_us: Floats, turned_rad: Floats) -> Figure:
    """Draw a scan.

    Parameters
    ----------
    runs
        Table of schema ``simulate.tables.RUNS``.
    time_us, turned_rad
        Angle over time, shape (runs, points).

    Returns
    -------
    Figure
        Phase diagram, end-to-end distances of rotating rods (Fig. 3j), their angles (Fig. 3k) and
        speed against end-to-end distance (Fig. S10B).
    """
    made = canvas.new_figure(9.6, 7.6)
    turning = runs["end"] == "rotating_steadily"
    canvas.heading(made, f"{len(runs)} simulated rods, {int(turning.sum())} rotating steadily", 0.3)
    _diagram(made, canvas.place(made, 0.8, 4.15, 3.1, 2.5), runs)
    ends = canvas.place(made, 6.2, 4.35, 3.0, 2.3)
    angles = canvas.place(made, 0.8, 0.65, 3.1, 2.3)
    speeds = canvas.place(made, 6.2, 0.65, 3.0, 2.3)
    rods = runs[turning]
    ends.set_title("end-to-end distance of rotating rods")
    angles.set_title("angle over time")
    speeds.set_title("speed and end-to-end distance")
    if rods.empty:
        for axes in (ends, angles, speeds):
            canvas.notice(axes, "no rod rotates steadily")
        return made
    distance = rods["end_to_end_xy_nm"].to_numpy(np.float64)
    ends.hist(distance, bins=[25.0 * k for k in range(19)], color=style.BLUE, edgecolor="white")
    ends.set_xlabel("end-to-end distance seen from above (nm)")
    ends.set_ylabel("rods")
    _angles(angles, time_us[turning.to_numpy()], turned_rad[turning.to_numpy()])
    _speeds(speeds, distance, rods["rate_rev_s"].to_numpy(np.float64))
    return made


def _diagram(made: Figure, axes: Axes, runs: pd.DataFrame) -> None:
    """Cells by charge and flow: the mean rate where rods rotate, else how most of them end."""
    charges, ratios = (np.sort(runs[name].unique()) for name in ("lambda_eff", "flow_ratio"))
    rate = np.full((ratios.size, charges.size), np.nan)
    kind = np.full(rate.shape, np.nan)
    for i, j in np.ndindex(rate.shape):
        place = i, j
        cell = runs[(runs["flow_ratio"] == ratios[i]) & (runs["lambda_eff"] == charges[j])]
        if cell.empty:
            continue
        turning = cell[cell["end"] == "rotating_steadily"]
        if len(turning):
            rate[place] = math.log10(max(float(turning["rate_rev_s"].abs().mean()), 1e-3))
            continue
        most = str(cell["end"].mode().iloc[0])
        kind[place] = list(_ENDS).index(most if most in _ENDS else "other")
    colours: Any = ListedColormap([colour for _, colour in _ENDS.values()])
    axes.imshow(kind, origin="lower", aspect="auto", cmap=colours, vmin=-0.5, vmax=len(_ENDS) - 0.5)
    finite = rate[np.isfinite(rate)]
    if finite.size:
        low, high = float(finite.min()), float(finite.max())
        norm = Normalize(low, high if high > low else low + 1.0)
        image = axes.imshow(rate, origin="lower", aspect="auto", cmap=_RATE_MAP, norm=norm)
        box = axes.get_position()
        bar = made.add_axes((box.x1 + 0.01, box.y0, 0.012, box.height))
        made.colorbar(image, cax=bar)
        bar.set_ylabel("log₁₀ of the mean |rate| (rev/s)", labelpad=4)
    axes.set_xticks(range(charges.size), [f"{c:g}" for c in charges])
    axes.set_yticks(range(ratios.size), [f"{r:g}" for r in ratios])
    axes.set_xlabel("λ_eff, part of the bare charge")
    axes.set_ylabel("λ_flow / λ_eff")
    shown = [k for k in range(len(_ENDS)) if np.any(kind == k)]
    handles = [
        Patch(color=list(_ENDS.values())[k][1], label=list(_ENDS.values())[k][0]) for k in shown
    ]
    axes.set_title("phase diagram", y=1.0 + 0.25 / 2.5)
    if handles:
        axes.legend(
            handles=handles, loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=5,
            borderaxespad=0.1, columnspacing=0.9, handlelength=1.0,
        )  # fmt: skip


def _angles(axes: Axes, time_us: Floats, turned_rad: Floats) -> None:
    chosen = np.unique(np.linspace(0, len(time_us) - 1, _MOST_TRACES).astype(int))
    for row in chosen:
        turns = turned_rad[row] / (2.0 * math.pi)
        colour = style.BLUE if turns[-1] > 0.0 else style.VERMILLION
        axes.plot(time_us[row], turns, color=colour, linewidth=0.7)
    axes.plot([], [], color=style.BLUE, label="counter-clockwise")
    axes.plot([], [], color=style.VERMILLION, label="clockwise")
    axes.axhline(0.0, color=style.GREY, linewidth=0.5)
    canvas.caption(axes, "angle over time")
    axes.set_xlabel("time (μs)")
    axes.set_ylabel("turns")


def _speeds(axes: Axes, distance: Floats, rate: Floats) -> None:
    for sign, look in ((1.0, "driven_ccw"), (-1.0, "driven_cw")):
        chosen = sign * rate > 0.0
        kind = style.BEHAVIOURS[look]
        axes.plot(
            distance[chosen], np.abs(rate[chosen]), kind.marker, color=kind.colour,
            markersize=4, label="counter-clockwise" if sign > 0 else "clockwise",
        )  # fmt: skip
    axes.set_yscale("log")
    size = np.abs(rate[rate != 0.0])
    if size.size:
        low, high = 0.7 * float(size.min()), 1.4 * float(size.max())
        axes.set_ylim(low, high)
        canvas.log_ticks(axes.yaxis, low, high)
    axes.set_xlim(0.0, 460.0)
    canvas.caption(axes, "speed and end-to-end distance")
    axes.set_xlabel("end-to-end distance seen from above (nm)")
    axes.set_ylabel("|rate| (rev/s)")
