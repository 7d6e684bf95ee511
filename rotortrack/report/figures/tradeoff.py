"""Error against time of the settings of a dial, one panel a situation."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from rotortrack.report import style
from rotortrack.report.figures import canvas
from rotortrack.report.figures.labels import LABEL_SIZE, place_labels

_WIDE, _HIGH = 2.35, 1.9
_LEFT, _ACROSS = 0.9, 0.75
_UP, _FOOT, _TOP = 0.85, 0.55, 0.75
_LINE = 0.17
_MOST_A_ROW = 3
_DECADES = 0.35
"""Least half of an axis, powers of ten, so that differences of per cents do not fill a panel."""


@canvas.in_house_style
def figure(answer: Mapping[str, Any], title: str) -> Figure:
    """Draw an answer.

    Settings are numbered, so that their names cannot overlap; the names stand below. The line is
    the Pareto front, the default is circled, the dashed line is the bound.

    Parameters
    ----------
    answer
        Values of `rotortrack.tradeoff.point.Answer`, numbers that are none being None.
    title
        What the question is about.

    Returns
    -------
    Figure
    """
    points = [point for point in answer["points"] if _is_drawn(point)]
    groups = list(dict.fromkeys(point["group"] for point in answer["points"]))
    settings = list(dict.fromkeys(point["setting"] for point in answer["points"]))
    columns = min(len(groups), _MOST_A_ROW)
    rows = math.ceil(len(groups) / columns)
    width = _LEFT + columns * _WIDE + (columns - 1) * _ACROSS + 0.2
    key = _key(settings, [p for p in answer["points"] if not _is_drawn(p)], width)
    foot = _FOOT + _LINE * len(key) + 0.15
    height = foot + rows * _HIGH + (rows - 1) * _UP + _TOP
    made = canvas.new_figure(width, height)
    canvas.heading(made, title, 0.2)
    made.text(
        0.2 / width,
        1.0 - 0.34 / height,
        "circled: default; line: Pareto front; dashed: bound",
        va="top",
        fontsize=7.5,
        color=style.GREY,
    )
    for number, group in enumerate(groups):
        row, column = divmod(number, columns)
        axes = canvas.place(
            made,
            _LEFT + column * (_WIDE + _ACROSS),
            foot + (rows - 1 - row) * (_HIGH + _UP),
            _WIDE,
            _HIGH,
        )
        own = [point for point in points if point["group"] == group]
        _panel(axes, own, settings, answer["bounds"].get(group))
        axes.set_title(group, fontsize=8.5, loc="left")
        if column == 0:
            axes.set_ylabel("\n".join(textwrap.wrap(answer["error_unit"], 34)), fontsize=7.5)
        if number + columns >= len(groups):
            lines = textwrap.wrap(answer["seconds_unit"], 40)
            axes.set_xlabel("\n".join(lines), fontsize=7.5)
    for number, line in enumerate(key):
        up = 0.1 + _LINE * (len(key) - 1 - number)
        made.text(0.2 / width, up / height, line, va="bottom", fontsize=7.5)
    return made


def _is_drawn(point: Mapping[str, Any]) -> bool:
    return not point["failed"] and point["error"] is not None and point["error"] >= 0.0


def _key(
    settings: Sequence[str], missing: Sequence[Mapping[str, Any]], width_in: float
) -> list[str]:
    """List the settings by their numbers, and what failed."""
    words = "   ".join(
        f"{number}:\u00a0{name.replace(' ', chr(160))}" for number, name in enumerate(settings, 1)
    )
    letters = int(width_in * 14.5)
    lines = textwrap.wrap(words, letters)
    for point in missing:
        reason = point["failed"] or "not measured"
        lines += textwrap.wrap(
            f"not shown: {point['setting']}, {point['group']} ({reason})", letters
        )
    return lines


def _panel(
    axes: Axes,
    points: Sequence[Mapping[str, Any]],
    settings: Sequence[str],
    bound: float | None,
) -> None:
    """Draw the points of one situation with their front."""
    if not points:
        canvas.notice(axes, "nothing could be measured")
        return
    shown = [point["error"] for point in points if point["error"] > 0.0]
    # What shows no error at all stands at the lower edge.
    least = min([*shown, *([bound] if bound else [])], default=1.0)
    floor = least if len(shown) == len(points) else 0.3 * least
    seconds = np.array([point["seconds"] for point in points])
    errors = np.array([max(point["error"], floor) for point in points])
    low = np.array([max(point["error_low"], 0.5 * floor) for point in points])
    high = np.array([max(point["error_high"], floor) for point in points])
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.errorbar(
        seconds,
        errors,
        yerr=[np.maximum(errors - low, 0.0), np.maximum(high - errors, 0.0)],
        fmt="none",
        ecolor=style.GREY,
        elinewidth=0.8,
    )
    axes.plot(seconds, errors, "o", color=style.BLUE, markersize=4.0, zorder=3)
    chosen = np.array([point["is_default"] for point in points])
    axes.plot(
        seconds[chosen],
        errors[chosen],
        "o",
        markersize=9.5,
        markerfacecolor="none",
        markeredgecolor=style.VERMILLION,
        zorder=4,
    )
    front = _front(seconds, errors)
    axes.plot(seconds[front], errors[front], color=style.BLUE, linewidth=0.9, zorder=2)
    if bound:
        axes.axhline(bound, color=style.INK, linewidth=0.9, linestyle="--")
    axes.set_xlim(*_range(seconds))
    axes.set_ylim(*_range(np.concatenate([low, high, [bound] if bound else []])))
    canvas.log_ticks(axes.xaxis, *axes.get_xlim(), wide=1.6)
    canvas.log_ticks(axes.yaxis, *axes.get_ylim())
    _number(axes, seconds, errors, [str(settings.index(p["setting"]) + 1) for p in points])


def _front(seconds: canvas.Floats, errors: canvas.Floats) -> list[int]:
    """Give the rows that no other beats in both, cheapest first."""
    front: list[int] = []
    for row in np.lexsort((errors, seconds)).tolist():
        if not front or errors[row] < errors[front[-1]]:
            front.append(row)
    return front


def _range(values: canvas.Floats) -> tuple[float, float]:
    """Give limits around positive values, wide enough on a logarithmic axis."""
    low, high = math.log10(values.min()), math.log10(values.max())
    middle, half = 0.5 * (low + high), max(0.58 * (high - low), _DECADES)
    return 10.0 ** (middle - half), 10.0 ** (middle + half)


def _number(axes: Axes, x: canvas.Floats, y: canvas.Floats, numbers: list[str]) -> None:
    """Write the numbers of the settings beside their points, where there is room."""
    pixels = axes.transData.transform(np.column_stack([x, y])) * 72.0 / style.DPI
    box = axes.get_window_extent()
    page = (box.width * 72.0 / style.DPI, box.height * 72.0 / style.DPI)
    across = pixels[:, 0] - box.x0 * 72.0 / style.DPI
    down = box.y1 * 72.0 / style.DPI - pixels[:, 1]
    anchors = place_labels(across, down, numbers, mark=12.0, page=page)
    for at, number, anchor in zip(zip(x, y, strict=True), numbers, anchors, strict=True):
        if anchor is not None:
            axes.annotate(
                number,
                at,
                xytext=(anchor[0], -anchor[1]),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=LABEL_SIZE + 0.5,
                path_effects=[withStroke(linewidth=1.5, foreground="white")],
                zorder=5,
            )
