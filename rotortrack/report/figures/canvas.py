"""What all figures share: the look, sizes in inches, ticks, thinned traces, saving.

Only matplotlib's object interface is used. Its settings are global to the process, so drawing and
saving hold one lock while the house settings are in force and restore the caller's afterwards.
"""

from __future__ import annotations

import functools
import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator
from numpy.typing import NDArray

from rotortrack.files import atomic_path
from rotortrack.report import style

FileFormat = Literal["png", "svg", "pdf"]
Floats = NDArray[np.float64]

P = ParamSpec("P")
T = TypeVar("T")

_LOCK = threading.RLock()
_NO_DATES: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}


class NothingToDrawError(Exception):
    """A run lacks what a figure shows; the message is the reason."""


@contextmanager
def house_style() -> Iterator[None]:
    """Put matplotlib's defaults and `style.SETTINGS` in force for this block alone."""
    with _LOCK, matplotlib.rc_context():
        matplotlib.rcdefaults()
        settings: Any = style.SETTINGS
        matplotlib.rcParams.update(settings)
        yield


def in_house_style(draw: Callable[P, T]) -> Callable[P, T]:
    """Make a function draw under `house_style`."""

    @functools.wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> T:
        with house_style():
            return draw(*args, **kwargs)

    return styled


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure of this size, outside pyplot's registry."""
    figure = Figure(figsize=(width_in, height_in), dpi=style.DPI)
    FigureCanvasAgg(figure)
    return figure


def place(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Add axes whose box is given in inches from the lower left corner of the figure.

    Fixed margins instead of an automatic layout: each of those draws the figure twice.
    """
    full_width, full_height = figure.get_size_inches()
    axes = figure.add_axes(
        (left / full_width, bottom / full_height, width / full_width, height / full_height)
    )
    axes.xaxis.set_label_coords(0.5, -0.28 / height)
    axes.yaxis.set_label_coords(-0.56 / width, 0.5)
    return axes


def heading(figure: Figure, words: str, left_in: float, top_in: float = 0.12) -> None:
    """Write the figure's title at its upper left."""
    width, height = figure.get_size_inches()
    figure.text(
        left_in / width, 1 - top_in / height, words, va="top", ha="left", fontsize=10, weight="bold"
    )


def caption(axes: Axes, words: str) -> None:
    """Write a title with its legend, at most two entries, on a line of its own below it."""
    explained = bool(axes.get_legend_handles_labels()[1])
    axes.set_title(words, y=1.0 + (0.27 if explained else 0.07) / _height_in(axes))
    if explained:
        axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1, borderpad=0.2
        )


def _height_in(axes: Axes) -> float:
    figure = axes.get_figure(root=True)
    return 1.0 if figure is None else float(axes.get_position().height * figure.get_figheight())


def notice(axes: Axes, words: str) -> None:
    """Say in the middle of empty axes why they are empty, and take their ticks away."""
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", color=style.GREY)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(NullLocator())
        axis.set_minor_locator(NullLocator())


def save(figure: Figure, path: Path, file_format: FileFormat) -> None:
    """Write the figure; equal figures give equal bytes (no dates, salted identifiers)."""
    with house_style():
        # Level 3 writes twice as fast as the default of 6; the files are a tenth larger.
        fast: dict[str, Any] = {}
        if file_format == "png":
            fast["pil_kwargs"] = {"compress_level": 3}
        figure.savefig(path, format=file_format, metadata=_NO_DATES[file_format], **fast)


def save_as(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG file, whole or not at all.

    Raises
    ------
    ResourceError
        The file cannot be written.
    """
    with atomic_path(path) as temporary:
        save(figure, temporary, "png")


def thin(x: Floats, y: Floats, points: int = 1600) -> tuple[Floats, Floats]:
    """Thin a long trace to about `points` points that keep every bucket's least and greatest y.

    On paper the result looks like the whole trace, peaks included, whatever its length. Points
    that are not finite are left out first.
    """
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    width = len(y) // max(points // 2, 1)
    if width < 3:
        return x, y
    whole = len(y) // width * width
    buckets = y[:whole].reshape(-1, width)
    starts = np.arange(0, whole, width)
    extremes = np.stack([starts + buckets.argmin(axis=1), starts + buckets.argmax(axis=1)], axis=1)
    extremes.sort(axis=1)
    keep = np.unique(np.concatenate([[0], extremes.ravel(), [len(y) - 1]]))
    return x[keep], y[keep]


def nice(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above `value` > 0."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(m * power for m in (0.5, 1.0, 2.0, 5.0) if m * power <= value * (1 + 1e-9))


def thousands(largest: float) -> tuple[float, str]:
    """Return the power of 1000 that keeps tick labels short, and its words for an axis label."""
    if not math.isfinite(largest) or largest < 10_000:
        return 1.0, ""
    power = 3 * int(math.log10(largest) // 3)
    return 10.0**power, f"10{superscript(power)} "


def superscript(power: int) -> str:
    """Write an exponent in Unicode: plain text draws several times faster than mathtext."""
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def log_ticks(axis: Axis, low: float, high: float, *, wide: float = 2.5) -> None:
    """Put few, labelled ticks on a logarithmic axis between two positive limits.

    Beyond `wide` powers of ten only these are labelled.
    """
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    decades = math.log10(high / low)
    multiples = (1,) if decades > wide else (1, 2, 5) if decades > 0.7 else (1, 1.5, 2, 3, 5, 7)
    stride = max(1, math.ceil(decades / 6))
    ticks = [
        m * 10.0**p for p in range(first, last + 1) for m in multiples if p % stride == 0 or m != 1
    ]
    axis.set_major_locator(FixedLocator([t for t in ticks if low <= t <= high]))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())
    axis.set_major_formatter(FuncFormatter(_log_label))


def _log_label(value: float, _position: int | None = None) -> str:
    if 1e-3 <= value < 1e4:
        return f"{value:g}"
    power = math.floor(math.log10(value) + 1e-9)
    front = value / 10.0**power
    return f"10{superscript(power)}" if front < 1.01 else f"{front:g}·10{superscript(power)}"
