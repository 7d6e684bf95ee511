"""Steps of the rod where they are hardest: each case is one that a trial met."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from rotortrack.errors import RodError
from rotortrack.simulate.rod.elasticity import bending_energy
from rotortrack.simulate.rod.ends import RodEnd
from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.parameters import rod_parameters
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.run import run_rod

_spec = importlib.util.spec_from_file_location(
    "rod_steps", Path(__file__).parents[1] / "unit" / "simulate" / "rod" / "steps.py"
)
assert _spec is not None
_steps = importlib.util.module_from_spec(_spec)
sys.modules["rod_steps"] = _steps
_spec.loader.exec_module(_steps)
arc, at, straight = _steps.arc, _steps.at, _steps.straight
toy_field, uniform_field = _steps.toy_field, _steps.uniform_field


def link_error(run):
    lengths = np.linalg.norm(np.diff(run.positions_nm, axis=1), axis=2)
    return np.abs(lengths / lengths[0, 0] - 1.0).max()


def test_200000_vanishing_steps_keep_lengths_and_agree_with_long_ones():
    short = run_rod(
        RodOptions(n_vertices=5, length_nm=36.0),
        SteppingOptions(duration_us=4e-3, sample_us=1e-3, max_step_us=2e-8),
        arc(5),
    )
    assert short.n_steps == 200_000
    assert short.n_rejected == 0
    assert link_error(short) < 2e-9
    long = run_rod(
        RodOptions(n_vertices=5, length_nm=36.0),
        SteppingOptions(duration_us=4e-3, sample_us=1e-3, tolerance_nm=1e-8),
        arc(5),
    )
    np.testing.assert_allclose(short.positions_nm, long.positions_nm, atol=1e-6)


def test_huge_flow_is_followed_with_links_at_their_length():
    rod = RodOptions(lambda_eff=1.0, flow_ratio=1e4)
    run = run_rod(
        rod,
        SteppingOptions(duration_us=1.0, sample_us=0.05),
        place_rod(rod, StartOptions(), membrane_nm=20.0),
        toy_field(),
    )
    assert run.simulated_us == 1.0
    assert np.isfinite(run.positions_nm).all()
    assert link_error(run) < 2e-9


def test_step_limit_is_told_from_the_end_of_time():
    limited = run_rod(RodOptions(), SteppingOptions(duration_us=50.0, max_steps=20), arc())
    assert limited.end is RodEnd.STEP_LIMIT
    assert limited.n_steps + limited.n_rejected == 20
    assert limited.simulated_us < 50.0
    assert "max_steps" in limited.end.sentence
    whole = run_rod(RodOptions(), SteppingOptions(duration_us=50.0), arc())
    assert whole.end is RodEnd.TIME_REACHED
    assert whole.simulated_us == 50.0


def poisoned_field(below_nm):
    """A uniform field that holds NaN below a height."""
    field = uniform_field(e_z_v_m=1e5)
    field.nodes[:, field.z_nm < below_nm] = np.nan
    return field


@pytest.mark.parametrize("method", ["implicit", "explicit", "paper"])
def test_nan_in_the_field_is_an_error_that_names_the_step(method):
    rod = RodOptions(wall="none", flow_ratio=0.0)
    stepping = SteppingOptions(method=method, duration_us=2.0, step_us=4e-4)
    start = at(straight(), 0.0, 0.0, 60.0)
    with pytest.raises(RodError, match=r"^step [1-9][0-9]* at [0-9.e-]+ us.*finite") as caught:
        run_rod(rod, stepping, start, poisoned_field(0.0))
    assert "step 1 at 0 us" not in str(caught.value)


def test_nan_at_the_start_names_step_1():
    rod = RodOptions(wall="none", flow_ratio=0.0)
    with pytest.raises(RodError, match=r"^step 1 at 0 us"):
        run_rod(rod, SteppingOptions(), straight(), poisoned_field(300.0))


def test_folded_joint_is_an_error_and_not_a_wild_step():
    links = np.array([[1, 0, 0], [1, 0, 0], [-0.95, np.sqrt(1 - 0.95**2), 0], [-1, 0, 0]])
    x = np.concatenate([np.zeros((1, 3)), np.cumsum(9.0 * links, axis=0)])
    with pytest.raises(RodError, match="degrees"):
        run_rod(RodOptions(n_vertices=5, length_nm=36.0), SteppingOptions(), x)


def test_sharply_bent_joint_opens_in_stable_steps():
    """140 degrees in one joint: its stiffness is 70 times that of a straight one."""
    angle = np.radians(140.0)
    links = np.tile([1.0, 0.0, 0.0], (20, 1))
    links[10:] = [np.cos(angle), np.sin(angle), 0.0]
    x = np.concatenate([np.zeros((1, 3)), np.cumsum(9.0 * links, axis=0)])
    rod = RodOptions(n_vertices=21, length_nm=180.0)
    run = run_rod(rod, SteppingOptions(duration_us=50.0), x)
    energy = [bending_energy(shape, rod_parameters(rod, None)) for shape in run.positions_nm]
    # Until what is left of it is round-off.
    assert np.all(np.diff(energy[:50]) < 0.0)
    assert np.linalg.norm(run.positions_nm[-1, -1] - run.positions_nm[-1, 0]) > 179.9
    assert link_error(run) < 2e-9


def test_straight_rod_in_the_mirror_plane_stays_in_it():
    """No direction of turning is picked by round-off."""
    rod = RodOptions()
    start = place_rod(rod, StartOptions(offset_y_nm=0.0, tilt_deg=0.0), membrane_nm=20.0)
    run = run_rod(rod, SteppingOptions(duration_us=20.0), start, toy_field())
    assert np.abs(run.positions_nm[:, :, 1]).max() == 0.0
    assert np.abs(run.turned_rad).max() == 0.0


def test_rod_on_the_axis_meets_no_division_by_zero():
    rod = RodOptions()
    start = at(straight(direction=(0, 0, 1)), 0.0, 0.0, 260.0)
    run = run_rod(rod, SteppingOptions(duration_us=5.0), start, toy_field())
    assert np.isfinite(run.positions_nm).all()
    assert np.abs(run.positions_nm[:, :, :2]).max() < 1e-9


def test_rod_far_outside_the_table_goes_on():
    rod = RodOptions()
    start = at(straight(), 0.0, 3000.0, 3000.0)
    run = run_rod(rod, SteppingOptions(duration_us=20.0), start, toy_field())
    assert run.end is RodEnd.NOT_DOCKED
    assert np.isfinite(run.positions_nm).all()


def test_explicit_steps_beyond_stability_end_in_an_error_or_stay_finite():
    rod = RodOptions()
    stepping = SteppingOptions(method="explicit", step_us=5e-3, duration_us=1.0)
    with pytest.raises(RodError, match=r"^step [0-9]+ at .*(finite|folds)"):
        run_rod(rod, stepping, arc(radius_nm=90.0))


def test_ends_that_barely_touch_the_wall_do_not_chatter():
    """Extrapolation through contact and its loss kept two ends hopping, and the steps short."""
    rod = RodOptions(lambda_eff=0.2, flow_ratio=60.0)
    start = place_rod(rod, StartOptions(offset_x_nm=10.0, offset_y_nm=8.0), membrane_nm=20.0)
    stepping = SteppingOptions(duration_us=200.0, sample_us=1.0)
    run = run_rod(rod, stepping, start, toy_field(strength=0.3, slip=0.5))
    assert run.n_steps + run.n_rejected < 1000
    ends = run.positions_nm[-50:, [0, -1], 2]
    assert np.ptp(ends, axis=0).max() < 1e-3
