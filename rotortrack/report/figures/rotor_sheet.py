"""One page a rotor: where it was, how it turned, and what was measured (Fig. 2c, d, f, Fig. S4)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rotortrack.report import words
from rotortrack.report.figures import (
    angle_trace,
    canvas,
    cumulative_angle,
    heatmap,
    msd,
    profile,
    speed_trace,
    step_sizes,
)
from rotortrack.report.words import Row

_WIDTH_IN = 13.2
_ROW_IN = 3.45
_PANEL_IN = (3.1, 2.3)
_LEFT_IN = (0.85, 5.2, 9.55)
_SQUARE_IN = 2.75

Panel = tuple[Callable[[Axes], None], bool]
"""What draws a panel, and whether its axes are square."""


@canvas.in_house_style
def figure(
    localisations: pd.DataFrame,
    rotor: Row,
    track: pd.DataFrame | None,
    *,
    frame_interval_s: float,
    exposure_s: float | None = None,
    msd_curve: msd.Curve | None = None,
    switches: pd.DataFrame | None = None,
    posterior: pd.DataFrame | None = None,
    angle_profile: pd.DataFrame | None = None,
    msd_table: pd.DataFrame | None = None,
) -> Figure:
    """Draw the page of one rotor; without angles (refused, no circle) the heatmap alone.

    Below the heatmap and the cumulative angle are the MSD, the step sizes and the angles frame by
    frame; then, where the run tells them, the speed in windows, and speed and occupancy against
    angle.

    Parameters
    ----------
    localisations
        The rotor's rows of the localisations.
    rotor
        Its row of the rotors table.
    track
        Its rows of the tracks, or None.
    frame_interval_s, exposure_s
        Time from frame to frame and exposure within it (s).
    msd_curve
        `msd.curve(track, frame_interval_s)` if the caller has it already.
    switches
        Its switches of speed, if any.
    posterior
        Its rows of the posterior, if any.
    angle_profile
        Its rows of the profiles, if any.
    msd_table
        Its rows of the mean-square displacements, if any.
    """
    if track is None or not np.isfinite(track["cumulative_rad"].to_numpy(np.float64)).any():
        return heatmap.figure(localisations, rotor)
    points = msd.curve(track, frame_interval_s) if msd_curve is None else msd_curve
    times = {"frame_interval_s": frame_interval_s}
    panels: list[Panel] = [
        (
            lambda axes: msd.draw(axes, points, rotor, table=msd_table, exposure_s=exposure_s),
            False,
        ),
        (lambda axes: step_sizes.draw(axes, track, rotor), False),
        (lambda axes: angle_trace.draw(axes, track, rotor, posterior, **times), False),
    ]
    if exposure_s is not None:
        found = speed_trace.speeds_of(track, rotor, switches, exposure_s=exposure_s, **times)
        if found is not None:
            speeds = found
            panels.append((lambda axes: speed_trace.draw(axes, speeds, rotor, switches), False))
    if angle_profile is not None:
        shown = angle_profile
        if profile.has_speeds(shown):
            panels.append((lambda axes: profile.draw_speed(axes, shown, rotor), False))
        if profile.has_occupancy(shown):
            panels.append((lambda axes: profile.draw_occupancy(axes, shown, rotor), True))
    rows = -(-len(panels) // 3)
    made = canvas.new_figure(_WIDTH_IN, 4.05 + _ROW_IN * rows)
    canvas.heading(made, words.wrap(words.title(rotor), 130, 2), 0.3)
    bottom = _ROW_IN * rows
    square = canvas.place(made, _LEFT_IN[0], bottom + 0.6, _SQUARE_IN, _SQUARE_IN)
    heatmap.draw(square, localisations, rotor, track)
    wide = _LEFT_IN[2] + _PANEL_IN[0] - _LEFT_IN[1]
    angle = canvas.place(made, _LEFT_IN[1], bottom + 0.6, wide - 0.25, _SQUARE_IN)
    cumulative_angle.draw(angle, track, rotor, switches=switches, **times)
    for k, (draw, is_square) in enumerate(panels):
        row, column = divmod(k, 3)
        left, below = _LEFT_IN[column], bottom - _ROW_IN * (row + 1) + 0.55
        width, height = _PANEL_IN
        if is_square:
            left, width = left + (width - height) / 2, height
        draw(canvas.place(made, left, below, width, height))
    return made
