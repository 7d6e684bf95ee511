"""What each effect of a filmed scene costs in time and memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from rotortrack.report import style
from rotortrack.report.figures import canvas


@canvas.in_house_style
def figure(costs: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw costs as bars.

    Parameters
    ----------
    costs
        The whole scene, then its effects: values of `rotortrack.tradeoff.effects.EffectCost` by
        their names.

    Returns
    -------
    Figure
    """
    whole, *effects = costs
    height = 0.22 * max(len(effects), 3)
    made = canvas.new_figure(8.0, height + 1.25)
    canvas.heading(
        made,
        f"{whole['ms_per_frame']:.2f} ms a frame on one processor, {whole['peak_mb']:.0f} MB: what "
        "each effect adds",
        0.3,
    )
    times = canvas.place(made, 1.5, 0.65, 3.9, height)
    memory = canvas.place(made, 5.9, 0.65, 1.8, height)
    rows = range(len(effects))
    times.barh(
        rows,
        [cost["ms_per_frame"] for cost in effects],
        xerr=[cost["spread_ms"] for cost in effects],
        color=style.BLUE,
        height=0.7,
    )
    memory.barh(rows, [cost["peak_mb"] for cost in effects], color=style.GREY, height=0.7)
    times.set_yticks(list(rows), [cost["effect"].replace("_", " ") for cost in effects])
    memory.set_yticks([])
    for axes, label in ((times, "processor time (ms per frame)"), (memory, "peak memory (MB)")):
        axes.axvline(0.0, color=style.BLACK, linewidth=0.6)
        axes.set_xlabel(label)
        axes.set_ylim(len(effects) - 0.4, -0.6)
    return made
