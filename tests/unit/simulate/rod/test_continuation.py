"""Branches of steadily rotating shapes: round their folds, against Newton, time steps, symmetry."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rotortrack.errors import RodError
from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.rod import continuation
from rotortrack.simulate.rod.continuation import BranchEnd, follow_branch
from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.relative_equilibrium import find_equilibrium
from rotortrack.simulate.rod.run import run_rod

ROD = RodOptions(lambda_eff=0.26, flow_ratio=130.0)
FIELD = embedded_table()
WIDE = (100.0, 170.0)


@pytest.fixture(scope="module")
def state():
    start = place_rod(ROD, StartOptions(offset_x_nm=40.0, offset_y_nm=8.0), membrane_nm=20.0)
    run = run_rod(ROD, SteppingOptions(duration_us=300.0), start, FIELD)
    return find_equilibrium(ROD, FIELD, run.positions_nm[-1])


@pytest.fixture(scope="module")
def branch(state):
    return follow_branch(ROD, FIELD, state, WIDE)


def at(ratio):
    return dataclasses.replace(ROD, flow_ratio=float(ratio))


def test_a_branch_between_two_folds_closes(state, branch):
    assert branch.end is BranchEnd.CLOSED
    assert len(branch.folds) == 2
    assert branch.flow_ratio[0] == branch.flow_ratio[-1] == 130.0
    assert branch.omega_rad_us[-1] == state.omega_rad_us
    low, high = sorted(branch.flow_ratio[branch.folds])
    assert low == branch.flow_ratio.min()
    assert high == branch.flow_ratio.max()
    assert (np.diff(branch.arc_nm) > 0.0).all()


def test_at_a_fold_one_rate_passes_zero(branch):
    for fold in branch.folds:
        assert np.abs(branch.rates_per_us[fold]).min() < 1e-4
        assert abs(branch.ratio_slope[fold]) < 1e-6
        growing = (branch.rates_per_us[[fold - 1, fold + 1]].real > 0.0).sum(axis=1)
        assert abs(np.diff(growing)) == 1


def test_both_stable_and_unstable_shapes_are_found(branch):
    assert branch.stable[0]
    assert 5 < branch.stable.sum() < len(branch.stable) - 5


def test_each_point_is_a_state_of_its_ratio(branch):
    for i in range(0, len(branch.arc_nm), 6):
        found = find_equilibrium(at(branch.flow_ratio[i]), FIELD, branch.positions_nm[i])
        assert found.iterations <= 1
        assert found.omega_rad_us == pytest.approx(branch.omega_rad_us[i], rel=1e-6)
        assert found.is_stable == branch.stable[i]


def test_a_rod_moved_to_the_next_point_in_time_takes_its_shape_and_rate(branch):
    for i in np.flatnonzero(branch.stable[:5])[1:]:
        run = run_rod(
            at(branch.flow_ratio[i]),
            SteppingOptions(duration_us=200.0),
            branch.positions_nm[i - 1],
            FIELD,
        )
        assert run.numbers.rate_rad_us == pytest.approx(branch.omega_rad_us[i], rel=1e-5)


def test_beyond_the_fold_a_rod_turns_in_another_state(branch):
    fold = branch.folds[np.argmax(branch.flow_ratio[branch.folds])]
    beyond = at(branch.flow_ratio[fold] + 1.0)
    run = run_rod(beyond, SteppingOptions(duration_us=100.0), branch.positions_nm[fold], FIELD)
    assert abs(run.numbers.rate_rad_us / branch.omega_rad_us[fold] - 1.0) > 0.01


def test_a_mirror_image_has_the_same_folds_and_opposite_rates_the_other_way_round(state, branch):
    image = find_equilibrium(ROD, FIELD, state.positions_nm * [1.0, -1.0, 1.0])
    other = follow_branch(ROD, FIELD, image, WIDE, upwards=False)
    assert other.end is BranchEnd.CLOSED
    np.testing.assert_allclose(
        np.sort(other.flow_ratio[other.folds]),
        np.sort(branch.flow_ratio[branch.folds]),
        rtol=1e-6,
    )
    np.testing.assert_allclose(
        np.sort(-other.omega_rad_us[other.folds]),
        np.sort(branch.omega_rad_us[branch.folds]),
        rtol=1e-4,
    )


@pytest.mark.parametrize("upwards", [True, False])
def test_a_branch_ends_beyond_a_limit(state, upwards):
    branch = follow_branch(ROD, FIELD, state, (129.5, 130.5), upwards=upwards, step_nm=0.5)
    assert branch.end is BranchEnd.LIMIT
    assert (branch.flow_ratio[-1] > 130.5) == upwards
    assert ((branch.flow_ratio[:-1] >= 129.5) & (branch.flow_ratio[:-1] <= 130.5)).all()


def test_a_branch_ends_with_its_points(state):
    branch = follow_branch(ROD, FIELD, state, WIDE, most_points=3)
    assert branch.end is BranchEnd.MOST_POINTS
    assert branch.positions_nm.shape == (3, 51, 3)


def test_a_branch_without_a_next_point_is_lost(state, monkeypatch):
    monkeypatch.setattr(continuation._Curve, "go", lambda *_: (None, 0))
    branch = follow_branch(ROD, FIELD, state, WIDE)
    assert branch.end is BranchEnd.LOST
    assert len(branch.arc_nm) == 1


def test_limits_that_leave_out_the_start_are_refused(state):
    with pytest.raises(RodError, match="is not between 131 and 140"):
        follow_branch(ROD, FIELD, state, (131.0, 140.0))


def test_a_state_of_another_rod_is_refused(state):
    with pytest.raises(RodError, match="no steadily rotating shape of this rod"):
        follow_branch(at(131.0), FIELD, state, WIDE)


def test_a_rod_without_charge_has_no_ratio(state):
    with pytest.raises(RodError, match="lambda_eff above 0"):
        follow_branch(dataclasses.replace(ROD, lambda_eff=0.0), FIELD, state, WIDE)
