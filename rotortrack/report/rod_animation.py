"""A simulated rod as an animation, seen from above and from the side (Movies S2-S6)."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.patches import Circle, Rectangle

from rotortrack.errors import UsageError
from rotortrack.files import atomic_path
from rotortrack.report import style
from rotortrack.report.figures import canvas
from rotortrack.simulate.field.table import FieldTable
from rotortrack.simulate.rod.run import RodRun

_FRAMES_PER_S: Final = 20
_DPI: Final = 80
_TRACE: Final = 10
"""Earlier places of the ends that are shown, as in the paper's movies."""


def check_ending(path: Path) -> None:
    """Make sure that an animation can be written to a path.

    Raises
    ------
    UsageError
        The name ends neither in .gif nor in .mp4, or in .mp4 and no ffmpeg is found.
    """
    ending = path.suffix.lower()
    if ending not in {".gif", ".mp4"}:
        raise UsageError(f"{path} does not end in .gif or .mp4: name the animation so")
    if ending == ".mp4" and shutil.which("ffmpeg") is None:
        raise UsageError(
            f"{path} needs the program ffmpeg, which was not found: install it or write a .gif"
        )


def animate(run: RodRun, path: Path, field: FieldTable | None = None, frames: int = 100) -> None:
    """Write an animation of a run, whole or not at all.

    Parameters
    ----------
    run
        Shapes over time.
    path
        Ends in .gif or .mp4, the latter where ffmpeg is installed.
    field
        The pore's field, for the pore; without it none is drawn.
    frames
        Pictures, evenly in the run's time.

    Raises
    ------
    UsageError
        As for :func:`check_ending`.
    ResourceError
        The file cannot be written.
    """
    check_ending(path)
    chosen = np.unique(np.linspace(0, len(run.time_us) - 1, frames).round().astype(int))
    shapes = run.positions_nm[chosen]
    with atomic_path(path) as temporary, canvas.house_style():
        made = canvas.new_figure(4.6, 6.0)
        above = canvas.place(made, 0.75, 2.15, 3.5, 3.5)
        side = canvas.place(made, 0.75, 0.55, 3.5, 1.0)
        reach = 1.05 * float(np.abs(shapes[..., :2]).max())
        low, high = float(shapes[..., 2].min()), float(shapes[..., 2].max())
        if field is not None:
            low, high = min(low, -field.membrane_nm), max(high, field.membrane_nm)
            half = field.membrane_nm / 2.0
            above.add_patch(
                Circle((0, 0), field.pore_radius_nm, fill=False, color=style.VERMILLION)
            )
            for left in (-2000.0, field.pore_radius_nm):
                width = 2000.0 - field.pore_radius_nm
                side.add_patch(Rectangle((left, -half), width, 2 * half, color=style.PALE))
        above.set(xlim=(-reach, reach), ylim=(-reach, reach), ylabel="y (nm)")
        above.set_title("seen from cis")
        margin = 0.1 * (high - low) + 1.0
        side.set(xlim=(-reach, reach), ylim=(low - margin, high + margin), xlabel="x (nm)")
        side.set_ylabel("z (nm)")
        rods = [axes.plot([], [], color=style.ORANGE, linewidth=2)[0] for axes in (above, side)]
        traces = [above.plot([], [], color=c, linewidth=1)[0] for c in (style.BLUE, style.GREEN)]
        clock = made.text(0.97, 0.985, "", ha="right", va="top")
        writer = _writer(path)
        with writer.saving(made, str(temporary), _DPI):
            for k, sample in enumerate(chosen):
                for line, second in zip(rods, (1, 2), strict=True):
                    line.set_data(shapes[k, :, 0], shapes[k, :, second])
                for line, end in zip(traces, (0, -1), strict=True):
                    line.set_data(*shapes[max(k - _TRACE, 0) : k + 1, end, :2].T)
                clock.set_text(f"{run.time_us[sample]:.1f} μs")
                writer.grab_frame()


def _writer(path: Path) -> AbstractMovieWriter:
    if path.suffix.lower() == ".gif":
        return PillowWriter(fps=_FRAMES_PER_S)
    return FFMpegWriter(fps=_FRAMES_PER_S, codec="h264")
