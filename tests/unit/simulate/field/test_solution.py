"""Values of a solution at points, its error estimates, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError, InputError, UsageError
from rotortrack.simulate.field.mesh import Rim
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.solution import FIELD_QUANTITIES
from rotortrack.simulate.field.solve import as_solution, field_grid, solve_field, solve_on


@pytest.fixture(scope="module")
def solution():
    return solve_field(FieldOptions(accuracy="fast"))


@pytest.fixture(scope="module")
def rounded():
    options = FieldOptions(rim_radius_nm=2.0)
    return as_solution(options, solve_on(options, field_grid(options, 0.7, 2.5)))


def test_error_estimates_hold_within_a_factor_3(solution):
    options = solution.options
    best = solve_on(options, field_grid(options, 0.04, 1.8))
    flow = abs(solution.flow_m3_s / best.flow_m3_s - 1)
    current = abs(solution.current_a / best.current_a - 1)
    assert flow / 3 < solution.flow_error_rel < 3 * flow
    assert current / 3 < solution.current_error_rel < 3 * current


def test_nodes_give_back_their_values(solution):
    r, z = solution.space.points
    velocity = solution.evaluate("u_z", r, z)
    np.testing.assert_allclose(velocity, solution.velocity[1], atol=1e-9)
    potential = solution.evaluate("potential", r, z)
    np.testing.assert_allclose(potential, solution.scales.thermal_v * solution.ions.phi, atol=1e-9)


def test_slopes_are_those_of_the_potential(solution):
    rng = np.random.default_rng(1)
    r, z = rng.uniform(30, 400, 200), rng.uniform(20, 400, 200)
    step = 1e-4
    rise = solution.evaluate("potential_applied", r, z + step)
    rise -= solution.evaluate("potential_applied", r, z - step)
    field = solution.evaluate("e_applied_z", r, z)
    np.testing.assert_allclose(field, -rise / (2e-9 * step), rtol=1e-2, atol=5)


def test_field_and_flow_point_to_cis_inside_the_pore(solution):
    z = np.linspace(-9, 9, 7)
    assert (solution.evaluate("e_applied_z", 0.0, z) > 0).all()
    assert (solution.evaluate("u_z", 0.0, z) > 0).all()
    centre = solution.evaluate("e_applied_z", 0.0, 0.0)
    assert centre == pytest.approx(1.38e6, rel=1e-2)
    assert solution.evaluate("u_z", 0.0, 0.0) == pytest.approx(16.8, rel=2e-2)
    assert solution.evaluate("potential_applied", 0.0, 0.0) == pytest.approx(0.05, rel=4e-2)


def test_field_far_out_is_that_of_the_trial(solution):
    assert solution.evaluate("e_applied_r", 100.0, 12.0) == pytest.approx(5.4e4, rel=5e-2)
    assert solution.evaluate("e_applied_r", 200.0, 12.0) == pytest.approx(1.26e4, rel=3e-2)


def test_parts_of_the_field_behave_as_named(solution):
    near_wall = solution.evaluate_all(("e_equilibrium_z", "e_applied_z"), 150.0, [10.2, 60.0])
    # A negative wall pulls toward itself, and is screened 50 nm away.
    assert near_wall["e_equilibrium_z"][0] < -1e6
    assert abs(near_wall["e_equilibrium_z"][1]) < 10.0


def test_radial_parts_vanish_on_the_axis(solution):
    z = np.linspace(-400, 400, 41)
    for name in ("e_applied_r", "e_equilibrium_r", "lnc_r", "u_r"):
        assert not solution.evaluate(name, 0.0, z).any()


def test_walls_hold_no_flow_and_belong_to_the_fluid(solution, rounded):
    r = np.array([25.0, 25.0, 100.0, 100.0])
    z = np.array([0.0, 5.0, 10.0, -10.0])
    for solved in (solution, rounded):
        assert np.abs(solved.evaluate("u_z", r, z)).max() < 1e-9
    arc = np.linspace(0, np.pi / 2, 9)
    r, z = 27 - 2 * np.cos(arc), 8 + 2 * np.sin(arc)
    assert np.abs(rounded.evaluate("u_z", r, z)).max() < 0.05


def test_all_quantities_are_finite_in_the_whole_box(solution, rounded):
    rng = np.random.default_rng(2)
    r, z = 500 * rng.random(2000) ** 2, rng.uniform(-500, 500, 2000)
    fluid = (r < 25) | (np.abs(z) > 10)
    for solved in (solution, rounded):
        for values in solved.evaluate_all(FIELD_QUANTITIES, r[fluid], z[fluid]).values():
            assert np.isfinite(values).all()


def test_salt_is_neutral_far_from_walls(solution):
    ions = solution.evaluate_all(("cation_mm", "anion_mm"), 200.0, [60.0, -60.0])
    np.testing.assert_allclose(ions["cation_mm"], ions["anion_mm"], rtol=1e-5)


@pytest.mark.parametrize(("r", "z"), [(100.0, 0.0), (501.0, 50.0), (10.0, 600.0), (np.nan, 0.0)])
def test_points_outside_the_fluid_are_refused(solution, r, z):
    with pytest.raises(InputError):
        solution.evaluate("u_z", r, z)


def test_unknown_quantity_is_refused_with_the_known_ones(solution):
    with pytest.raises(UsageError, match="e_applied_r"):
        solution.evaluate("e_r", 0.0, 0.0)


@settings(deadline=None)
@given(
    x=st.floats(-3, 3),
    y=st.floats(-3, 3),
    radius=st.floats(0.2, 5),
)
def test_rounding_is_inverted_everywhere_in_the_fluid(x, y, radius):
    if x > 0 and y < 0:
        return
    rim = Rim(pore_nm=25.0, half_nm=10.0, radius_nm=radius)
    sharp = np.array([[25.0 + x], [10.0 + y]])
    found = rim.undisplaced(rim.displaced(sharp))
    np.testing.assert_allclose(rim.displaced(found), rim.displaced(sharp), atol=1e-6)


def test_rounded_rim_is_an_arc():
    rim = Rim(pore_nm=25.0, half_nm=10.0, radius_nm=2.0)
    along = np.linspace(0, 2, 11)
    wall = rim.displaced(np.stack([np.full(11, 25.0), 10 - along]))
    face = rim.displaced(np.stack([25 + along, np.full(11, 10.0)]))
    for r, z in (wall, face):
        np.testing.assert_allclose(np.hypot(r - 27, z - 8), 2.0)


def test_impossible_geometries_are_refused_together():
    with pytest.raises(ConfigurationError) as caught:
        FieldOptions(box_radius_nm=30.0, box_height_nm=50.0, rim_radius_nm=9.0)
    assert len(caught.value.mistakes) == 3


def test_uncharged_pore_has_no_flow_and_no_error_of_it():
    options = FieldOptions(
        accuracy="fast", surface_charge_e_nm2=0.0, box_radius_nm=60.0, box_height_nm=130.0
    )
    solved = solve_field(options)
    assert abs(solved.flow_m3_s) < 1e-27
    assert solved.flow_error_rel == 0
