"""Speed and occupancy of one rotor against its angle: pinning, washboards, uneven pores."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Circle
from matplotlib.ticker import FixedLocator, MaxNLocator

from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.report.figures.columns import column
from rotortrack.report.words import Row
from rotortrack.units import DEGREES_PER_RADIAN, TURN_RAD

_POINTS_PER_ARC = 6


def has_speeds(profile: pd.DataFrame | None) -> bool:
    """Whether a profile tells the speed of more than one bin."""
    return profile is not None and np.isfinite(column(profile, "omega_rad_s")).sum() > 1


def has_occupancy(profile: pd.DataFrame | None) -> bool:
    """Whether a profile tells how often the rotor was where."""
    return profile is not None and bool(np.nansum(column(profile, "occupancy")) > 0)


def draw_speed(axes: Axes, profile: pd.DataFrame, rotor: Row) -> None:
    """Draw speed against angle with standard deviations; dashed is the rotor's mean speed.

    Parameters
    ----------
    axes
        Where to draw.
    profile
        The rotor's rows of the profiles (angle_rad of the bins' middles, omega_rad_s,
        omega_sd_rad_s).
    rotor
        Its row of the rotors table.
    """
    angle = np.mod(column(profile, "angle_rad"), TURN_RAD) * DEGREES_PER_RADIAN
    speed, sd = (column(profile, name) / TURN_RAD for name in ("omega_rad_s", "omega_sd_rad_s"))
    colour = style.behaviour(rotor.get("behaviour")).colour
    axes.errorbar(
        angle,
        speed,
        yerr=np.nan_to_num(sd),
        fmt="o",
        ms=3,
        mew=0,
        color=colour,
        elinewidth=0.8,
        label="speed, sd",
    )
    mean, _ = words.rev_per_s(rotor)
    axes.axhline(0, color=style.PALE, lw=0.8, zorder=0)
    if math.isfinite(mean):
        axes.axhline(mean, ls="--", color=style.INK, lw=0.9, label="measured speed")
    axes.set_xlabel("angle (°), counter-clockwise from the right")
    axes.set_ylabel("speed (rev/s)")
    axes.set_xlim(0, 360)
    axes.xaxis.set_major_locator(FixedLocator([0, 90, 180, 270, 360]))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    canvas.caption(axes, "speed against angle")


def draw_occupancy(axes: Axes, profile: pd.DataFrame, rotor: Row) -> None:
    """Draw how often the rotor was where, over the even share, as seen on the displayed image.

    The dashed ring is the even share; radial bars are standard deviations. The axes should be
    square.
    """
    middle, share, sd = (
        column(profile, name) for name in ("angle_rad", "occupancy", "occupancy_sd")
    )
    even = np.nansum(share) / max(len(share), 1)
    share, sd = np.nan_to_num(share) / even, np.nan_to_num(sd) / even
    colour = style.behaviour(rotor.get("behaviour")).colour
    half = math.pi / len(share)
    axes.add_collection(
        PolyCollection(
            list(_wedges(middle, share, half)),
            facecolor=colour,
            alpha=0.45,
            edgecolor="white",
            lw=0.4,
        )
    )
    bars = np.stack([np.maximum(share - sd, 0.0), share + sd], axis=1)
    toward = np.stack([np.cos(middle), np.sin(middle)], axis=1)
    axes.add_collection(
        LineCollection(bars[:, :, None] * toward[:, None, :], colors=colour, linewidths=0.9)
    )
    axes.add_patch(Circle((0, 0), 1.0, fill=False, ls="--", lw=0.9, color=style.INK))
    reach = 1.06 * max(float(bars.max()), 1.2)
    for k, name in enumerate(("0°", "90°", "180°", "270°")):
        across, up = round(math.cos(k * math.pi / 2)), round(math.sin(k * math.pi / 2))
        axes.plot([0, across * reach], [0, up * reach], color=style.PALE, lw=0.6, zorder=0)
        axes.annotate(
            name, (across * reach, up * reach), xytext=(3 * across, 2 * up),
            textcoords="offset points", fontsize=7.5,
            ha=("center", "left", "right")[across], va=("center", "bottom", "top")[up],
        )  # fmt: skip
    side = 1.15 * reach
    axes.set_xlim(-side, side)
    axes.set_ylim(-side, side)
    axes.set_aspect("equal")
    axes.set_axis_off()
    most = int(np.argmax(share))
    at = math.degrees(float(np.mod(middle[most], TURN_RAD)))
    peak = words.plus_minus(float(share[most]), float(sd[most]), "")
    canvas.caption(axes, f"occupancy: {peak} of even at {at:.0f}°")


def _wedges(middle: Floats, radius: Floats, half: float) -> Floats:
    """Return sectors as polygons, shape (bins, points, 2)."""
    arc = np.linspace(-half, half, _POINTS_PER_ARC)
    angle = middle[:, None] + arc[None, :]
    rim = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    return np.concatenate([np.zeros((len(middle), 1, 2)), rim], axis=1)
