"""The one palette and look of every picture that rotortrack makes.

Colours are those of Okabe and Ito (2008), distinguishable with all common forms of colour
blindness; whatever a colour tells is also told by a marker or a line style. This module holds
plain values only, so that web pages can share them without loading matplotlib.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

BLACK = "#000000"
INK = "#222222"
GREY = "#7a7a7a"
PALE = "#d9d9d9"
BLUE = "#0072b2"
SKY = "#56b4e9"
GREEN = "#009e73"
ORANGE = "#e69f00"
VERMILLION = "#d55e00"
PURPLE = "#cc79a7"

COUNTS_MAP = "Blues"
IMAGE_MAP = "Greys"
"""Dark is bright: spots are dark on white paper, so that coloured marks and text stay readable."""


@dataclass(frozen=True)
class Look:
    """How one kind of thing is drawn: its words, colour, marker and line style."""

    label: str
    colour: str
    marker: str
    line: str = "-"


BEHAVIOURS = {
    "driven_ccw": Look("driven, counter-clockwise", BLUE, "^"),
    "driven_cw": Look("driven, clockwise", VERMILLION, "v"),
    "switching": Look("switching", PURPLE, "D"),
    "brownian": Look("Brownian", GREEN, "o"),
    "toggling": Look("toggling", ORANGE, "s"),
    "confined": Look("confined", SKY, "p"),
    "stuck": Look("stuck", GREY, "X"),
    "unclassified": Look("unclassified", INK, "P"),
}
"""Behaviours in the order of every legend."""

VERDICTS = {
    "kept": Look("kept", BLUE, "o", "-"),
    "refused": Look("refused", VERMILLION, "s", ":"),
}

DPI = 120

SETTINGS: dict[str, Any] = {
    "figure.dpi": DPI,
    "savefig.dpi": DPI,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    # A fixed height saves measuring all tick labels of every axes: a tenth of the drawing time.
    "axes.titley": 1.03,
    "axes.labelsize": 8.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "text.color": INK,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "lines.linewidth": 1.0,
    "lines.markersize": 4.0,
    "hatch.linewidth": 0.6,
    "path.simplify": True,
    "agg.path.chunksize": 20000,
    "text.hinting": "none",
    "svg.hashsalt": "rotortrack",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
}
"""matplotlib settings on top of its own defaults; a user's matplotlibrc does not enter."""


def behaviour(name: object) -> Look:
    """Return the look of a behaviour; a name that is not known is drawn as unclassified."""
    return BEHAVIOURS.get(str(name), BEHAVIOURS["unclassified"])


def verdict(name: object) -> Look:
    """Return the look of a verdict; whatever is not kept is drawn as refused."""
    return VERDICTS["kept" if str(name) == "kept" else "refused"]
