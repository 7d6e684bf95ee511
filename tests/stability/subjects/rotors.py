"""Tables of spots and rotors; clusters and circles have their cases in `cases/rotors.py`."""

from __future__ import annotations

import numpy as np
import pandas as pd
from battery import Subject

from rotortrack.rotors.find import find_rotors
from rotortrack.rotors.per_frame import duplicates, is_duplicate

TURN = 0.08 * np.arange(200)
NOISE = np.random.default_rng(1).normal(0.0, 8.0, (2, 200))
X, Y = 5000.0 + 120.0 * np.cos(TURN) + NOISE[0], 5000.0 - 120.0 * np.sin(TURN) + NOISE[1]
FRAME = np.arange(200)
FINITE = dict.fromkeys(("nan", "inf"), "localisations are finite: the fits refuse others")


def _spots(frame, x, y):
    table = pd.DataFrame({"frame": frame, "x_nm": x, "y_nm": y})
    return table.assign(uncertainty_nm=8.0, photons=500.0, fit_flags=0)


def _found(frame, x, y):
    found = find_rotors(_spots(frame, x, y))
    return found.rotors[["x_nm", "y_nm", "radius_nm"]].to_numpy()


def _moved(answer, _scale, shift, _angle):
    return answer + np.array([shift[0], shift[1], 0.0])


SUBJECTS = (
    Subject("rotors.find.find_rotors", _found, (FRAME, X, Y), FINITE, ordered=True),
    Subject(
        "rotors.per_frame.duplicates",
        lambda frame, x, y: duplicates(
            _spots(frame, x, y).assign(rotor=0), np.hypot(x - 5000.0, y - 5000.0)
        ),
        (FRAME // 2, X, Y),
        FINITE,
    ),
    Subject(
        "rotors.per_frame.is_duplicate",
        lambda frame, x, y: is_duplicate(_spots(frame, x, y).assign(fit_flags=128)),
        (FRAME, X, Y),
        FINITE,
    ),
)

EXEMPT = {
    "rotors.curation.match_verdicts": "finds the nearest rotor: tests/unit/rotors/test_curation.py",
    "rotors.fragments.find_fragments": "joins verdicts of a table: tests/unit/rotors",
}
