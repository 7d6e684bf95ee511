"""One simulated rod: from above and from the side over time, its angle, and what pushes it."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from rotortrack.report import style
from rotortrack.report.figures import canvas
from rotortrack.simulate.field.table import FieldTable
from rotortrack.simulate.rod.balance import ForceBalance, force_balance
from rotortrack.simulate.rod.observe import Observation
from rotortrack.simulate.rod.run import RodRun

Floats = npt.NDArray[np.float64]

_SHAPES: Final = 7
_LATE: Final = 0.75
_NET_SCALE: Final = 50.0
"""The paper draws the net force fifty times as long as the others."""

_PARTS: Final = {
    "electric": ("electric", style.BLUE),
    "flow": ("flow", style.GREEN),
    "bending": ("bending", style.ORANGE),
    "contact": ("membrane", style.PURPLE),
    "tension": ("tension", style.GREY),
    "net": (f"net ×{_NET_SCALE:g}", style.VERMILLION),
}


@canvas.in_house_style
def figure(run: RodRun, seen: Observation, field: FieldTable | None = None) -> Figure:
    """Draw a run.

    Parameters
    ----------
    run
        Shapes and angle over time.
    seen
        What was measured on it.
    field
        The pore's field; without it neither pore nor forces of a field are drawn.

    Returns
    -------
    Figure
        Shapes from above (x, y) and from the side (x, z), the angle over time, and the forces on
        one segment, to scale.
    """
    made = canvas.new_figure(9.0, 6.5)
    canvas.heading(made, _title(run, seen), 0.3)
    above = canvas.place(made, 0.8, 3.3, 2.7, 2.5)
    side = canvas.place(made, 0.8, 0.65, 2.7, 1.75)
    angle = canvas.place(made, 5.0, 3.6, 3.5, 2.1)
    forces = canvas.place(made, 5.0, 0.65, 3.5, 2.0)
    _shapes(above, run, field, 1)
    _shapes(side, run, field, 2)
    above.set_title("from above (cis), pale to dark in time")
    side.set_title("from the side")
    _angle(angle, run)
    _forces(forces, force_balance(run.positions_nm[-1], run.rod, field), run.positions_nm[-1])
    return made


def _title(run: RodRun, seen: Observation) -> str:
    words = run.end.value.replace("_", " ")
    if not math.isfinite(seen.rate_rev_s) or run.end.value != "rotating_steadily":
        return f"Simulated rod: {words}"
    hand = seen.shape.replace("_", " ")
    return (
        f"Simulated rod: {words}, {seen.rate_rev_s:+,.0f} rev/s, shape {hand}, end to end "
        f"{seen.end_to_end_nm:.0f} nm".replace("-", "−")
    )


def _shapes(axes: Axes, run: RodRun, field: FieldTable | None, second: int) -> None:
    """Shapes of the last quarter, or of all of a run that was lost, seen along one axis."""
    count = len(run.time_us)
    begin = int(_LATE * count) if run.end.value == "rotating_steadily" else 0
    if field is not None:
        _pore(axes, field, second)
    chosen = np.unique(np.linspace(begin, count - 1, _SHAPES).astype(int))
    if run.end.value == "rotating_steadily":
        # Within one turn, or all shapes would lie on each other.
        turned = np.abs(run.turned_rad - run.turned_rad[-1])
        within = np.flatnonzero(turned[begin:] < 0.8 * math.pi)
        first = begin + int(within[0]) if within.size else begin
        chosen = np.unique(np.linspace(first, count - 1, _SHAPES).astype(int))
    for k, sample in enumerate(chosen):
        shape = run.positions_nm[sample]
        strength = (k + 1) / len(chosen)
        axes.plot(
            shape[:, 0], shape[:, second], color=style.ORANGE,
            linewidth=1.0 + strength, alpha=0.15 + 0.85 * strength**2, zorder=3,
        )  # fmt: skip
    shape = run.positions_nm[chosen[-1]]
    axes.plot(*shape[0, [0, second]], "o", color=style.VERMILLION, zorder=4, label="first end")
    axes.plot(*shape[-1, [0, second]], "s", color=style.BLUE, zorder=4, label="last end")
    axes.set_xlabel("x (nm)")
    axes.set_ylabel("y (nm)" if second == 1 else "z (nm)")
    if second == 1:
        axes.set_aspect("equal", adjustable="datalim")
        axes.legend(loc="upper right", borderaxespad=0.1)
        return
    seen = run.positions_nm[chosen]
    reach = 1.1 * float(np.abs(seen[..., 0]).max())
    axes.set_xlim(-reach, reach)
    bottom, top = float(seen[..., 2].min()), float(seen[..., 2].max())
    if field is not None:
        bottom, top = min(bottom, -field.membrane_nm), max(top, field.membrane_nm)
    axes.set_ylim(bottom - 0.1 * (top - bottom), top + 0.1 * (top - bottom) + 1e-9)


def _pore(axes: Axes, field: FieldTable, second: int) -> None:
    radius, half = field.pore_radius_nm, field.membrane_nm / 2.0
    if second == 1:
        rim = Circle((0, 0), radius, fill=False, edgecolor=style.INK, linewidth=1.2, zorder=2)
        axes.add_patch(rim)
        return
    for left in (-2000.0, radius):
        axes.add_patch(
            Rectangle((left, -half), 2000.0 - radius, 2 * half, color=style.PALE, zorder=1)
        )


def _angle(axes: Axes, run: RodRun) -> None:
    time_us, turns = canvas.thin(run.time_us, run.turned_rad / (2.0 * math.pi))
    axes.plot(time_us, turns, color=style.BLUE)
    axes.axhline(0.0, color=style.GREY, linewidth=0.5)
    axes.set_title("angle turned, counter-clockwise positive")
    axes.set_xlabel("time (μs)")
    axes.set_ylabel("turns")


def _forces(axes: Axes, balance: ForceBalance, x: Floats) -> None:
    """Draw the forces on the vertex that is driven round the axis most, seen from above."""
    around = np.stack((-x[:, 1], x[:, 0]), axis=1)
    torque = np.sum(around * balance.driving[:, :2], axis=1)
    inner = np.arange(1, len(x) - 1)
    i = int(inner[np.argmax(np.abs(torque[inner]))])
    radial = x[i, :2] / max(float(np.hypot(*x[i, :2])), 1e-9)
    frame = np.stack((radial, [-radial[1], radial[0]]))
    chain = (x[max(i - 3, 0) : i + 4, :2] - x[i, :2]) @ frame.T
    vectors: dict[str, Any] = {}
    for name in _PARTS:
        scale = _NET_SCALE if name == "net" else 1.0
        vectors[name] = scale * frame @ getattr(balance, name)[i, :2]
    longest = max(float(np.hypot(*v)) for v in vectors.values())
    if longest == 0.0:
        canvas.notice(axes, "no force acts")
        return
    axes.plot(*(chain.T * longest / 40.0), color=style.PALE, linewidth=6, zorder=1)
    for name, (label, colour) in _PARTS.items():
        vector = vectors[name]
        if np.hypot(*vector) < 0.01 * longest:
            continue
        axes.annotate(
            "", xy=tuple(vector), xytext=(0, 0),
            arrowprops={"arrowstyle": "-|>", "color": colour, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
        axes.plot([], [], color=colour, label=label)
    # Room for the legend on the right, in the proportions of the axes.
    axes.set_xlim(-1.3 * longest, 2.2 * longest)
    axes.set_ylim(-1.0 * longest, 1.0 * longest)
    axes.set_aspect("equal", adjustable="box")
    axes.set_title(
        f"forces on the vertex with the largest torque, {np.hypot(*x[i, :2]):.0f} nm out"
    )
    axes.set_xlabel("away from the axis (pN)")
    axes.set_ylabel("around it (pN)")
    axes.legend(loc="center right", borderaxespad=0.1)
