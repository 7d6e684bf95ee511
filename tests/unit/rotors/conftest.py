"""Positions on rings and fields of them, shared by the tests of rotors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest


@pytest.fixture
def ring() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """Give `simulate(rng, n, radius, noise, arc_deg)` -> x, y about the origin."""

    def simulate(rng, n, radius, noise, arc_deg=360.0):
        theta = np.radians(rng.uniform(0.0, arc_deg, n))
        return (
            radius * np.cos(theta) + noise * rng.normal(size=n),
            radius * np.sin(theta) + noise * rng.normal(size=n),
        )

    return simulate


@pytest.fixture
def field(ring) -> Callable[..., pd.DataFrame]:
    """Give `simulate(rng, centres, ...)`: a table with one ring a centre, plus background.

    `site` tells the truth: number of the centre, -1 for background.
    """

    def simulate(rng, centres, n=500, radius=100.0, noise=15.0, frames=1000, background=0):
        parts = []
        for site, (x, y) in enumerate(centres):
            frame = np.sort(rng.permutation(frames)[:n])
            dx, dy = ring(rng, n, radius, noise)
            parts.append(
                pd.DataFrame({"frame": frame, "x_nm": x + dx, "y_nm": y + dy, "site": site})
            )
        low, high = np.min(centres, axis=0) - 700.0, np.max(centres, axis=0) + 700.0
        spots = rng.uniform(low, high, (background, 2))
        frame = rng.integers(0, frames, background)
        parts.append(
            pd.DataFrame({"frame": frame, "x_nm": spots[:, 0], "y_nm": spots[:, 1], "site": -1})
        )
        return pd.concat(parts, ignore_index=True).assign(uncertainty_nm=noise, photons=1000.0)

    return simulate
