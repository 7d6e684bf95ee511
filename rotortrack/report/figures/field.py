"""Field overview: where the rotors are, which were kept, and their numbers."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import ArrayLike, NDArray

from rotortrack.errors import UsageError
from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.report.figures.labels import LABEL_SIZE, MARK_SIZE, place_labels, points_per_unit

LEAST_WIDTH_IN = 7.0
MOST_WIDTH_IN = 30.0
RESOLVED_NM = 1000.0
"""Numbers of rotors this far apart never overlap: the page grows until they do not."""


@canvas.in_house_style
def figure(
    rotors: pd.DataFrame,
    localisations: pd.DataFrame,
    *,
    image: ArrayLike | None = None,
    pixel_size_nm: float | None = None,
    image_origin_px: tuple[int, int] = (0, 0),
) -> Figure:
    """Draw the field with the rotors' circles and numbers.

    Parameters
    ----------
    rotors
        The rotors table; those without a centre cannot be drawn and are counted in the title.
    localisations
        All localisations: their density is the ground when there is no image.
    image
        Mean or maximum image of the movie, (y, x); shown dark = bright.
    pixel_size_nm
        Size of its pixels (nm); needed with an image.
    image_origin_px
        (x, y) of the image's first pixel on the sensor.

    Raises
    ------
    UsageError
        An image without a pixel size.
    """
    ground, (left, right, top, bottom), ground_words = _ground(
        localisations, rotors, image, pixel_size_nm, image_origin_px
    )
    x, y = _column(rotors, "x_nm"), _column(rotors, "y_nm")
    placed = np.isfinite(x) & np.isfinite(y)
    shown = rotors[placed]
    x, y = x[placed], y[placed]
    numbers = [str(number) for number in shown["rotor"].astype(np.int64)]
    across, down = right - left, bottom - top
    scale = points_per_unit(x, y, numbers, RESOLVED_NM)
    width = min(max(LEAST_WIDTH_IN, scale * across / 72), MOST_WIDTH_IN)
    height = width * down / across
    if height > MOST_WIDTH_IN:
        width, height = MOST_WIDTH_IN * across / down, MOST_WIDTH_IN
    page = max(width, 4.6)
    made = canvas.new_figure(page + 1.1, height + 1.6)
    axes = canvas.place(made, 0.75, 1.0, width, height)
    axes.imshow(
        ground,
        cmap=style.IMAGE_MAP,
        vmin=float(np.nanpercentile(ground, 1)),
        vmax=max(float(np.nanpercentile(ground, 99.8)) * 1.15, 1e-9),
        extent=(left, right, bottom, top),
        origin="upper",
        interpolation="nearest",
        aspect="auto",
    )
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.spines[["top", "right"]].set_visible(True)
    left_out = _draw_rotors(axes, shown, x, y, numbers, 72 * width / across)
    for axis, size in ((axes.xaxis, width), (axes.yaxis, height)):
        axis.set_major_locator(MaxNLocator(max(2, min(10, int(1.5 * size)))))
        axis.set_major_formatter(FuncFormatter(lambda value, _: words.minus(f"{value / 1000:g}")))
    axes.set_xlabel("x (µm)")
    axes.set_ylabel("y (µm)")
    remarks = [words.count(len(rotors), "rotor") if len(rotors) else "no rotors", ground_words]
    if len(rotors) > len(shown):
        remarks.append(f"{len(rotors) - len(shown)} without a position not shown")
    if left_out:
        remarks.append(f"{words.count(left_out, 'number')} left out where rotors are too close")
    canvas.heading(made, words.wrap("; ".join(remarks), int(10.5 * (page + 0.8)), 2), 0.2)
    _legend(made, shown)
    return made


def _ground(
    localisations: pd.DataFrame,
    rotors: pd.DataFrame,
    image: ArrayLike | None,
    pixel_size_nm: float | None,
    origin_px: tuple[int, int],
) -> tuple[Floats, tuple[float, float, float, float], str]:
    """Return the picture beneath, its left, right, top, bottom (nm), and what it is."""
    if image is not None:
        if pixel_size_nm is None:
            raise UsageError("the field figure needs pixel_size_nm to place the image: give both")
        pixels = np.asarray(image, np.float64)
        rows, columns = pixels.shape
        left, top = origin_px[0] * pixel_size_nm, origin_px[1] * pixel_size_nm
        box = (left, left + columns * pixel_size_nm, top, top + rows * pixel_size_nm)
        finite = np.where(np.isfinite(pixels), pixels, 0.0)
        return finite, box, "image of the movie, dark = bright"
    xs = np.concatenate([_column(localisations, "x_nm"), _column(rotors, "x_nm")])
    ys = np.concatenate([_column(localisations, "y_nm"), _column(rotors, "y_nm")])
    good = np.isfinite(xs) & np.isfinite(ys)
    if not good.any():
        return np.zeros((2, 2)), (0.0, 10_000.0, 0.0, 10_000.0), "no localisations"
    spare = 500.0
    left, top = float(xs[good].min()) - spare, float(ys[good].min()) - spare
    side = max(float(xs[good].max()) - left, float(ys[good].max()) - top) + spare
    pixel = max(50.0, side / 1000)
    columns = math.ceil((float(xs[good].max()) + spare - left) / pixel)
    rows = math.ceil((float(ys[good].max()) + spare - top) / pixel)
    good[len(localisations) :] = False
    index = ((ys[good] - top) // pixel) * columns + (xs[good] - left) // pixel
    counts = np.bincount(index.astype(np.int64), minlength=rows * columns)
    # A rotor's spots pile up a thousandfold: the square root keeps the sparse ones visible.
    density = np.sqrt(counts.reshape(rows, columns).astype(np.float64))
    box = (left, left + columns * pixel, top, top + rows * pixel)
    return density, box, "square root of the density of localisations"


def _draw_rotors(
    axes: Axes, shown: pd.DataFrame, x: Floats, y: Floats, numbers: list[str], scale: float
) -> int:
    """Draw circles, markers and numbers; return how many numbers found no room."""
    radius = np.nan_to_num(_column(shown, "radius_nm"), nan=0.0, posinf=0.0)
    kinds = _verdicts(shown)
    # A fitted circle of 60 nm is a dot on a field of 20 um: a marker of fixed size surrounds it.
    marker_points = float(np.clip(0.4 * RESOLVED_NM * scale, 3.0, MARK_SIZE))
    for kind, look in style.VERDICTS.items():
        one = kinds == kind
        if not one.any():
            continue
        within = one & (radius > 0) & (radius < 2 * RESOLVED_NM)
        diameters = 2 * radius[within]
        circles = EllipseCollection(
            diameters,
            diameters,
            np.zeros(len(diameters)),
            units="xy",
            offsets=np.stack([x[within], y[within]], axis=1),
            offset_transform=axes.transData,
            facecolors="none",
            edgecolors=look.colour,
            linewidths=0.7,
            linestyles=look.line,
        )
        axes.add_collection(circles)
        axes.scatter(
            x[one],
            y[one],
            s=marker_points**2,
            marker=look.marker,
            facecolors="none",
            edgecolors=look.colour,
            linewidths=1.1,
            linestyles=look.line,
        )
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    anchors = place_labels(
        (x - left) * scale,
        (y - top) * scale,
        numbers,
        mark=marker_points,
        page=((right - left) * scale, (bottom - top) * scale),
    )
    halo = [withStroke(linewidth=1.6, foreground="white")]
    for i, anchor in enumerate(anchors):
        if anchor is not None:
            axes.annotate(
                numbers[i],
                (x[i], y[i]),
                xytext=(anchor[0], -anchor[1]),
                textcoords="offset points",
                ha="center",
                va="center_baseline",
                fontsize=LABEL_SIZE,
                color=style.VERDICTS[kinds[i]].colour,
                path_effects=halo,
                annotation_clip=True,
            )
    return sum(anchor is None for anchor in anchors)


def _legend(made: Figure, shown: pd.DataFrame) -> None:
    """Explain the marks below the field."""
    kinds = _verdicts(shown).tolist()
    handles = [
        Line2D(
            [],
            [],
            color=look.colour,
            marker=look.marker,
            ms=8,
            mfc="none",
            ls="none",
            label=f"{look.label} ({kinds.count(kind)})",
        )
        for kind, look in style.VERDICTS.items()
        if kind in kinds
    ]
    if handles:
        width, height = made.get_size_inches()
        anchor = (0.7 / width, 0.08 / height)
        made.legend(handles=handles, loc="lower left", ncols=2, bbox_to_anchor=anchor)


def _verdicts(rotors: pd.DataFrame) -> NDArray[np.str_]:
    if "verdict" not in rotors:
        return np.full(len(rotors), "kept")
    return np.array(["kept" if v == "kept" else "refused" for v in rotors["verdict"]], np.str_)


def _column(table: pd.DataFrame, name: str) -> Floats:
    if name not in table:
        return np.full(len(table), np.nan)
    return table[name].to_numpy(np.float64)
