"""Handedness is compared where it is known whether the image is flipped, and nowhere else."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

from rotortrack.twocolour.handedness import compare_hands, compare_hands_with_rods, hands
from rotortrack.twocolour.resampling import GRID_REFUSED

from .planted_groups import FILM, group
from .test_forward import rods


def turning(ccw, cw, mirrored=False, others=2):
    """Make a group with so many driven rotors."""
    names = ("driven_ccw",) * ccw + ("driven_cw",) * cw + ("brownian",) * others
    made = group(1, n=len(names), film=dataclasses.replace(FILM, mirrored=mirrored))
    return dataclasses.replace(made, behaviour=names)


def test_driven_rotors_alone_are_counted_with_an_exact_interval():
    found = hands(turning(7, 3))
    assert (found.ccw, found.n) == (7, 10)
    exact = stats.binomtest(7, 10).proportion_ci(method="exact")
    assert (found.share.low, found.share.high) == pytest.approx((exact.low, exact.high))


def test_a_flipped_image_swaps_both_ways():
    assert hands(turning(7, 3, mirrored=True)).ccw == 3


def test_nothing_is_told_where_the_flip_is_not_known():
    assert hands(turning(7, 3, mirrored=None)) is None


def test_without_behaviours_speeds_count_that_are_surely_not_0():
    made = group(1, n=4)
    made = dataclasses.replace(
        made,
        behaviour=("",) * 4,
        speed_deg_s=np.array([100.0, -100.0, 300.0, np.nan]),
        speed_sd_deg_s=np.array([10.0, 10.0, 200.0, np.nan]),
    )
    found = hands(made)
    assert (found.ccw, found.n) == (1, 2)


def test_p_between_groups_is_that_of_all_permutations_of_rotors():
    found = compare_hands(hands(turning(9, 1)), hands(turning(4, 6)))
    rng = np.random.default_rng(1)
    labels = rng.permuted(np.tile(np.arange(20) < 13, (20_000, 1)), axis=1)
    gap = np.abs(labels[:, :10].mean(axis=1) - labels[:, 10:].mean(axis=1))
    assert found.p == pytest.approx(np.mean(gap >= 0.5 - 1e-9), abs=0.01)
    assert found.difference.value == pytest.approx(0.5)
    assert found.difference.low < 0.5 < found.difference.high


def test_a_scan_is_a_grid_and_gives_a_p_for_a_declared_prior_alone():
    one = hands(turning(9, 1))
    simulated = rods([100.0, 200.0], rate_rev_s=[500.0, -300.0], weight=[0.25, 0.75])
    found = compare_hands_with_rods(one, simulated)
    assert found.second.value == pytest.approx(0.25)
    assert math.isnan(found.p)
    assert found.reason == GRID_REFUSED
    declared = compare_hands_with_rods(one, dataclasses.replace(simulated, declared=True))
    assert declared.p == pytest.approx(stats.binomtest(9, 10, 0.25).pvalue)
    assert declared.reason == ""


def test_groups_without_driven_rotors_say_so():
    none, some = hands(turning(0, 0)), hands(turning(2, 1))
    assert "no driven rotor" in compare_hands(none, some).reason
    assert "no rotor is driven" in compare_hands_with_rods(none, rods([100.0])).reason
