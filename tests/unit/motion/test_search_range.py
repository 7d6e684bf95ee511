"""The search range that spots themselves tell."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.motion.search_range import choose_search_range


def choose(table, memory=0):
    frame, x, y = (table[name].to_numpy() for name in ("frame", "x_nm", "y_nm"))
    return choose_search_range(frame, x, y, memory_frames=memory)


def steps_of(table):
    out = []
    for _, part in table.groupby("truth"):
        near = np.diff(part["frame"]) == 1
        out.append(np.hypot(np.diff(part["x_nm"]), np.diff(part["y_nm"]))[near])
    return np.concatenate(out)


@pytest.mark.parametrize(
    ("particles", "diffusion", "box", "missing"),
    [
        (30, 0.1, 20_000.0, 0.0),
        (1, 0.1, 20_000.0, 0.1),
        (100, 0.5, 12_000.0, 0.1),
        (60, np.geomspace(0.005, 0.5, 60), 25_000.0, 0.05),
        (30, 0.0, 20_000.0, 0.2),
    ],
)
def test_hardly_a_step_is_longer_than_the_range(swimming, particles, diffusion, box, missing):
    table = swimming(
        np.random.default_rng(1), particles, 300,
        diffusion_um2_s=diffusion, box_nm=box, missing=missing,
    )  # fmt: skip
    found = choose(table)
    steps = steps_of(table)
    assert np.mean(steps > found.range_nm) < 2e-3
    assert found.range_nm < 2.2 * np.quantile(steps, 0.9995)
    assert found.step_sd_nm == pytest.approx(np.sqrt(np.mean(steps**2) / 2), rel=0.06)
    assert not found.cut


def test_missing_frames_ask_for_a_longer_range(swimming):
    table = swimming(np.random.default_rng(2), 20, 200)
    near, far = choose(table, 0), choose(table, 8)
    assert 1.5 < far.range_nm / near.range_nm < 3.0


def test_a_crowd_that_outruns_its_spacing_is_told(swimming):
    crowd = swimming(np.random.default_rng(3), 200, 60, diffusion_um2_s=5.0, box_nm=8_000.0)
    found = choose(crowd)
    assert found.cut or found.false_share > 0.1


def test_the_unit_of_length_does_not_matter(swimming):
    table = swimming(np.random.default_rng(4), 20, 100)
    large = table.assign(x_nm=1e3 * table["x_nm"], y_nm=1e3 * table["y_nm"])
    assert choose(large).range_nm == pytest.approx(1e3 * choose(table).range_nm, rel=0.02)


def test_few_spots_tell_nothing(swimming):
    table = swimming(np.random.default_rng(5), 1, 15)
    assert choose(table) is None
    assert choose(table[table["frame"] % 2 == 0]) is None
