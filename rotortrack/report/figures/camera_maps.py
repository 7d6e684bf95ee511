"""The maps of a calibrated camera, each with its histogram."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator
from numpy.typing import NDArray

from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats

_SHOWN = (0.005, 0.995)
_SIDE = 3.0
_BINS = 60
_PANEL = 4.6


@canvas.in_house_style
def figure(
    *,
    offset_adu: Floats,
    gain_e_per_adu: Floats,
    read_noise_e: Floats,
    hot_pixels: NDArray[np.bool_],
    dead_pixels: NDArray[np.bool_],
    hot_limit_e: float,
    made_from: str,
) -> Figure:
    """Draw offset, gain, read noise, and where hot and dead pixels lie.

    Parameters
    ----------
    offset_adu, gain_e_per_adu, read_noise_e, hot_pixels, dead_pixels
        (y, x) maps.
    hot_limit_e
        Read noise above which pixels are hot.
    made_from
        What the maps were made from, for the heading.
    """
    height, width = offset_adu.shape
    # A long strip is drawn as one, though not thinner than can be seen.
    tall = _SIDE * float(np.clip(height / width, 0.15, 1.0))
    wide = _SIDE * float(np.clip(width / height, 0.15, 1.0))
    row = tall + 2.15
    made = canvas.new_figure(2 * _PANEL + 0.15, 2 * row + 0.45)
    canvas.heading(
        made, words.wrap(f"Camera of {width} x {height} pixels: {made_from}", 95, 2), 0.2
    )
    alive = ~dead_pixels
    panels = (
        ("Offset", offset_adu, "ADU"),
        ("Gain", gain_e_per_adu, "electrons per ADU"),
        ("Read noise", read_noise_e, "electrons rms"),
    )
    for place, (title, values, unit) in enumerate(panels):
        image, bars = _panel(made, place, row, (wide, tall))
        limits = _limits(values[alive & ~hot_pixels])
        _draw_map(image, np.where(alive, values, np.nan), limits)
        _draw_histogram(bars, values[alive], limits, f"{title.lower()} ({unit})")
        image.set_title(f"{title}: median {_median(values, alive)} {unit}")
    image, bars = _panel(made, 3, row, (wide, tall))
    _draw_marks(image, hot_pixels, dead_pixels)
    _draw_tail(bars, read_noise_e[alive], hot_limit_e)
    image.set_title(
        f"{words.count(int(hot_pixels.sum()), 'hot pixel')} ({hot_pixels.mean():.2%}), "
        f"{words.count(int(dead_pixels.sum()), 'dead pixel')}"
    )
    return made


def _panel(made: Figure, place: int, row: float, size: tuple[float, float]) -> tuple[Axes, Axes]:
    """Place a map and the axes of its histogram below."""
    left = 0.75 + _PANEL * (place % 2)
    bottom = 0.5 + row * (1 - place // 2)
    wide, tall = size
    bars = canvas.place(made, left, bottom, _SIDE, 0.65)
    image = canvas.place(made, left, bottom + 1.2, wide, tall)
    return image, bars


def _median(values: Floats, alive: NDArray[np.bool_]) -> str:
    return f"{float(np.median(values[alive])):.4g}" if alive.any() else "unknown"


def _limits(values: Floats) -> tuple[float, float]:
    """Choose limits that leave out the outliers; equal values get some room."""
    if not values.size:
        return 0.0, 1.0
    low, high = map(float, np.quantile(values, _SHOWN))
    room = max(0.02 * (high - low), 1e-3 * abs(high), 1e-9)
    return low - room, high + room


def _draw_map(axes: Axes, values: Floats, limits: tuple[float, float]) -> None:
    """Draw a map with the scale of its colours at the right."""
    low, high = limits
    height, width = values.shape
    axes.imshow(
        values,
        cmap=style.COUNTS_MAP,
        vmin=low,
        vmax=high,
        extent=(0, width, height, 0),
        interpolation="antialiased",
        aspect="auto",
    )
    _frame(axes)
    side = axes.inset_axes((1.0 + 0.1 / _width_in(axes), 0.0, 0.12 / _width_in(axes), 1.0))
    side.imshow(
        np.linspace(low, high, 128)[:, None],
        cmap=style.COUNTS_MAP,
        extent=(0, 1, low, high),
        origin="lower",
        aspect="auto",
    )
    side.set_xticks([])
    side.spines[["top", "right"]].set_visible(True)
    side.yaxis.tick_right()
    side.yaxis.set_major_locator(MaxNLocator(4))
    side.yaxis.set_major_formatter(_plain)


def _width_in(axes: Axes) -> float:
    made = axes.get_figure(root=True)
    return float(axes.get_position().width * made.get_figwidth()) if made else 1.0


def _frame(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(True)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4, integer=True))
    axes.set_xlabel("x (px)")
    axes.set_ylabel("y (px)")


def _draw_histogram(axes: Axes, values: Floats, limits: tuple[float, float], label: str) -> None:
    """Draw the histogram within the limits of the map, and say what lies beyond."""
    low, high = limits
    counts, edges = np.histogram(values, _BINS, (low, high))
    _bars(axes, counts, edges, style.BLUE)
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.xaxis.set_major_formatter(_plain)
    beyond = len(values) - int(counts.sum())
    axes.set_xlabel(label + (f", {words.count(beyond, 'pixel')} beyond" if beyond else ""))


def _plain(value: float, _position: float | None = None) -> str:
    """Write a tick without an offset that is told elsewhere."""
    return words.minus(f"{value:.6g}")


def _bars(axes: Axes, counts: NDArray[np.int64], edges: Floats, colour: str) -> None:
    axes.stairs(counts, edges, fill=True, facecolor=colour)
    axes.set_ylim(0, 1.08 * max(1, int(counts.max(initial=0))))
    axes.set_ylabel("pixels")
    axes.yaxis.set_major_locator(NullLocator())
    axes.yaxis.set_label_coords(-0.04, 0.5)


def _draw_marks(axes: Axes, hot: NDArray[np.bool_], dead: NDArray[np.bool_]) -> None:
    """Mark hot and dead pixels where they lie."""
    height, width = hot.shape
    size = float(np.clip(60 / math.sqrt(1 + hot.sum() + dead.sum()), 0.7, 3.0))
    for mask, colour, marker in ((hot, style.VERMILLION, "s"), (dead, style.BLACK, "X")):
        y, x = np.nonzero(mask)
        axes.plot(x + 0.5, y + 0.5, marker, color=colour, ms=size, mew=0, rasterized=True)
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    _frame(axes)


def _draw_tail(axes: Axes, read_noise_e: Floats, limit_e: float) -> None:
    """Draw all read noise on logarithmic axes, with the limit of hot pixels."""
    values = read_noise_e[read_noise_e > 0]
    axes.set_xlabel("read noise (electrons rms), line: limit of hot pixels")
    if not values.size:
        canvas.notice(axes, "no noise")
        return
    ends = np.array([values.min(), values.max()])
    if math.isfinite(limit_e):
        ends = np.array([ends[0], max(ends[1], 1.2 * limit_e)])
    low, high = float(0.95 * ends[0]), float(1.05 * ends[1])
    edges = np.geomspace(low, high, _BINS + 1)
    if low < limit_e < high:
        # An edge of its own, so that no bar stands on both sides of it.
        edges = np.unique(np.append(edges, limit_e))
    counts, _ = np.histogram(values, edges)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for hot, colour in ((False, style.BLUE), (True, style.VERMILLION)):
        shown = np.where((edges[:-1] >= limit_e) == hot, counts, 0)
        axes.stairs(np.maximum(shown, 0.5), edges, baseline=0.5, fill=True, facecolor=colour)
    if math.isfinite(limit_e):
        axes.axvline(limit_e, color=style.INK, lw=0.8)
    axes.set_xlim(low, high)
    axes.set_ylim(0.5, 2 * max(1, int(counts.max())))
    canvas.log_ticks(axes.xaxis, low, high)
    axes.yaxis.set_major_locator(NullLocator())
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylabel("pixels (log)")
    axes.yaxis.set_label_coords(-0.04, 0.5)
