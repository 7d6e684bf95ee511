"""Cells of a scan have the stated weights, which their shapes and runs share."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from rotortrack.errors import InputError
from rotortrack.twocolour.population import rod_population

from .planted_groups import LENGTH_NM, TURNS, scan_tables

# Cell A: one shape from three starts, one of them mirrored, and another shape; cell B: one run.
RUNS = [
    (0.2, 120.0, TURNS, 200.0, 0.0, False),
    (0.2, 120.0, TURNS, 200.0, 0.5, True),
    (0.2, 120.0, TURNS, 200.0, 1.0, False),
    (0.2, 120.0, TURNS, 300.0, 0.0, False),
    (0.26, 130.0, TURNS, 150.0, 0.0, False),
    (0.26, 140.0, "translocated", 150.0, 0.0, False),
]


def weights_of(runs=RUNS, **options):
    return rod_population(*scan_tables(runs), length_nm=LENGTH_NM, **options)


@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        ("cells", [1 / 12, 1 / 12, 1 / 12, 1 / 4, 1 / 2]),
        ("shapes", [1 / 9, 1 / 9, 1 / 9, 1 / 3, 1 / 3]),
        ("runs", [1 / 5] * 5),
    ],
)
def test_weights_are_shared_by_the_stated_rule(weights, expected):
    rods = weights_of(weights=weights)
    assert rods.weight == pytest.approx(expected)
    assert (rods.cells, rods.attractors) == (2, 3)
    assert rods.run.tolist() == [0, 1, 2, 3, 4]
    assert not rods.declared


def test_more_runs_into_one_shape_change_no_histogram():
    once = weights_of([RUNS[0], *RUNS[3:]])
    more = weights_of()
    edges = np.arange(0.0, 401.0, 25.0)
    for rods in (once, more):
        assert rods.weight.sum() == pytest.approx(1.0)
    shares = [
        np.histogram(rods.distance_nm, edges, weights=rods.weight)[0] for rods in (once, more)
    ]
    assert shares[0] == pytest.approx(shares[1])


def test_a_prior_weights_cells_and_leaves_out_those_it_does_not_name():
    prior = pd.DataFrame({"lambda_eff": [0.2], "flow_ratio": [120.0], "weight": [3.0]})
    rods = weights_of(prior=prior)
    assert rods.weight == pytest.approx([1 / 6, 1 / 6, 1 / 6, 1 / 2])
    assert rods.declared
    assert rods.cells == 1


@pytest.mark.parametrize("weight", [-1.0, np.nan, 0.0])
def test_a_prior_without_weights_is_refused(weight):
    prior = pd.DataFrame({"lambda_eff": [0.2], "flow_ratio": [120.0], "weight": [weight]})
    with pytest.raises(InputError, match="prior"):
        weights_of(prior=prior)


def test_a_scan_without_rotating_rods_is_refused_with_what_to_do():
    with pytest.raises(InputError, match="no rod that rotates steadily: simulate other"):
        weights_of([RUNS[-1]])


def test_rings_of_the_dyes_are_seen_about_the_pores_axis():
    rods = weights_of([(0.2, 120.0, TURNS, 200.0, 0.0, False)])
    _, shapes = scan_tables(RUNS[:1])
    ends = np.hypot(shapes[0, [0, -1], 0], shapes[0, [0, -1], 1])
    # The dyes' centres are 10 and 20 nm of the rod's 450 inside its ends.
    assert rods.radius_nm[0] == pytest.approx(ends, rel=0.12)
    assert (rods.radius_nm[0] < ends).all()
