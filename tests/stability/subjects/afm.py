"""Rods in images of an atomic force microscope."""

from __future__ import annotations

import math

import numpy as np
from battery import Subject, digits, word_for

from rotortrack.afm.centre_line import along, resample
from rotortrack.afm.level import level_lines
from rotortrack.afm.persistence import mean_square_distance, turns_of
from rotortrack.afm.trace import trace_rods

TURN = np.linspace(0.0, math.pi, 400)
ARC = np.column_stack([100.0 * np.cos(TURN), 100.0 * np.sin(TURN)])


def _image(tilt=0.0, scale=1.0):
    """A straight rod of 5 nm height on a plane."""
    y, x = np.mgrid[:96, :128].astype(float)
    middle = 48.0 + 12.0 * np.sin(x / 12.0)
    rod = 5.0 * np.exp(-0.5 * ((y - middle) / 2.0) ** 2) * ((x > 30) & (x < 100))
    noise = np.random.default_rng(1).normal(0.0, 0.05, rod.shape)
    return scale * (rod + noise) + tilt * y


def _traced(image, pixel_size_nm=3.0):
    return trace_rods(image, pixel_size_nm).rods["contour_nm"].to_numpy()


SUBJECTS = (
    Subject(
        "afm.trace.trace_rods",
        trace_rods,
        own={
            "one rod": lambda: word_for(lambda: _traced(_image())),
            "heights 1e3 times as large": lambda: digits(
                _traced(_image(scale=1e3)), _traced(_image())
            ),
            "nothing but a plane": lambda: word_for(lambda: _traced(0 * _image())),
            "nan in a corner": lambda: word_for(
                lambda: _traced(np.where(np.indices((96, 128)).sum(0) < 3, math.nan, _image()))
            ),
        },
    ),
    Subject(
        "afm.level.level_lines",
        level_lines,
        own={
            "a plane": lambda: digits(
                level_lines(
                    np.add.outer(3.0 * np.arange(32.0), np.arange(40.0)), order=1, grown_px=1
                )[0],
                np.zeros((32, 40)),
                100.0,
            )
        },
    ),
    Subject(
        "afm.centre_line.along",
        lambda x, y: along(np.column_stack([x, y])),
        (ARC[:, 0], ARC[:, 1]),
        {"another order": "points follow one another"},
        ordered=True,
        places=(0, 1),
        degrees=1.0,
        own={
            "half a circle": lambda: digits(along(ARC)[-1], 100.0 * 798 * math.sin(math.pi / 798))
        },
    ),
    Subject(
        "afm.centre_line.resample",
        resample,
        own={"half a circle": lambda: word_for(lambda: resample(ARC, 10.0, 0.0, None))},
    ),
    Subject(
        "afm.persistence.turns_of",
        turns_of,
        own={"half a circle": lambda: word_for(lambda: turns_of(ARC, 10.0))},
    ),
    Subject(
        "afm.persistence.mean_square_distance",
        mean_square_distance,
        own={
            "a straight rod": lambda: digits(mean_square_distance(np.array([100.0]), 1e12), 1e4),
            "a rod of no length": lambda: digits(
                mean_square_distance(np.array([0.0]), 50.0), 0.0, 1.0
            ),
        },
    ),
)

EXEMPT: dict[str, str] = {}
