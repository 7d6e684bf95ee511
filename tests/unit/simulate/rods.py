"""Rods that take no time: their result is a plain function of what they are given."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from rotortrack.errors import RodError
from rotortrack.settings import Layer
from rotortrack.simulate.rod.ends import RodEnd
from rotortrack.simulate.rod.observe import Observation
from rotortrack.simulate.scene import Scene, make_scene

GRID: dict[str, Any] = {
    "lambda_eff": [0.1, 0.2, 0.4],
    "flow_ratio": [90, 130],
    "offset_x_nm": [0, 40],
    "offset_y_nm": [3, 8],
}


def scene(sections: dict[str, dict[str, Any]] | None = None, **scan: Any) -> Scene:
    """A scene with a short rod and a grid of twelve runs."""
    values = {"rod": {"n_vertices": 5}, "scan": {**GRID, **scan}, **(sections or {})}
    return make_scene([Layer("test", values)])


class FakeRods:
    """Stands for `simulate_rod`: counts its calls, and fails or stops where it is told to."""

    def __init__(self) -> None:
        self.calls: list[tuple[Any, Any, Any, Any]] = []
        self.stop_after: int | None = None
        self.broken_at = -1.0

    def __call__(self, rod, start, stepping, field=None, thermal=None):
        if self.stop_after is not None and len(self.calls) >= self.stop_after:
            raise KeyboardInterrupt
        self.calls.append((rod, start, field, thermal))
        if rod.lambda_eff == self.broken_at:
            raise RodError("the rod became infinite in step 7: give a smaller step")
        seed = 0 if thermal is None else thermal.seed
        rng = np.random.default_rng(
            [int(1e6 * rod.lambda_eff), int(rod.flow_ratio), int(start.offset_x_nm), seed]
        )
        ends = list(RodEnd)
        time_us = np.arange(0.0, stepping.duration_us, stepping.sample_us)
        rate = rng.normal() * (-1.0 if start.mirrored else 1.0)
        run = SimpleNamespace(
            time_us=time_us,
            simulated_us=float(time_us[-1]),
            positions_nm=rng.normal(size=(2, rod.n_vertices, 3)),
            turned_rad=rate * time_us,
            end=ends[int(rng.integers(len(ends)))],
            n_steps=int(rng.integers(1000)),
            numbers=SimpleNamespace(deepest_nm=float(rng.normal())),
        )
        seen = {name: rng.uniform(50, 450) for name in Observation.__annotations__}
        seen |= {"rate_rev_s": rate, "shape": "U", "handedness": -1}
        return SimpleNamespace(run=run, seen=Observation(**seen))
