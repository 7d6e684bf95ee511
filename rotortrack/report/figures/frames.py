"""Consecutive frames of one rotor with its centre and positions (Fig. 2b)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from rotortrack.movies.movie import Movie
from rotortrack.report import style
from rotortrack.report.figures import canvas, columns
from rotortrack.report.figures.canvas import NothingToDrawError
from rotortrack.report.figures.columns import column

FRAMES = 20
_ACROSS = 10
_TILE_IN = 1.0
_GAP = 0.06
_HALF_NM = 500.0


@dataclass(frozen=True)
class Stretch:
    """Which frames and pixels of a movie show a rotor best.

    Attributes
    ----------
    rotor
        Its number.
    first
        The first of `FRAMES` frames.
    left_px, top_px, side_px
        A square around it, in pixels of the movie as it was read.
    """

    rotor: int
    first: int
    left_px: int
    top_px: int
    side_px: int


def choose(
    rotors: pd.DataFrame,
    tracks: pd.DataFrame,
    *,
    pixel_size_nm: float,
    shape_px: tuple[int, int],
    image_origin_px: tuple[int, int] = (0, 0),
) -> Stretch | None:
    """Choose the kept rotor whose tip moves fastest around, among those with 20 frames on end.

    Parameters
    ----------
    rotors, tracks
        Tables of the run.
    pixel_size_nm, shape_px, image_origin_px
        Pixels of the movie: their size, rows and columns, and (x, y) of the first on the sensor.
    """
    kept = columns.kept(rotors)
    radius = np.nan_to_num(column(kept, "radius_nm"))
    speed = np.nan_to_num(np.abs(column(kept, "omega_rad_s")))
    side = 2 * max(3, round(_HALF_NM / pixel_size_nm)) + 1
    if side > min(shape_px):
        return None
    for k in np.lexsort((-radius, -speed * radius)):
        row = kept.iloc[k]
        frame = tracks.loc[tracks["rotor"] == row["rotor"], "frame"].to_numpy(np.int64)
        runs = np.flatnonzero(frame[FRAMES - 1 :] - frame[: 1 - FRAMES] == FRAMES - 1)
        if len(runs) == 0 or not math.isfinite(row["x_nm"]):
            continue
        corner = [
            min(max(math.floor(row[name] / pixel_size_nm) - origin - side // 2, 0), size - side)
            for name, origin, size in (
                ("x_nm", image_origin_px[0], shape_px[1]),
                ("y_nm", image_origin_px[1], shape_px[0]),
            )
        ]
        return Stretch(int(row["rotor"]), int(frame[runs[0]]), corner[0], corner[1], side)
    return None


def of_movie(
    movie: Movie,
    rotors: pd.DataFrame,
    tracks: pd.DataFrame,
    *,
    pixel_size_nm: float,
    frame_interval_s: float,
) -> Figure:
    """Choose a rotor, read its frames and draw them.

    Raises
    ------
    NothingToDrawError
        No kept rotor was seen in 20 frames on end.
    MovieError
        The frames cannot be read.
    """
    stretch = choose(
        rotors, tracks, pixel_size_nm=pixel_size_nm, shape_px=movie.shape[1:],
        image_origin_px=movie.origin_px,
    )  # fmt: skip
    if stretch is None:
        raise NothingToDrawError(f"no kept rotor was seen in {FRAMES} frames on end")
    start = stretch.first - movie.first_frame
    if movie.numbers is not None:
        start = int(np.searchsorted(movie.numbers, stretch.first))
    left, top, side = stretch.left_px, stretch.top_px, stretch.side_px
    pixels = movie.frames(start, start + FRAMES)[:, top : top + side, left : left + side]
    return figure(
        pixels, stretch, rotors, tracks, pixel_size_nm=pixel_size_nm,
        frame_interval_s=frame_interval_s, image_origin_px=movie.origin_px,
    )  # fmt: skip


@canvas.in_house_style
def figure(
    pixels: ArrayLike,
    stretch: Stretch,
    rotors: pd.DataFrame,
    tracks: pd.DataFrame,
    *,
    pixel_size_nm: float,
    frame_interval_s: float,
    image_origin_px: tuple[int, int] = (0, 0),
) -> Figure:
    """Draw the frames dark = bright, with the centre as a cross and the position as a ring.

    Parameters
    ----------
    pixels
        Those of the stretch, (frame, y, x).
    stretch
        As `choose` gave it.
    rotors, tracks
        Tables of the run.
    pixel_size_nm, frame_interval_s
        Size of a pixel (nm) and time from frame to frame (s).
    image_origin_px
        (x, y) of the movie's first pixel on the sensor.

    Raises
    ------
    NothingToDrawError
        There are no pixels.
    """
    images = np.asarray(pixels, np.float64)
    if images.ndim != 3 or images.size == 0:
        raise NothingToDrawError("no frames of a rotor")
    number, side = len(images), images.shape[1]
    across = min(_ACROSS, number)
    down = -(-number // across)
    width, height = across * _TILE_IN, down * _TILE_IN
    page = max(width + 0.6, 6.4)
    made = canvas.new_figure(page, height + 1.1)
    axes = canvas.place(made, 0.3, 0.5, width, height)
    axes.set_axis_off()
    low, high = np.nanpercentile(images, 2), np.nanpercentile(images, 99.8)
    place = np.arange(number, dtype=np.float64)
    left, top = place % across * (1 + _GAP), place // across * (1 + _GAP)
    for k, image in enumerate(images):
        axes.imshow(
            image, cmap=style.IMAGE_MAP, vmin=low, vmax=max(high, low + 1e-9),
            extent=(left[k], left[k] + 1, top[k] + 1, top[k]), interpolation="nearest",
            aspect="auto",
        )  # fmt: skip
    row = rotors[rotors["rotor"] == stretch.rotor].iloc[0]
    unit = pixel_size_nm * side
    origin = tuple(
        (corner + first) * pixel_size_nm
        for corner, first in zip((stretch.left_px, stretch.top_px), image_origin_px, strict=True)
    )
    axes.plot(
        left + (row["x_nm"] - origin[0]) / unit, top + (row["y_nm"] - origin[1]) / unit, "+",
        color=style.VERMILLION, ms=8, mew=1.2,
    )  # fmt: skip
    own = tracks[(tracks["rotor"] == stretch.rotor)]
    own = own[(own["frame"] >= stretch.first) & (own["frame"] < stretch.first + number)]
    at = own["frame"].to_numpy(np.int64) - stretch.first
    axes.plot(
        left[at] + (column(own, "x_nm") - origin[0]) / unit,
        top[at] + (column(own, "y_nm") - origin[1]) / unit,
        "o", mfc="none", color=style.SKY, ms=5, mew=1.2,
    )  # fmt: skip
    _label(axes, left, top, unit, frame_interval_s)
    axes.set_xlim(-0.01, across * (1 + _GAP) - _GAP + 0.01)
    axes.set_ylim(down * (1 + _GAP) - _GAP + 0.01, -0.01)
    canvas.heading(
        made, f"Rotor {stretch.rotor}: frames {stretch.first} to {stretch.first + number - 1}", 0.3
    )
    made.legend(
        handles=[
            Line2D([], [], color=style.VERMILLION, marker="+", ls="none", ms=8, label="centre"),
            Line2D([], [], color=style.SKY, marker="o", mfc="none", ls="none", label="position"),
        ],
        loc="lower left", bbox_to_anchor=(0.2 / page, 0.03 / (height + 1.1)), ncols=2,
    )  # fmt: skip
    return made


def _label(
    axes: Axes, left: canvas.Floats, top: canvas.Floats, unit: float, frame_interval_s: float
) -> None:
    """Write the time of each frame since the first, and a scale bar into the last one."""
    halo = [withStroke(linewidth=1.8, foreground="white")]
    for k in range(len(left)):
        axes.text(
            left[k] + 0.05, top[k] + 0.06, f"{1e3 * k * frame_interval_s:.4g} ms", va="top",
            fontsize=6.5, path_effects=halo,
        )  # fmt: skip
    bar = 200.0 if unit > 700 else 100.0
    right, bottom = left[-1] + 0.94, top[-1] + 0.93
    axes.plot([right - bar / unit, right], [bottom, bottom], color=style.BLACK, lw=2.5)
    axes.text(
        right, bottom - 0.05, f"{bar:.0f} nm", ha="right",
        va="bottom", fontsize=6.5, path_effects=halo,
    )  # fmt: skip
