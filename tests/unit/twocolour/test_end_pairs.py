"""Lag and blur are taken off rotors whether or not the table of rotors tells how they turn."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest

from rotortrack.twocolour.end_pairs import pairs_of
from rotortrack.twocolour.ends import Timing
from rotortrack.twocolour.measure import _notes

OMEGA, DIFFUSION, EXPOSURE, LATE = 40.0, 12.0, 0.002, 0.0009
TIMING = Timing(0.002, 1e-5, 100.0, EXPOSURE)
PLAIN = cast("Any", SimpleNamespace(error_nm=lambda places: np.zeros(len(places))))
RADII, PHASE, NOISE = (120.0, 70.0), 1.8, 8.0
DISTANCE = abs(RADII[0] - RADII[1] * np.exp(1j * PHASE))
PARTS = 40


def film(seed, frames=4000):
    """Give both ends as the mean of their exposures, the second one's later."""
    rng = np.random.default_rng(seed)
    part_s = TIMING.frame_interval_s / PARTS
    steps = rng.normal(OMEGA * part_s, math.sqrt(2 * DIFFUSION * part_s), (frames + 1) * PARTS)
    turns = np.exp(1j * np.cumsum(steps))
    late = round(LATE / part_s)
    columns: dict[str, Any] = {"rotor": 0, "frame": np.arange(frames), "late_s": late * part_s}
    for number, (radius, shift, phase) in enumerate(
        zip(RADII, (0, late), (0.0, PHASE), strict=True), start=1
    ):
        seen = turns[shift : shift + frames * PARTS].reshape(frames, PARTS).mean(axis=1)
        place = radius * seen * np.exp(1j * phase)
        columns[f"x{number}_nm"] = 5000.0 + place.real + NOISE * rng.normal(size=frames)
        columns[f"y{number}_nm"] = 5000.0 - place.imag + NOISE * rng.normal(size=frames)
        columns[f"x{number}_sd_nm"] = columns[f"y{number}_sd_nm"] = np.full(frames, NOISE)
    return pd.DataFrame(columns)


def rotors(omega=math.nan, diffusion=math.nan):
    return pd.DataFrame(
        {
            "rotor": [0],
            "x_nm": [5000.0],
            "y_nm": [5000.0],
            "omega_rad_s": [omega],
            "diffusion_rad2_s": [diffusion],
        }
    )


def distance(pair):
    """Give the root of the mean square less what noise adds to it."""
    added = pair.variance.sum(axis=1) + (pair.stray**2).sum(axis=1)
    return pair.stretch * math.sqrt(np.mean(pair.length**2 - added))


@pytest.mark.parametrize("table", [rotors(OMEGA, DIFFUSION), rotors()])
def test_distances_have_neither_lag_nor_blur(table):
    found = [
        distance(pair)
        for seed in range(12)
        for pair in pairs_of(film(seed), table, PLAIN, 100, TIMING)
    ]
    error = np.std(found) / math.sqrt(len(found))
    assert error < 0.15
    assert np.mean(found) == pytest.approx(DISTANCE, abs=3 * error)


def test_without_either_they_would_be_far_off():
    pairs = [next(pairs_of(film(seed), rotors(0.0, 0.0), PLAIN, 100, TIMING)) for seed in range(4)]
    assert abs(np.mean([distance(pair) for pair in pairs]) - DISTANCE) > 1.0


def test_a_lag_that_cannot_be_undone_is_told():
    few = film(0).iloc[:20]
    (pair,) = pairs_of(few, rotors(), PLAIN, 10, TIMING)
    assert not pair.turning_known
    table = pd.DataFrame({"extrapolated": [False]})
    (note,) = _notes(table, [pair])
    assert "rotors 0 " in note
    (pair,) = pairs_of(few.assign(late_s=0.0), rotors(), PLAIN, 10, TIMING)
    assert not list(_notes(table, [pair]))
