from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.afm.calibration import Scale, commonest_length, scale_of


def test_the_commonest_length_is_that_of_whole_rods():
    rng = np.random.default_rng(0)
    whole = rng.normal(430.0, 4.0, 12)
    broken, pairs = rng.uniform(60.0, 400.0, 10), rng.normal(860.0, 8.0, 3)
    found = commonest_length(np.concatenate([broken, whole, pairs]), 444.0)
    assert found == pytest.approx(430.0, abs=6.0)
    assert commonest_length(np.array([10.0]), 444.0) == 444.0
    assert commonest_length(np.array([400.0, 420.0]), 444.0) == 410.0


def test_the_scale_is_the_ratio_of_means_with_its_error():
    rng = np.random.default_rng(1)
    pulls = []
    for _ in range(400):
        scale = scale_of(rng.normal(400.0, 5.0, 20), 440.0)
        pulls.append((scale.factor - 1.1) / scale.sd)
    assert np.std(pulls) == pytest.approx(1.0, abs=0.12)
    assert abs(np.mean(pulls)) < 0.15


def test_one_far_length_does_not_move_the_scale():
    lengths = np.random.default_rng(2).normal(440.0, 1.0, 10)
    scale = scale_of(np.append(lengths, 480.0), 440.0)
    assert scale.rods == 10
    assert scale.factor == pytest.approx(440.0 / lengths.mean())


def test_a_scale_differs_by_its_error_and_by_one_per_cent():
    assert not Scale(1.005, 1e-4, 50).differs
    assert Scale(1.05, 0.01, 5).differs
    assert not Scale(1.05, 0.02, 5).differs
    assert Scale(1.05, math.nan, 1).differs
    one = scale_of(np.array([400.0]), 440.0)
    assert (one.factor, one.rods) == (pytest.approx(1.1), 1)
    assert math.isnan(one.sd)
