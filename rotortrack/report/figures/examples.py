"""A rotor of each behaviour: its map beside its cumulative angle (Fig. 2c-d, g-i and 4d-f)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rotortrack.report import style, words
from rotortrack.report.figures import canvas, columns, cumulative_angle, heatmap
from rotortrack.report.figures.canvas import NothingToDrawError
from rotortrack.report.figures.columns import column

_MAP_IN = 2.0
_ROW_IN = 3.0
_COLUMN_IN = 7.3
_WRAP = 78


@canvas.in_house_style
def figure(
    rotors: pd.DataFrame,
    tracks: Mapping[int, pd.DataFrame],
    localisations: Mapping[int, pd.DataFrame],
    *,
    frame_interval_s: float,
    switches: pd.DataFrame | None = None,
) -> Figure:
    """Draw, for each behaviour, the kept rotor whose case is clearest, with its evidence.

    Parameters
    ----------
    rotors
        The rotors table.
    tracks, localisations
        Rows of these tables by rotor number.
    frame_interval_s
        Time from frame to frame (s).
    switches
        Switches of speed of all rotors.

    Raises
    ------
    NothingToDrawError
        No kept rotor has a behaviour, angles and localisations.
    """
    kept = columns.kept(columns.need(rotors, "rotors", ["behaviour"]))
    drawable = kept["rotor"].isin(list(tracks)) & kept["rotor"].isin(list(localisations))
    rows = clearest(kept[drawable])
    if not rows:
        raise NothingToDrawError("no kept rotor has a behaviour and angles")
    across = 1 if len(rows) <= 2 else 2
    down = -(-len(rows) // across)
    width, height = 0.2 + across * _COLUMN_IN, 0.75 + down * _ROW_IN
    made = canvas.new_figure(width, height)
    canvas.heading(made, "The clearest rotor of each behaviour", 0.3)
    for k, row in enumerate(rows):
        place, line = divmod(k, down)
        number = int(row["rotor"])
        left, bottom = 0.3 + place * _COLUMN_IN, height - 0.55 - (line + 1) * _ROW_IN + 0.5
        evidence = words.text(row, "behaviour_evidence")
        caption = words.title(row) + (f"\n{evidence}" if evidence else "")
        made.text(
            left / width, (bottom + _MAP_IN + 0.07) / height,
            "\n".join(words.wrap(part, _WRAP, 1) for part in caption.split("\n")),
            va="bottom", fontsize=8.5,
        )  # fmt: skip
        track = tracks[number]
        own = canvas.place(made, left, bottom, _MAP_IN, _MAP_IN)
        heatmap.draw(own, localisations[number], row, track, bare=True)
        of_rotor = None if switches is None else switches[switches["rotor"] == number]
        cumulative_angle.draw(
            canvas.place(made, left + 2.75, bottom, 3.4, _MAP_IN), track, row,
            frame_interval_s=frame_interval_s, switches=of_rotor,
        )  # fmt: skip
    return made


def clearest(kept: pd.DataFrame) -> list[dict[str, Any]]:
    """Return a row of each behaviour: the largest margin, then the most localisations."""
    margin = np.nan_to_num(column(kept, "behaviour_margin"))
    seen = np.nan_to_num(column(kept, "n_localisations"))
    order = np.lexsort((kept["rotor"].to_numpy(), -seen, -margin))
    first: dict[str, dict[str, Any]] = {}
    for row in kept.iloc[order].to_dict("records"):
        kind = str(row["behaviour"])
        if kind in style.BEHAVIOURS:
            first.setdefault(kind, {str(name): value for name, value in row.items()})
    return [first[kind] for kind in style.BEHAVIOURS if kind in first]
