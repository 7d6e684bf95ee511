"""Rods in an image of an atomic force microscope: traced, their lengths and their stiffness."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, MaxNLocator

from rotortrack.afm.persistence import Persistence
from rotortrack.afm.trace import Traced
from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.report.figures.labels import LABEL_SIZE, place_labels

_SIDE_IN = 5.6
_PANEL_IN = 3.5
_NUMBER_MARK = 5.0
_MOST_PIXELS = 1200


@canvas.in_house_style
def figure(traced: Traced) -> Figure:
    """Draw the levelled image with all lines, and of kept rods lengths and tangent correlation."""
    rows, columns = traced.level_nm.shape
    scale = _SIDE_IN / max(rows, columns)
    width, height = columns * scale, rows * scale
    page = max(height, 4.6)
    made = canvas.new_figure(width + _PANEL_IN + 2.2, page + 1.1)
    kept = traced.rods[traced.rods["verdict"] == "kept"]
    canvas.heading(made, _title(traced, len(kept)), 0.2)
    image = canvas.place(made, 0.75, 0.55 + (page - height) / 2.0, width, height)
    left, panel = width + 1.75, (page - 1.3) / 2.0
    lengths = canvas.place(made, left, 0.55 + panel + 1.3, _PANEL_IN, panel - 0.2)
    stiffness = canvas.place(made, left, 0.55, _PANEL_IN, panel - 0.2)
    _draw_image(image, traced, (72.0 * width, 72.0 * height))
    _draw_lengths(lengths, kept)
    _draw_stiffness(stiffness, traced.persistence)
    return made


def _title(traced: Traced, kept: int) -> str:
    refused = len(traced.rods) - kept
    told = words.count(kept, "rod") + (f", {refused} refused" if refused else "")
    if traced.scale:
        told += f"; lengths × {words.plus_minus(traced.scale.factor, traced.scale.sd, '')}"
    return told


def _draw_image(axes: Axes, traced: Traced, page: tuple[float, float]) -> None:
    """Draw heights dark on white, rods in colour, each with its number and reason."""
    level, size_um = traced.level_nm, 1e-3 * traced.pixel_size_nm
    rows, columns = level.shape
    kept_heights = traced.rods.loc[traced.rods["verdict"] == "kept", "height_nm"]
    top = float(kept_heights.median()) if len(kept_heights) else float(np.quantile(level, 0.995))
    # Half of the map's range, so that coloured lines stand out.
    step = max(1, max(rows, columns) // _MOST_PIXELS)
    axes.imshow(
        level[::step, ::step],
        cmap=style.IMAGE_MAP,
        vmin=-2.0 * traced.noise_nm,
        vmax=2.0 * max(top, 4.0 * traced.noise_nm),
        extent=(0.0, columns * size_um, rows * size_um, 0.0),
        interpolation="nearest",
    )
    for name, look in style.VERDICTS.items():
        of_it = np.flatnonzero((traced.rods["verdict"] == name).to_numpy())
        lines = [1e-3 * line for number in of_it for line in traced.lines_nm[number]]
        drawn = LineCollection(lines, colors=look.colour, linestyles=look.line, linewidths=1.0)
        axes.add_collection(drawn, autolim=False)
        axes.plot([], [], color=look.colour, ls=look.line, label=look.label)
    axes.set_xlim(0.0, columns * size_um)
    axes.set_ylim(rows * size_um, 0.0)
    axes.spines[["top", "right"]].set_visible(True)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(6))
        axis.set_major_formatter(FuncFormatter(lambda value, _: words.minus(f"{value:g}")))
    axes.set_xlabel("x (µm)")
    axes.set_ylabel("y (µm)")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
    _draw_numbers(axes, traced, page)


def _draw_numbers(axes: Axes, traced: Traced, page: tuple[float, float]) -> None:
    """Write the number of each rod, and the reason behind it, where there is room."""
    rods = traced.rods
    if not len(rods):
        return
    reasons = [reason.replace("_", " ") for reason in rods["reason"]]
    labels = [
        f"{number} {reason}".strip() for number, reason in zip(rods["rod"], reasons, strict=True)
    ]
    size_nm = traced.pixel_size_nm * np.array(traced.level_nm.shape[::-1])
    at = rods[["x_nm", "y_nm"]].to_numpy(np.float64) / size_nm * page
    # Points without a label, behind all that have one, keep labels off the lines.
    lines = [_spaced(line / size_nm * page) for own in traced.lines_nm for line in own]
    all_at = np.concatenate([at, *lines])
    texts = labels + [""] * (len(all_at) - len(at))
    anchors = place_labels(all_at[:, 0], all_at[:, 1], texts, mark=_NUMBER_MARK, page=page)
    halo = [withStroke(linewidth=1.5, foreground="white")]
    for k, anchor in enumerate(anchors[: len(labels)]):
        if anchor is None:
            continue
        x, y = at[k] + anchor
        axes.text(
            x / page[0],
            1.0 - y / page[1],
            labels[k],
            transform=axes.transAxes,
            ha="center",
            va="center",
            fontsize=LABEL_SIZE,
            color=style.verdict(rods["verdict"].iloc[k]).colour,
            path_effects=halo,
        )


def _spaced(line: Floats) -> Floats:
    """Thin a line to points about half a marker apart."""
    length = float(np.hypot(*np.diff(line, axis=0).T).sum()) if len(line) > 1 else 0.0
    count = max(int(2.0 * length / _NUMBER_MARK), 1)
    return np.asarray(line[np.linspace(0, len(line) - 1, count + 1).round().astype(int)])


def _draw_lengths(axes: Axes, kept: pd.DataFrame) -> None:
    """Draw how long kept rods are, along themselves and from end to end."""
    axes.set_xlabel("length (nm)")
    axes.set_ylabel("rods")
    if not len(kept):
        canvas.notice(axes, "no rods")
        canvas.caption(axes, "lengths")
        return
    contour = kept["contour_nm"].to_numpy(np.float64)
    apart = kept["end_to_end_nm"].to_numpy(np.float64)
    low, high = float(apart.min()), float(max(contour.max(), apart.max()))
    width = canvas.nice(max((high - low) / 12.0, 1e-3 * high))
    edges = width * np.arange(math.floor(low / width), math.floor(high / width) + 2)
    bins = edges.tolist()
    axes.hist(apart, bins, color=style.SKY, edgecolor="white", lw=0.4, label="end to end")
    axes.hist(
        contour, bins, histtype="step", color=style.VERMILLION, lw=1.2, label="along the contour"
    )
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    sd = float(contour.std(ddof=1)) if len(contour) > 1 else math.nan
    mean = words.plus_minus(float(contour.mean()), sd, "nm")
    canvas.caption(axes, f"contour {mean}" + (" (mean ± sd)" if sd > 0.0 else ""))


def _draw_stiffness(axes: Axes, stiff: Persistence | None) -> None:
    """Draw the tangent correlation, and that of the persistence length found."""
    axes.set_xlabel("lag along the rod (nm)")
    axes.set_ylabel("⟨cos Δθ⟩")
    if stiff is None or not len(stiff.lag_nm):
        canvas.notice(axes, "no rod of two segments")
        canvas.caption(axes, "tangent correlation")
        return
    lag, mean, sd = stiff.lag_nm, stiff.correlation, stiff.correlation_sd
    axes.errorbar(lag, mean, yerr=sd, fmt="o", ms=3, lw=0.9, color=style.BLUE, label="measured")
    at = np.linspace(0.0, 1.04 * float(lag[-1]), 60)
    axes.plot(
        at, _model(at, stiff.persistence_nm), color=style.VERMILLION, lw=1.1, label="exp(−s / 2P)"
    )
    axes.fill_between(
        at,
        _model(at, stiff.ci_low_nm),
        _model(at, stiff.ci_high_nm),
        color=style.VERMILLION,
        alpha=0.18,
        lw=0,
    )
    axes.set_xlim(0.0, at[-1])
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    canvas.caption(axes, _persistence(stiff))


def _model(lag: Floats, persistence_nm: float) -> Floats:
    return np.asarray(np.exp(-lag / (2.0 * persistence_nm)))


def _persistence(stiff: Persistence) -> str:
    low = _round(stiff.ci_low_nm)
    if stiff.is_limit:
        return f"persistence length above {low} nm (97.5 %)"
    return (
        f"persistence length {_round(stiff.persistence_nm)} nm (95 %: {low} to "
        f"{_round(stiff.ci_high_nm)})"
    )


def _round(value: float) -> str:
    """Write three digits without an exponent."""
    return (
        f"{round(value, 2 - math.floor(math.log10(value))):.0f}" if value >= 100 else f"{value:.3g}"
    )
