"""Positions of all kept rotors side by side, on one scale, with their circles (Fig. 2c, many)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from rotortrack.report import style, words
from rotortrack.report.figures import canvas, columns, heatmap
from rotortrack.report.figures.canvas import Floats, NothingToDrawError
from rotortrack.report.figures.columns import column

MOST_ROTORS = 400
_TILE_IN = 0.95
_LABEL_SHARE = 0.3
_LEAST_SIDE_NM = 260.0
_MOST_SIDE_NM = 700.0
_PIXELS = 44


@canvas.in_house_style
def figure(rotors: pd.DataFrame, localisations: Mapping[int, pd.DataFrame]) -> Figure:
    """Draw a tile a rotor, ordered by behaviour and, within it, by speed.

    Parameters
    ----------
    rotors
        The rotors table; refused ones and those without a centre are left out.
    localisations
        Their rows of the localisations by rotor number.

    Raises
    ------
    NothingToDrawError
        No kept rotor has a centre.
    """
    kept = columns.kept(rotors)
    x, y = column(kept, "x_nm"), column(kept, "y_nm")
    kept = kept[np.isfinite(x) & np.isfinite(y)]
    if len(kept) == 0:
        raise NothingToDrawError("no kept rotor has a centre")
    total = len(kept)
    kept = kept.iloc[_order(kept)[:MOST_ROTORS]]
    shown = columns.looks(kept)
    side = _side(kept)
    across = max(4, math.ceil(math.sqrt(1.3 * len(kept)))) if len(kept) > 3 else len(kept)
    down = math.ceil(len(kept) / across)
    width, height = across * _TILE_IN, down * _TILE_IN * (1 + _LABEL_SHARE)
    page = max(width + 0.6, 6.2)
    made = canvas.new_figure(page, height + 1.35)
    axes = canvas.place(made, (page - width) / 2, 0.85, width, height)
    axes.set_axis_off()
    _draw_maps(axes, kept, localisations, across, side)
    _draw_circles(axes, kept, across, side)
    _label(axes, kept, across)
    axes.set_xlim(0, across)
    axes.set_ylim(down * (1 + _LABEL_SHARE), 0)
    remark = f"; the first {len(kept)} of {total}" if total > len(kept) else ""
    canvas.heading(
        made,
        words.wrap(
            f"Positions of {words.count(len(kept), 'rotor')}, tiles of {side:.0f} nm{remark}; "
            "speeds in rev/s",
            int(10.5 * page),
            2,
        ),
        0.3,
    )  # fmt: skip
    explained = columns.handles(shown)
    explained.append(Line2D([], [], color=style.VERMILLION, label="circle"))
    made.legend(
        handles=explained, loc="lower left", bbox_to_anchor=(0.2 / page, 0.05 / (height + 1.35)),
        ncols=max(2, min(5, int(page / 2))), columnspacing=1.2,
    )  # fmt: skip
    return made


def _order(kept: pd.DataFrame) -> NDArray[np.intp]:
    """Sort by behaviour, then from fast to slow, then by number."""
    ranks = {id(look): rank for rank, look in enumerate(style.BEHAVIOURS.values())}
    kind = np.array([ranks[id(look)] for look in columns.looks(kept)])
    speed = np.nan_to_num(np.abs(column(kept, "omega_rad_s")))
    return np.lexsort((kept["rotor"].to_numpy(), -speed, kind))


def _side(kept: pd.DataFrame) -> float:
    """Choose the tiles' side (nm), the same for all, so that sizes can be compared."""
    radius = column(kept, "radius_nm")
    radius = radius[np.isfinite(radius)]
    wanted = 2.9 * float(np.percentile(radius, 95)) if len(radius) else 0.0
    return float(np.clip(wanted, _LEAST_SIDE_NM, _MOST_SIDE_NM))


def _corners(number: int, across: int) -> tuple[Floats, Floats]:
    """Return left and upper ends of the maps, in tiles."""
    row, place = np.divmod(np.arange(number), across)
    return place.astype(np.float64), row * (1 + _LABEL_SHARE) + _LABEL_SHARE


def _draw_maps(
    axes: Axes,
    kept: pd.DataFrame,
    localisations: Mapping[int, pd.DataFrame],
    across: int,
    side: float,
) -> None:
    """Draw all maps in one image a row of tiles, each map scaled by its own peak."""
    pixel = side / _PIXELS
    left, top = _corners(len(kept), across)
    xc, yc = column(kept, "x_nm"), column(kept, "y_nm")
    numbers = kept["rotor"].to_numpy(np.int64)
    for first in range(0, len(kept), across):
        last = min(first + across, len(kept))
        strip = np.zeros((_PIXELS, (last - first) * _PIXELS))
        for k in range(first, last):
            number = int(numbers[k])
            if number not in localisations:
                continue
            x, y = heatmap.positions(localisations[number])
            counts = heatmap.counts(x - xc[k] + side / 2, y - yc[k] + side / 2, pixel, _PIXELS)
            start = (k - first) * _PIXELS
            strip[:, start : start + _PIXELS] = counts / max(counts.max(), 1)
        axes.imshow(
            np.ma.masked_equal(strip, 0), cmap=style.COUNTS_MAP, vmin=-0.2, vmax=1,
            extent=(0, last - first, top[first] + 1, top[first]), interpolation="nearest",
            aspect="auto",
        )  # fmt: skip
    rim = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], np.float64) * 0.98 + 0.01
    frames = np.stack([left, top], axis=1)[:, None, :] + rim
    axes.add_collection(LineCollection(list(frames), colors=style.PALE, linewidths=0.6))


def _draw_circles(axes: Axes, kept: pd.DataFrame, across: int, side: float) -> None:
    left, top = _corners(len(kept), across)
    radius = column(kept, "radius_fit_nm")
    radius = np.where(np.isfinite(radius), radius, column(kept, "radius_nm"))
    fits = np.isfinite(radius) & (2 * radius < side)
    width = 2 * radius[fits] / side
    axes.add_collection(
        EllipseCollection(
            width, width, np.zeros(len(width)), units="xy", facecolors="none",
            offsets=np.stack([left[fits] + 0.5, top[fits] + 0.5], axis=1),
            offset_transform=axes.transData, edgecolors=style.VERMILLION, linewidths=0.9,
        )
    )  # fmt: skip


def _label(axes: Axes, kept: pd.DataFrame, across: int) -> None:
    """Write number and speed above each tile, beside the behaviour's marker."""
    left, top = _corners(len(kept), across)
    shown = columns.looks(kept)
    for k, row in enumerate(kept.to_dict("records")):
        speed, sd = words.rev_per_s(row)
        value = words.plus_minus(speed, sd, "", signed=True).replace(" ", "")
        axes.plot(left[k] + 0.07, top[k] - 0.1, shown[k].marker, color=shown[k].colour, ms=4, mew=0)
        axes.text(
            left[k] + 0.15, top[k] - 0.1, f"{int(row['rotor'])}:  {value}"
            if math.isfinite(speed) else str(int(row["rotor"])), fontsize=5.5, va="center_baseline",
        )  # fmt: skip
