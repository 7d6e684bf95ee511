"""The field of a nanopore in a full cross-section, as in Fig. S13: potential, field and flow."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from rotortrack.report import style
from rotortrack.report.figures import canvas
from rotortrack.simulate.field.sample import sample_fields
from rotortrack.simulate.field.table import FieldTable

Floats = npt.NDArray[np.float64]

_HALF_WIDTH_NM: Final = 120.0
_HALF_HEIGHT_NM: Final = 100.0
_ACROSS, _UP = 241, 200
_DECADES: Final = 2.5
"""Shown below the largest value; beyond it all is drawn in the palest colour."""


@canvas.in_house_style
def figure(table: FieldTable) -> Figure:
    """Draw electric field and flow of water through the pore, mirrored to a full cross-section.

    Parameters
    ----------
    table
        The pore's field.

    Returns
    -------
    Figure
        Left the strength of the field with lines of equal potential, right the speed of the
        water with its streamlines.
    """
    made = canvas.new_figure(9.0, 4.15)
    salts = table.options["cis_mm"], table.options["trans_mm"]
    salt = (
        f"{salts[0]:g} mM" if salts[0] == salts[1] else f"{salts[0]:g} mM cis, {salts[1]:g} trans"
    )
    canvas.heading(
        made, f"Nanopore at {1e3 * table.voltage_v:g} mV, {salt}: "
        f"{_signed(1e9 * table.current_a)} nA, {_signed(1e18 * table.flow_m3_s)} μm³/s", 0.3
    )  # fmt: skip
    x, z = _grid()
    fields = _sampled(table, x, z)
    electric, flow = fields[..., 0, :] + fields[..., 1, :], fields[..., 2, :] * 1e-3
    left = canvas.place(made, 0.75, 0.55, 3.0, 2.75)
    _map(left, x, z, np.linalg.norm(electric, axis=-1), "electric field", "V/m")
    _potential_lines(left, table, x, z)
    right = canvas.place(made, 5.15, 0.55, 3.0, 2.75)
    name = "flow of water" if salts[0] == salts[1] else "diffusioosmotic flow of water"
    _map(right, x, z, np.linalg.norm(flow, axis=-1), name, "m/s")
    if np.any(flow):
        right.streamplot(
            x, z, flow[..., 0], flow[..., 2],
            color=style.INK, linewidth=0.5, arrowsize=0.6, density=1.1,
        )  # fmt: skip
    for axes in (left, right):
        _membrane(axes, table)
        axes.set_xlim(-_HALF_WIDTH_NM, _HALF_WIDTH_NM)
        axes.set_ylim(-_HALF_HEIGHT_NM, _HALF_HEIGHT_NM)
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlabel("x (nm)")
        axes.set_ylabel("z (nm)")
    return made


def _grid() -> tuple[Floats, Floats]:
    x = np.linspace(-_HALF_WIDTH_NM, _HALF_WIDTH_NM, _ACROSS)
    # No row lies on a face of the membrane, where values jump.
    return x, np.linspace(-_HALF_HEIGHT_NM, _HALF_HEIGHT_NM, _UP) + 1e-3


def _sampled(table: FieldTable, x: Floats, z: Floats) -> Floats:
    """Fields (z, x, 4, 3) in the cross-section y = 0, nan within the membrane."""
    wide, high = np.meshgrid(x, z)
    points = np.stack((wide.ravel(), np.zeros(wide.size), high.ravel()), axis=1)
    out = np.empty((points.shape[0], 4, 3))
    sample_fields(table.r_nm, table.z_nm, table.nodes, points, out)
    out[_inside(table, points[:, 0], points[:, 2])] = np.nan
    return out.reshape(*wide.shape, 4, 3)


def _inside(table: FieldTable, x: Floats, z: Floats) -> npt.NDArray[np.bool_]:
    return (np.abs(x) > table.pore_radius_nm) & (np.abs(z) < table.membrane_nm / 2.0)


def _map(axes: Axes, x: Floats, z: Floats, value: Floats, name: str, unit: str) -> None:
    half = (x[1] - x[0]) / 2.0, (z[1] - z[0]) / 2.0
    extent = (x[0] - half[0], x[-1] + half[0], z[0] - half[1], z[-1] + half[1])
    free = np.where(np.isfinite(value), value, 0.0)
    # The rim is singular, and its few pixels would take the scale for themselves.
    top = float(np.quantile(free[free > 0.0], 0.999)) if np.any(free > 0.0) else 0.0
    axes.set_title(name)
    if top == 0.0:
        axes.text(0.5, 0.9, "none", transform=axes.transAxes, ha="center", color=style.GREY)
        return
    norm: Any = LogNorm(top / 10.0**_DECADES, top, clip=True)
    image = axes.imshow(
        value, origin="lower", extent=extent, cmap=style.COUNTS_MAP, norm=norm,
        interpolation="nearest",
    )  # fmt: skip
    figure = axes.get_figure(root=True)
    assert figure is not None
    box = axes.get_position()
    bar = figure.add_axes((box.x1 + 0.008, box.y0, 0.012, box.height))
    figure.colorbar(image, cax=bar)
    canvas.log_ticks(bar.yaxis, float(norm.vmin), float(norm.vmax))
    bar.set_title(unit, fontsize=7.5, loc="left")


def _potential_lines(axes: Axes, table: FieldTable, x: Floats, z: Floats) -> None:
    """Equal potentials without the double layer, integrated down the axis and outwards."""
    step = 0.25
    down = np.arange(table.z_nm[-1], -_HALF_HEIGHT_NM - step, -step)
    out = np.arange(0.0, _HALF_WIDTH_NM + step, step)
    on_axis = _integrated(table, np.stack((0 * down, 0 * down, down), axis=1), 2)
    potential = np.full((z.size, x.size), np.nan)
    for row, height in enumerate(z):
        line = np.stack((out, 0 * out, np.full(out.size, height)), axis=1)
        along = _integrated(table, line, 0)
        begin = np.interp(height, down[::-1], on_axis[::-1])
        potential[row] = begin + np.interp(np.abs(x), out, along)
    wide, high = np.meshgrid(x, z)
    potential[_inside(table, wide, high)] = np.nan
    span = float(np.nanmax(potential) - np.nanmin(potential))
    if span < 1e-6:
        return
    spacing = canvas.nice(1e3 * span / 5.0)
    levels = spacing * np.arange(-12, 13)
    lines = axes.contour(
        x, z, 1e3 * potential, levels=levels, colors=style.VERMILLION, linewidths=0.6,
        linestyles="solid",
    )  # fmt: skip
    axes.clabel(lines, fmt="%g mV", fontsize=6.5, inline_spacing=2)


def _integrated(table: FieldTable, points: Floats, axis: int) -> Floats:
    """Potential (V) along a straight line of points, 0 at the first."""
    out = np.empty((points.shape[0], 4, 3))
    sample_fields(table.r_nm, table.z_nm, table.nodes, points, out)
    field = out[:, 0, axis]
    steps = np.diff(points[:, axis]) * 1e-9
    return np.concatenate(([0.0], -np.cumsum(steps * (field[1:] + field[:-1]) / 2.0)))


def _membrane(axes: Axes, table: FieldTable) -> None:
    half = table.membrane_nm / 2.0
    for side in (-1.0, 1.0):
        axes.fill_betweenx(
            [-half, half], side * table.pore_radius_nm, side * 2.0 * _HALF_WIDTH_NM,
            color=style.PALE, linewidth=0, zorder=3,
        )  # fmt: skip
    axes.text(-_HALF_WIDTH_NM + 4, 0.0, "membrane", fontsize=6.5, va="center", zorder=4)
    axes.text(
        -_HALF_WIDTH_NM + 4, _HALF_HEIGHT_NM - 5, "cis", fontsize=7, va="top", zorder=4,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
    )  # fmt: skip
    axes.text(
        -_HALF_WIDTH_NM + 4, -_HALF_HEIGHT_NM + 5, "trans", fontsize=7, va="bottom", zorder=4,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
    )  # fmt: skip


def _signed(value: float) -> str:
    if value == 0.0:
        return "0"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}".replace("-", "−")
