"""One page a rotor: heatmap, cumulative angle, MSD and step sizes (Fig. 2c, d, f and Fig. S4)."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rotortrack.report import words
from rotortrack.report.figures import canvas, cumulative_angle, heatmap, msd, step_sizes
from rotortrack.report.words import Row


@canvas.in_house_style
def figure(
    localisations: pd.DataFrame,
    rotor: Row,
    track: pd.DataFrame | None,
    *,
    frame_interval_s: float,
    msd_curve: msd.Curve | None = None,
    switches: pd.DataFrame | None = None,
) -> Figure:
    """Draw the page of one rotor; without angles (refused, no circle) the heatmap alone.

    Parameters
    ----------
    localisations
        The rotor's rows of the localisations.
    rotor
        Its row of the rotors table.
    track
        Its rows of the tracks, or None.
    frame_interval_s
        Time from frame to frame (s).
    msd_curve
        `msd.curve(track, frame_interval_s)` if the caller has it already.
    switches
        Its switches of speed, if any.
    """
    if track is None or not np.isfinite(track["cumulative_rad"].to_numpy(np.float64)).any():
        return heatmap.figure(localisations, rotor)
    made = canvas.new_figure(10.4, 7.9)
    canvas.heading(made, words.wrap(words.title(rotor), 120, 2), 0.3)
    heatmap.draw(canvas.place(made, 0.85, 4.45, 2.75, 2.75), localisations, rotor, track)
    angle = canvas.place(made, 5.2, 4.4, 4.3, 2.8)
    cumulative_angle.draw(angle, track, rotor, frame_interval_s=frame_interval_s, switches=switches)
    points = msd.curve(track, frame_interval_s) if msd_curve is None else msd_curve
    msd.draw(canvas.place(made, 0.85, 0.6, 3.4, 2.75), points, rotor)
    step_sizes.draw(canvas.place(made, 5.2, 0.6, 4.3, 2.75), track, rotor)
    return made
