"""The error budget of a steady rate, against runs of its own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rotortrack.errors import RodError
from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.rod.budget import rate_budget, refined
from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.run import run_rod

FIELD = embedded_table()
ROD = RodOptions()
START = place_rod(ROD, StartOptions(offset_x_nm=40.0, offset_y_nm=8.0), membrane_nm=20.0)


@pytest.fixture(scope="module")
def run():
    return run_rod(ROD, SteppingOptions(duration_us=300.0), START, FIELD)


def test_each_part_is_what_its_cause_changes(run):
    budget = rate_budget(run, FIELD)
    assert budget.stepping < 1e-6
    assert 0.003 <= budget.field < 0.01
    fine = RodOptions(n_vertices=101, wall_stiffness_pn_nm=2.5)
    longer = dataclasses.replace(run.stepping, duration_us=300.0)
    other = run_rod(fine, longer, refined(run.positions_nm[-1]), FIELD).numbers.rate_rad_us
    rate = run.numbers.rate_rad_us
    assert budget.vertices == pytest.approx(abs(other / rate - 1.0), rel=1e-2)
    assert budget.total >= max(budget.field, budget.vertices, budget.stepping)


def test_refined_links_are_half_as_long_and_on_the_chain():
    along = np.linspace(0.0, 2.0, 51)
    arc = 225.0 * np.stack([np.cos(along), np.sin(along), 0 * along], axis=1)
    fine = refined(arc)
    lengths = np.linalg.norm(np.diff(fine, axis=0), axis=1)
    np.testing.assert_allclose(lengths, np.linalg.norm(arc[1] - arc[0]) / 2.0, rtol=1e-12)
    np.testing.assert_allclose(np.hypot(fine[:, 0], fine[:, 1]), 225.0, atol=0.2)


def test_what_does_not_rotate_steadily_has_none():
    still = RodOptions(lambda_eff=0.05, flow_ratio=90.0)
    docked = run_rod(still, SteppingOptions(duration_us=100.0), START, FIELD)
    with pytest.raises(RodError, match="rotates steadily"):
        rate_budget(docked, FIELD)
