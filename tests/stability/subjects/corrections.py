"""Filters and drift on tables."""

from __future__ import annotations

import numpy as np
import pandas as pd
from battery import Subject, digits, word_for

from rotortrack.corrections.density import dense_enough
from rotortrack.corrections.drift.cross_correlation import estimate_drift
from rotortrack.corrections.drift.drift import apply_drift, no_drift
from rotortrack.corrections.options import DensityOptions, DriftOptions, QualityOptions
from rotortrack.corrections.quality import passes_quality

RNG = np.random.default_rng(1)
FRAME = np.repeat(np.arange(500), 20)
SITES = np.tile(RNG.uniform(0.0, 20_000.0, (20, 2)), (500, 1))
PLACES = SITES + np.column_stack([0.2 * FRAME, 0.0 * FRAME]) + RNG.normal(0.0, 8.0, SITES.shape)
X, Y = PLACES.T


def _table(frame, x, y):
    return pd.DataFrame({"frame": frame, "x_nm": x, "y_nm": y, "uncertainty_nm": 8.0})


def _dense(frame, x, y):
    return dense_enough(_table(frame, x, y), DensityOptions(radius_nm=50.0, min_neighbours=15))


def _drift(frame, x, y):
    return np.ptp(
        estimate_drift(_table(frame, x, y), DriftOptions(), pixel_size_nm=100.0).table["dx_nm"]
    )


def _applied(frame, x, y):
    table = _table(frame, x, y)
    drift = no_drift(_table(FRAME, X, Y), "by hand")
    drift.table["dx_nm"] = 2.0
    return apply_drift(table, drift)["x_nm"].to_numpy()


SUBJECTS = (
    Subject("corrections.density.dense_enough", _dense, (FRAME, X, Y), ordered=True),
    Subject(
        "corrections.drift.cross_correlation.estimate_drift",
        lambda: None,
        own={
            "100 nm": lambda: word_for(lambda: _drift(FRAME, X, Y)),
            "in another order": lambda: digits(
                _drift(FRAME[::-1], X[::-1], Y[::-1]), _drift(FRAME, X, Y)
            ),
            "in single precision": lambda: digits(
                _drift(FRAME, X.astype(np.float32), Y.astype(np.float32)),
                _drift(
                    FRAME, X.astype(np.float32).astype(float), Y.astype(np.float32).astype(float)
                ),
            ),
            "all at one place": lambda: word_for(lambda: _drift(FRAME, 0 * X, 0 * Y)),
            "nothing": lambda: word_for(lambda: _drift(FRAME[:0], X[:0], Y[:0])),
            "a single row": lambda: word_for(lambda: _drift(FRAME[:1], X[:1], Y[:1])),
            "a nan": lambda: word_for(lambda: _drift(FRAME, np.where(FRAME == 3, np.nan, X), Y)),
            "a place at 1e15 nm": lambda: word_for(
                lambda: _drift(FRAME, np.where(FRAME == 3, 1e15, X), Y)
            ),
        },
    ),
    Subject("corrections.drift.drift.apply_drift", _applied, (FRAME, X, Y)),
    Subject(
        "corrections.quality.passes_quality",
        lambda sd: passes_quality(pd.DataFrame({"uncertainty_nm": sd}), QualityOptions()),
        (RNG.uniform(10.0, 90.0, 50),),
    ),
)

EXEMPT: dict[str, str] = {}
