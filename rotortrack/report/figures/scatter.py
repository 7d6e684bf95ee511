"""Speed of all kept rotors against diffusion, radius and friction, with errors in both axes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from rotortrack.report import style, words
from rotortrack.report.figures import canvas, columns
from rotortrack.report.figures.canvas import Floats, NothingToDrawError
from rotortrack.report.figures.columns import column

CROWD = 120
"""Above this many rotors markers shrink."""

_LEAST_RATIO = 5.0


@canvas.in_house_style
def figure(rotors: pd.DataFrame) -> Figure:
    """Draw signed speed against D and against radius, and D against radius.

    Parameters
    ----------
    rotors
        The rotors table; refused rotors and those without a speed are left out.

    Raises
    ------
    NothingToDrawError
        No kept rotor has a speed together with D or a radius.
    """
    kept = columns.kept(rotors)
    rows = kept.to_dict("records")
    speed = np.array([words.rev_per_s(row)[0] for row in rows], np.float64)
    speed_bars = columns.interval(kept, "speed", "deg_s", 360 * speed)
    speed_bars = (speed_bars[0] / 360, speed_bars[1] / 360)
    diffusion = column(kept, "diffusion_rad2_s")
    diffusion_bars = columns.interval(
        kept, "diffusion", "rad2_s", diffusion, column(kept, "diffusion_sd_rad2_s")
    )
    radius = column(kept, "radius_nm")
    spread = 1.96 * np.nan_to_num(column(kept, "radius_sd_nm"))
    radius_bars = (radius - spread, radius + spread)
    one = ("speed (rev/s)", speed, speed_bars, False)
    two = ("diffusion D (rad²/s)", diffusion, diffusion_bars, True)
    three = ("radius (nm)", radius, radius_bars, False)
    seen = np.isfinite(speed) & (np.isfinite(diffusion) | np.isfinite(radius))
    if not seen.any():
        raise NothingToDrawError("no kept rotor has a speed together with D or a radius")
    made = canvas.new_figure(12.6, 4.7)
    canvas.heading(
        made,
        f"Speed, diffusion and radius of {words.count(int(seen.sum()), 'rotor')}, "
        "95 % intervals",
        0.3,
    )  # fmt: skip
    shown = columns.looks(kept)
    for k, (x, y) in enumerate(((two, one), (three, one), (three, two))):
        _draw_pair(canvas.place(made, 0.85 + 4.1 * k, 1.0, 3.3, 3.05), x, y, shown)
    made.legend(
        handles=columns.handles([look for look, own in zip(shown, seen, strict=True) if own]),
        loc="lower left", bbox_to_anchor=(0.055, 0.01), ncols=4, columnspacing=1.4,
    )  # fmt: skip
    return made


Variable = tuple[str, Floats, tuple[Floats, Floats], bool]
"""Words of the axis, values, ends of the intervals, whether the axis is logarithmic."""


def _draw_pair(axes: Axes, x: Variable, y: Variable, shown: list[style.Look]) -> None:
    good = np.isfinite(x[1]) & np.isfinite(y[1])
    for variable in (x, y):
        if variable[3]:
            good &= variable[1] > 0
    axes.set_xlabel(x[0])
    axes.set_ylabel(y[0])
    if not good.any():
        canvas.notice(axes, "no rotor has both")
        return
    limits = [_limits(variable, good) for variable in (x, y)]
    size = 18.0 if good.sum() <= CROWD else 7.0
    for look in style.BEHAVIOURS.values():
        own = good & np.array([other is look for other in shown], bool)
        if not own.any():
            continue
        bars: dict[str, Any] = {"color": look.colour, "lw": 0.6, "alpha": 0.6}
        ends = [np.clip(end[own], *limits[0]) for end in x[2]]
        axes.hlines(y[1][own], *ends, **bars)
        ends = [np.clip(end[own], *limits[1]) for end in y[2]]
        axes.vlines(x[1][own], *ends, **bars)
        axes.scatter(x[1][own], y[1][own], s=size, marker=look.marker, color=look.colour, lw=0)
    if not y[3]:
        axes.axhline(0, color=style.PALE, lw=0.8, zorder=0)
    for variable, (low, high), axis, name in (
        (x, limits[0], axes.xaxis, "x"), (y, limits[1], axes.yaxis, "y"),
    ):  # fmt: skip
        if variable[3]:
            axes.set(**{f"{name}scale": "log"})
            canvas.log_ticks(axis, low, high)
        else:
            axis.set_major_locator(MaxNLocator(6))
        axes.set(**{f"{name}lim": (low, high)})


def _limits(variable: Variable, good: NDArray[np.bool_]) -> tuple[float, float]:
    """Show all values, and intervals unless they are far wider than the others."""
    _, values, (low, high), logarithmic = variable
    values, low, high = values[good], low[good], high[good]
    if logarithmic:
        least = max(float(low.min()), float(values.min()) / 10)
        most = min(float(high.max()), float(values.max()) * 10)
        widen = max(1.15, math.sqrt(_LEAST_RATIO * least / most))
        return least / widen, most * widen
    beyond = max(float(np.ptp(values)) / 2, 1.5 * float(np.median(high - low)))
    left = max(float(low.min()), float(values.min()) - beyond)
    right = min(float(high.max()), float(values.max()) + beyond)
    spare = max(0.05 * (right - left), 1e-3 * float(np.abs(values).max()), 1e-9)
    return left - spare, right + spare
