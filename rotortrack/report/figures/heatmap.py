"""Localisation heatmap of one rotor with its fitted circle, as Fig. 2c of the paper."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Annulus, Circle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from rotortrack.flags import FitFlag
from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.report.words import Row

PATH_POSITIONS = 20
_LONGEST_PATH_FRAMES = 60
SCALE_BAR_NM = 100.0


@canvas.in_house_style
def figure(localisations: pd.DataFrame, rotor: Row, track: pd.DataFrame | None = None) -> Figure:
    """Draw the heatmap of one rotor on its own.

    Parameters
    ----------
    localisations
        The rotor's rows of the localisations (x_nm, y_nm).
    rotor
        Its row of the rotors table; circle and speed may be nan.
    track
        Its rows of the tracks: 20 consecutive positions are drawn over the map.
    """
    made = canvas.new_figure(5.6, 5.4)
    canvas.heading(made, words.wrap(words.title(rotor), 60, 3), 0.2)
    draw(canvas.place(made, 0.8, 0.85, 3.7, 3.7), localisations, rotor, track)
    return made


def draw(
    axes: Axes,
    localisations: pd.DataFrame,
    rotor: Row,
    track: pd.DataFrame | None = None,
    *,
    bare: bool = False,
) -> None:
    """Draw the heatmap into square axes; a colour bar is put at their right.

    Positions are nm on the full sensor, y downwards as on the displayed image. A bare map has
    neither ticks nor legend nor colour bar.
    """
    x, y = positions(localisations)
    left, top, side = _window(x, y, rotor)
    pixel = max(0.5, canvas.nice(side / 50))
    pixels = math.ceil(side / pixel)
    seen = counts(x - left, y - top, pixel, pixels)
    most = float(max(seen.max(), 1))
    end = pixels * pixel
    image = axes.imshow(
        np.ma.masked_equal(seen, 0),
        cmap=style.COUNTS_MAP,
        # Below zero, so that a single spot is already coloured on the white paper.
        vmin=-0.2 * most,
        vmax=most,
        extent=(left, left + end, top + end, top),
        origin="upper",
        interpolation="nearest",
        aspect="equal",
    )
    axes.set_xlim(left, left + end)
    axes.set_ylim(top + end, top)
    _draw_path(axes, track)
    _draw_circle(axes, rotor)
    _draw_scale_bar(axes, left + 0.96 * end, top + 0.96 * end)
    axes.spines[["top", "right"]].set_visible(True)
    if bare:
        axes.set_xticks([])
        axes.set_yticks([])
        return
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4))
        axis.get_major_formatter().set_useOffset(False)  # type: ignore[attr-defined]
    axes.set_xlabel("x (nm)")
    axes.set_ylabel("y (nm)")
    radius = words.number(rotor, "radius_nm")
    fitted = words.plus_minus(radius, words.number(rotor, "radius_sd_nm"), "nm")
    axes.set_title(
        words.count(len(x), "localisation")
        + (f", radius {fitted}" if math.isfinite(radius) else ", no circle")
    )
    if len(x) == 0:
        axes.text(
            0.5,
            0.7,
            "no localisations",
            transform=axes.transAxes,
            ha="center",
            color=style.GREY,
        )
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=3, columnspacing=1.2)
    _draw_colour_bar(axes, image, f"localisations per ({pixel:g} nm)²")


def positions(localisations: pd.DataFrame) -> tuple[Floats, Floats]:
    """Return the finite positions that count: not the spare ones of a frame."""
    x = localisations["x_nm"].to_numpy(np.float64)
    y = localisations["y_nm"].to_numpy(np.float64)
    good = np.isfinite(x) & np.isfinite(y)
    if "fit_flags" in localisations:
        good &= (localisations["fit_flags"].to_numpy() & FitFlag.DUPLICATE.value) == 0
    return x[good], y[good]


def _window(x: Floats, y: Floats, rotor: Row) -> tuple[float, float, float]:
    """Choose left, top and side (nm) of a square that shows the spots and, if near, the circle.

    A short arc may be fitted by a huge, far circle: then the window follows the spots.
    """
    xc, yc = words.number(rotor, "x_nm"), words.number(rotor, "y_nm")
    radius = words.number(rotor, "radius_nm")
    centred = math.isfinite(xc) and math.isfinite(yc)
    least = 1.3 * SCALE_BAR_NM
    if len(x) == 0:
        x_mid, y_mid = (xc, yc) if centred else (0.0, 0.0)
        half = max(least, 1.3 * radius if math.isfinite(radius) else 0.0)
        return x_mid - half, y_mid - half, 2 * half
    x_mid, y_mid = float(np.median(x)), float(np.median(y))
    reach = float(np.percentile(np.hypot(x - x_mid, y - y_mid), 99))
    half = max(1.15 * reach, least)
    if centred and math.hypot(xc - x_mid, yc - y_mid) <= 2 * half:
        x_mid, y_mid = xc, yc
        reach = float(np.percentile(np.hypot(x - xc, y - yc), 99))
        wanted = 1.25 * radius if math.isfinite(radius) and radius < 3 * half else 0.0
        half = max(1.15 * reach, wanted, least)
    return x_mid - half, y_mid - half, 2 * half


def counts(across: Floats, down: Floats, pixel: float, pixels: int) -> Floats:
    """Count positions in square pixels."""
    column, row = np.floor(across / pixel), np.floor(down / pixel)
    inside = (column >= 0) & (column < pixels) & (row >= 0) & (row < pixels)
    index = row[inside].astype(np.int64) * pixels + column[inside].astype(np.int64)
    return np.bincount(index, minlength=pixels * pixels).reshape(pixels, pixels).astype(np.float64)


def _draw_colour_bar(axes: Axes, image: AxesImage, label: str) -> None:
    """Draw the scale of counts at the right of the map."""
    most = float(np.max(image.get_clim()))
    side = axes.inset_axes((1.04, 0.0, 0.035, 1.0))
    colours = np.linspace(0.0, most, 128)[:, None]
    side.imshow(
        colours,
        cmap=image.cmap,
        vmin=0.0,
        vmax=most,
        extent=(0, 1, 0, most),
        origin="lower",
        aspect="auto",
    )
    side.set_xticks([])
    side.spines[["top", "right"]].set_visible(True)
    side.yaxis.set_label_position("right")
    side.yaxis.tick_right()
    side.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    side.set_ylabel(label)


def _draw_circle(axes: Axes, rotor: Row) -> None:
    """Draw the fitted circle (± two sd) and its centre, each if it comes into view."""
    xc, yc = words.number(rotor, "x_nm"), words.number(rotor, "y_nm")
    # The circle that the positions lie on; the table's radius is corrected for motion blur.
    radius = words.number(rotor, "radius_fit_nm")
    if not math.isfinite(radius):
        radius = words.number(rotor, "radius_nm")
    if not (math.isfinite(xc) and math.isfinite(yc)):
        return
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    corner = math.hypot(max(xc - left, right - xc), max(yc - top, bottom - yc))
    nearest = math.hypot(max(left - xc, xc - right, 0), max(top - yc, yc - bottom, 0))
    if nearest < radius < corner:
        axes.add_patch(
            Circle((xc, yc), radius, fill=False, color=style.VERMILLION, lw=1.3, label="circle")
        )
        radius_sd = words.number(rotor, "radius_sd_nm")
        if 0 < 2 * radius_sd < radius:
            axes.add_patch(
                Annulus((xc, yc), radius + 2 * radius_sd, 4 * radius_sd, color=style.ORANGE,
                        alpha=0.5, lw=0)
            )  # fmt: skip
    if nearest == 0:
        _draw_centre(axes, xc, yc, rotor)


def _draw_centre(axes: Axes, xc: float, yc: float, rotor: Row) -> None:
    """Draw the centre with bars of two standard deviations; too short ones are only a cross."""
    x_sd, y_sd = (2 * np.nan_to_num(words.number(rotor, name)) for name in ("x_sd_nm", "y_sd_nm"))
    axes.errorbar([xc], [yc], xerr=[x_sd], yerr=[y_sd], fmt="none", ecolor=style.ORANGE,
                  elinewidth=4.0)  # fmt: skip
    axes.plot([xc], [yc], "+", color=style.VERMILLION, ms=11, mew=1.6, ls="none", label="centre")


def _draw_path(axes: Axes, track: pd.DataFrame | None) -> None:
    """Draw the first 20 positions of consecutive frames, or of as few frames as there are."""
    if track is None or len(track) < PATH_POSITIONS:
        return
    frames = track["frame"].to_numpy(np.int64)
    span = PATH_POSITIONS - 1
    lasted = frames[span:] - frames[:-span]
    start = int(np.argmin(lasted))
    if lasted[start] > _LONGEST_PATH_FRAMES:
        return
    some = track.iloc[start : start + PATH_POSITIONS]
    # No line across a gap: nobody knows which way the rotor went.
    gaps = np.flatnonzero(np.diff(frames[start : start + PATH_POSITIONS]) > 1) + 1
    axes.plot(
        np.insert(some["x_nm"].to_numpy(np.float64), gaps, np.nan),
        np.insert(some["y_nm"].to_numpy(np.float64), gaps, np.nan),
        "-o",
        color=style.INK,
        lw=0.6,
        ms=2.2,
        label=f"frames {frames[start]} to {frames[start + span]}",
    )


def _draw_scale_bar(axes: Axes, right: float, bottom: float) -> None:
    """Draw the bar of 100 nm in the lower right corner, where a circle leaves room."""
    axes.plot([right - SCALE_BAR_NM, right], [bottom, bottom], color=style.BLACK, lw=3)
    axes.annotate(
        "100 nm",
        (right - SCALE_BAR_NM / 2, bottom),
        xytext=(0, 4),
        textcoords="offset points",
        ha="center",
        va="bottom",
        color=style.BLACK,
        path_effects=[withStroke(linewidth=2.5, foreground="white")],
    )
