"""Drift of the sample against frame number, with the bins it was estimated from."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from rotortrack.report import style, words
from rotortrack.report.figures import canvas

Bins = tuple[ArrayLike, ArrayLike, ArrayLike]


@canvas.in_house_style
def figure(drift: pd.DataFrame, *, bins: Bins | None = None) -> Figure:
    """Draw dx and dy (nm) against frame.

    Parameters
    ----------
    drift
        The drift table (frame, dx_nm, dy_nm, sd_nm); the sd, where known, is drawn as a band.
    bins
        Frames, dx (nm) and dy (nm) of the bins behind the smooth curve.
    """
    made = canvas.new_figure(6.4, 3.8)
    axes = canvas.place(made, 0.8, 0.55, 5.2, 2.6)
    axes.set_xlabel("frame")
    axes.set_ylabel("drift (nm)")
    frame = drift["frame"].to_numpy(np.float64)
    sd = drift["sd_nm"].to_numpy(np.float64) if "sd_nm" in drift else np.full(len(drift), np.nan)
    known = False
    spans = []
    lines = (("dx", 1, style.BLUE, "-", "o"), ("dy", 2, style.VERMILLION, "--", "s"))
    for name, place, colour, line, marker in lines:
        value = drift[f"{name}_nm"].to_numpy(np.float64)
        finite = np.isfinite(value)
        if finite.any():
            known = True
            spans.append(f"{name} {np.ptp(value[finite]):.0f} nm")
            axes.plot(*canvas.thin(frame, value), line, color=colour, lw=1.3, label=name)
            stride = max(1, len(frame) // 1000)
            low, high = (value - sd)[::stride], (value + sd)[::stride]
            if np.isfinite(low).any():
                axes.fill_between(frame[::stride], low, high, color=colour, alpha=0.2, lw=0)
        if bins is not None:
            axes.plot(
                np.asarray(bins[0]),
                np.asarray(bins[place]),
                marker,
                color=colour,
                ms=4,
                mfc="white",
                label=f"{name} of a bin",
            )
    if not known:
        canvas.heading(made, "Drift", 0.2)
        canvas.notice(axes, "no drift was estimated")
        return made
    canvas.heading(made, f"Drift: range of {', '.join(spans)}", 0.2)
    axes.axhline(0, color=style.PALE, lw=0.8, zorder=0)
    low, high = axes.get_ylim()
    if high - low < 1:
        axes.set_ylim((low + high) / 2 - 0.5, (low + high) / 2 + 0.5)
    axes.set_xlim(float(frame.min()) - 0.5, float(frame.max()) + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.xaxis.set_major_formatter(lambda value, _: words.minus(f"{value:.0f}"))
    made.legend(
        *axes.get_legend_handles_labels(),
        loc="upper left",
        bbox_to_anchor=(0.75 / 6.4, 3.5 / 3.8),
        ncols=4,
        columnspacing=1.4,
    )
    return made
