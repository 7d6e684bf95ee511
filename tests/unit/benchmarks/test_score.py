"""The benchmark's scores are right where the answer is known beforehand."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

_path = Path(__file__).parents[2] / "benchmarks" / "score.py"
_spec = importlib.util.spec_from_file_location("benchmark_score", _path)
score = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(score)


def truth(rng, n, frames, photons=800.0, read_noise_e=1.6):
    return {
        "frame": np.sort(rng.integers(0, frames, n)),
        "x_px": rng.uniform(2, 254, n),
        "y_px": rng.uniform(2, 254, n),
        "photons": np.full(n, photons),
        "background": 8.0,
        "sigma_px": 1.25,
        "read_noise_e": np.asarray(read_noise_e),
    }


def found_as(true, which=slice(None), **changes):
    found = {key: true[key][which].copy() for key in ("frame", "x_px", "y_px", "photons")}
    found |= {key: np.full(len(found["frame"]), 0.1) for key in ("x_sd_px", "y_sd_px")}
    return found | changes


def test_noise_of_known_size_gives_its_own_error_bias_and_pull():
    rng = np.random.default_rng(1)
    # Few in a frame, so that nobody takes a neighbour's place.
    true = truth(rng, 20_000, 20_000)
    found = found_as(true)
    found["x_px"] += rng.normal(0.02, 0.1, 20_000)
    found["y_px"] += rng.normal(0.0, 0.1, 20_000)
    found["photons"] *= 1.03
    scores = score.score(true, found)
    assert scores["recall"] == scores["precision"] == 1.0
    expected = np.sqrt(0.1**2 + 0.02**2 / 2)
    # Twice the emitters as samples: 0.4 % on a standard deviation.
    assert scores["rmse_px"] == pytest.approx(expected, rel=0.02)
    assert scores["pull"] == pytest.approx(expected / 0.1, rel=0.02)
    assert scores["bias_x_px"] == pytest.approx(0.02, abs=5 * scores["bias_se_px"])
    assert scores["bias_y_px"] == pytest.approx(0.0, abs=5 * scores["bias_se_px"])
    assert scores["photon_bias"] == pytest.approx(0.03)


def test_an_efficient_estimator_has_error_over_bound_one():
    rng = np.random.default_rng(2)
    true = truth(rng, 20_000, 20_000)
    inside = np.flatnonzero((np.abs(true["x_px"] - 128) < 120) & (np.abs(true["y_px"] - 128) < 120))
    sd = score.bound(true, inside)
    found = found_as(true, inside, x_sd_px=sd[0], y_sd_px=sd[1])
    for axis, own in zip(("x_px", "y_px"), sd, strict=True):
        found[axis] += rng.normal(0.0, own)
    scores = score.score(true, found)
    assert scores["error_over_bound"] == pytest.approx(1.0, abs=0.02)
    assert scores["pull"] == pytest.approx(1.0, abs=0.02)
    assert scores["recall"] == pytest.approx(len(inside) / 20_000)


def test_missed_false_and_far_spots_count():
    true = truth(np.random.default_rng(3), 100, 100)
    true["frame"] = np.arange(100)
    true["x_px"] = true["y_px"] = np.full(100, 100.0)
    found = found_as(true, slice(0, 80))
    found["x_px"][:10] += score.MATCH_PX + 0.01
    found["x_px"][10:20] += score.MATCH_PX - 0.01
    scores = score.score(true, found)
    assert scores["recall"] == pytest.approx(0.70)
    assert scores["precision"] == pytest.approx(70 / 80)
    # Paired, but too far off to be a fit of this emitter.
    assert scores["isolated"] == 60


def test_pairs_are_one_to_one_the_closest_first_and_of_one_frame():
    spots = {"frame": np.array([0, 0, 1]), "x_px": np.array([10.0, 11.5, 10.0])}
    true = spots | {"y_px": np.full(3, 20.0)}
    found = {
        "frame": np.array([0, 0, 2]),
        "x_px": np.array([11.0, 11.4, 10.0]),
        "y_px": np.full(3, 20.0),
    }
    pairs = set(zip(*(side.tolist() for side in score.match(true, found)), strict=True))
    assert pairs == {(1, 1), (0, 0)}


def test_neighbours_and_the_border_make_an_emitter_not_isolated():
    true = {
        "frame": np.array([0, 0, 1, 1, 2, 2]),
        "x_px": np.array([50.0, 58.9, 50.0, 59.1, 5.9, 250.1]),
        "y_px": np.full(6, 100.0),
    }
    assert score.isolated(true).tolist() == [False, False, True, True, False, False]


def test_nothing_found_is_no_error():
    true = truth(np.random.default_rng(4), 10, 10)
    scores = score.score(true, found_as(true, slice(0, 0)))
    assert scores["recall"] == scores["precision"] == 0.0
    assert np.isnan(scores["error_over_bound"])


def test_the_bound_is_that_of_numerical_derivatives_with_the_pixels_own_noise():
    rng = np.random.default_rng(5)
    maps = rng.uniform(1.0, 12.0, (256, 256))
    true = truth(rng, 3, 3, read_noise_e=maps)
    true["x_px"], true["y_px"] = np.array([[40.2, 90.9, 150.5], [60.7, 33.1, 200.0]])
    limits = score.bound(true, np.arange(3))
    for k in range(3):
        x, y = true["x_px"][k], true["y_px"][k]
        assert limits[:, k] == pytest.approx(_plain_bound(x, y, maps), rel=1e-5)


def _plain_bound(x, y, maps):
    from scipy.stats import norm

    left, top = int(x) - 3, int(y) - 3

    def light(p):
        gx, gy = (
            np.diff(norm.cdf(np.arange(first, first + 8), centre, p[4]))
            for first, centre in ((left, p[0]), (top, p[1]))
        )
        return p[3] + p[2] * np.outer(gy, gx)

    at = np.array([x, y, 800.0, 8.0, 1.25])
    steps = 1e-4 * np.diag([1.0, 1.0, 100.0, 1.0, 1.0])
    slopes = [(light(at + s) - light(at - s)) / (2 * s.sum()) for s in steps]
    weight = 1 / (light(at) + maps[top : top + 7, left : left + 7] ** 2)
    fisher = [[(a * b * weight).sum() for a in slopes] for b in slopes]
    return np.sqrt(np.diag(np.linalg.inv(fisher)))[:2]
