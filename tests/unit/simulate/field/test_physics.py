"""The solver against exact results of electrokinetics."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import i0, i1

from rotortrack.simulate.field.mesh import Grid, graded, pore_grid
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.pnp import FARADAY_C_MOL, Ions, PoissonNernstPlanck, Scales
from rotortrack.simulate.field.solve import field_grid, solve_on
from rotortrack.simulate.field.space import Space
from rotortrack.simulate.field.stokes import Stokes, excess_force

OPTIONS = FieldOptions()
SCALES = Scales.of(OPTIONS)


def coarse(first_nm=0.5, ratio=3.0, **values):
    options = FieldOptions(**values)
    return solve_on(options, field_grid(options, first_nm, ratio))


def neutral(space):
    return Ions(np.zeros(space.n2), np.zeros(space.n2), np.zeros(space.n2))


def charged_plane(first_nm, charge_e_nm2=-0.1):
    scales = Scales.of(FieldOptions(surface_charge_e_nm2=charge_e_nm2))
    z_nm = graded(40.0, first_nm, 1.3, 4.0)
    grid = Grid(
        r_nm=np.array([0.0, 5.0, 10.0]), z_nm=z_nm, solid=np.zeros((2, z_nm.size - 1), dtype=bool)
    )
    space = Space(grid)
    pnp = PoissonNernstPlanck(space, scales, charged=("trans",), ends=("cis",))
    ions = neutral(space)
    pnp.relax_potential(ions)
    return scales, space, ions


def test_debye_length_of_50_mm_is_1_3603_nm():
    assert SCALES.debye_nm == pytest.approx(1.3603, abs=1e-4)


@pytest.mark.parametrize("charge", [-0.4, -0.1, 0.2])
def test_wall_potential_is_grahames_to_2e_4(charge):
    scales, space, ions = charged_plane(0.3, charge)
    exact = 2 * math.asinh(scales.charge_per_nm * scales.debye_nm / 2)
    found = ions.phi[space.boundary("trans")]
    assert found == pytest.approx(exact, rel=2e-4)
    if charge == -0.1:
        assert exact * scales.thermal_v == pytest.approx(-29.868e-3, abs=2e-6)


def test_potential_near_a_plane_is_gouys_and_chapmans():
    scales, space, ions = charged_plane(0.2)
    surface = 2 * math.asinh(scales.charge_per_nm * scales.debye_nm / 2)
    z = space.points[1]
    near = z < 8
    exact = 4 * np.arctanh(math.tanh(surface / 4) * np.exp(-z[near] / scales.debye_nm))
    np.testing.assert_allclose(ions.phi[near], exact, atol=2e-4 * abs(surface))


def test_error_of_the_wall_potential_falls_with_the_fourth_power_of_the_cell():
    scales = SCALES
    exact = 2 * math.asinh(scales.charge_per_nm * scales.debye_nm / 2)
    errors = []
    for cells in (40, 80):
        z_nm = np.linspace(0.0, 30.0, cells + 1)
        solid = np.zeros((2, cells), dtype=bool)
        space = Space(Grid(r_nm=np.array([0.0, 5.0, 10.0]), z_nm=z_nm, solid=solid))
        ions = neutral(space)
        PoissonNernstPlanck(space, scales, charged=("trans",), ends=("cis",)).relax_potential(ions)
        errors.append(abs(ions.phi[space.boundary("trans")][0] - exact))
    assert math.log2(errors[0] / errors[1]) > 3.3


@pytest.mark.parametrize("radius_nm", [1.5, 5.0, 25.0])
def test_flow_in_a_charged_pipe_is_rices_and_whiteheads_to_1e_3(radius_nm):
    # So little charge that the wall is at 0.5 mV, where Poisson's equation is linear.
    kappa = 1 / SCALES.debye_nm
    zeta = -0.5e-3 / SCALES.thermal_v
    slope = zeta * kappa * i1(kappa * radius_nm) / i0(kappa * radius_nm)
    scales = replace(SCALES, charge_per_nm=slope)
    inward = graded(radius_nm, 0.25, 1.3, 2.0)
    r_nm = (radius_nm - inward)[::-1].copy()
    r_nm[0] = 0.0
    space = Space(
        Grid(r_nm=r_nm, z_nm=np.linspace(-5, 5, 6), solid=np.zeros((r_nm.size - 1, 5), dtype=bool))
    )
    ions = neutral(space)
    # Nothing is held: the double layer itself fixes the potential.
    pnp = PoissonNernstPlanck(space, scales, charged=("side",), ends=())
    pnp.relax_potential(ions)
    field_v_m = 1e6
    virtual = -field_v_m * space.points[1] * 1e-9 / scales.thermal_v
    driven = Ions(ions.phi + virtual, virtual, -virtual)
    stokes = Stokes(space, scales, no_slip=("side",), no_radial=("axis", "side", "cis", "trans"))
    velocity = stokes.solve(*excess_force(space, scales, driven))
    permittivity = 78 * 8.8541878128e-12
    plug = -permittivity * zeta * scales.thermal_v * field_v_m / 1e-3 * 1e3
    exact = plug * (1 - i0(kappa * space.points[0]) / i0(kappa * radius_nm))
    error = np.sqrt(np.mean((velocity[1] - exact) ** 2) / np.mean(exact**2))
    assert error < 1e-3
    assert np.abs(velocity[0]).max() < 1e-3 * np.abs(exact).max()


def test_uncharged_pore_conducts_20_15_ns_with_the_exact_end_correction():
    # The closed box adds some conductance: ten times the paper's box leaves 0.1 %.
    answer = coarse(0.1, 1.7, surface_charge_e_nm2=0.0, box_radius_nm=5e3, box_height_nm=1e4)
    conductivity = 0.627
    exact = conductivity * math.pi * 25e-9**2 / (20e-9 + 2 * 0.8217 * 25e-9)
    assert exact == pytest.approx(20.15e-9, rel=1e-3)
    assert answer.current_a / 0.1 == pytest.approx(20.15e-9, rel=2e-3)
    assert abs(answer.flow_m3_s) < 1e-27


def test_thin_membrane_approaches_the_conductance_of_an_aperture():
    answer = coarse(0.1, surface_charge_e_nm2=0.0, membrane_nm=0.5)
    hall = 0.627 / (4 * 0.5e-9 / (math.pi * 50e-9**2) + 1 / 50e-9)
    assert answer.current_a / 0.1 == pytest.approx(hall, rel=2e-2)


def test_papers_pore_carries_2_05_na_and_4e_17_m3_s():
    answer = coarse()
    assert answer.current_a == pytest.approx(2.05e-9, rel=1e-2)
    assert answer.flow_m3_s == pytest.approx(4.0e-17, rel=1e-2)


def test_reversed_voltage_reverses_current_and_flow():
    forward, backward = coarse(1.4, 4.0), coarse(1.4, 4.0, voltage_v=-0.1)
    assert backward.current_a == pytest.approx(-forward.current_a, rel=1e-7)
    assert backward.flow_m3_s == pytest.approx(-forward.flow_m3_s, rel=1e-7)


def test_reversed_charge_with_exchanged_ions_reverses_the_flow():
    plain = coarse(1.4, 4.0)
    mirrored = coarse(
        1.4,
        4.0,
        surface_charge_e_nm2=0.1,
        cation_diffusivity_m2_s=2.03e-9,
        anion_diffusivity_m2_s=1.33e-9,
    )
    assert mirrored.flow_m3_s == pytest.approx(-plain.flow_m3_s, rel=1e-7)
    assert mirrored.current_a == pytest.approx(plain.current_a, rel=1e-7)


def test_flow_is_linear_in_the_voltage_within_2_5_percent_to_200_mv():
    base = coarse(1.4, 4.0, voltage_v=0.05)
    twice = coarse(1.4, 4.0, voltage_v=0.2)
    assert twice.flow_m3_s / base.flow_m3_s == pytest.approx(4, rel=2.5e-2)
    assert twice.current_a / base.current_a == pytest.approx(4, rel=2.5e-2)


def test_volume_flow_through_the_pore_equals_that_through_the_far_end():
    answer = coarse(1.4, 4.0)
    space, velocity = answer.space, answer.velocity
    lumen = (np.abs(space.height) < 10) & (space.radius < 25)
    inside = space.at_points(velocity[1]) * space.weight
    through = 2 * math.pi * inside[lumen].sum() / 20.0 * 1e-21
    assert through == pytest.approx(answer.flow_m3_s, rel=1e-9)


def test_current_through_any_part_of_the_height_is_that_through_the_ends():
    answer = coarse(1.4, 4.0, trans_mm=100.0)
    space, scales, ions = answer.space, answer.scales, answer.ions
    pnp = PoissonNernstPlanck(space, scales)
    flow = [space.at_points(part) for part in answer.velocity]
    charge = np.zeros_like(space.weight)
    for sign, psi, density, diffusivity in zip(
        (1, -1),
        (ions.plus, ions.minus),
        pnp.concentrations(ions),
        (scales.cation_nm2_us, scales.anion_nm2_us),
        strict=True,
    ):
        charge += sign * density * (flow[1] - diffusivity * space.slopes(psi)[1])
    # Between two lines of the mesh: a mean over a height is the flux through each of its planes.
    lines = np.unique(space.points1[1])
    for ends_nm in ((-10.0, 10.0), (-200.0, -40.0), (60.0, 300.0)):
        below, above = (lines[np.abs(lines - at).argmin()] for at in ends_nm)
        within = (space.height > below) & (space.height < above)
        through = 2 * math.pi * np.sum((charge * space.weight)[within]) / (above - below)
        current_a = FARADAY_C_MOL * scales.salt_mm * 1e-21 * through
        assert current_a == pytest.approx(answer.current_a, rel=1e-6)


def test_exchanged_salts_reverse_current_and_flow():
    salts = {"voltage_v": 0.0, "cis_mm": 50.0, "trans_mm": 550.0}
    swapped = {**salts, "cis_mm": 550.0, "trans_mm": 50.0}
    plain, mirrored = coarse(1.4, 4.0, **salts), coarse(1.4, 4.0, **swapped)
    assert mirrored.current_a == pytest.approx(-plain.current_a, rel=1e-6)
    assert mirrored.flow_m3_s == pytest.approx(-plain.flow_m3_s, rel=1e-6)


def test_polarisation_takes_a_sixth_of_the_flow_at_half_a_volt_and_most_of_it_at_1_v():
    base = coarse(1.4, 4.0, voltage_v=0.05).flow_m3_s / 0.05
    losses = [1 - coarse(1.4, 4.0, voltage_v=v).flow_m3_s / (base * v) for v in (0.5, 1.0)]
    np.testing.assert_allclose(losses, [0.16, 0.69], atol=0.015)


def test_without_voltage_nothing_flows():
    answer = coarse(1.4, 4.0, voltage_v=0.0)
    assert answer.flow_m3_s == pytest.approx(0, abs=1e-27)
    assert answer.current_a == pytest.approx(0, abs=1e-18)


def test_salt_gradient_in_three_readings_of_no_voltage():
    salt = {"voltage_v": 0.0, "cis_mm": 50.0, "trans_mm": 550.0}
    fixed, open_circuit, shorted = (
        coarse(1.0, 3.0, **salt, electrical=reading)
        for reading in ("fixed_potential", "zero_current", "shorted_agcl")
    )
    assert fixed.current_a == pytest.approx(-0.98e-9, rel=1e-2)
    assert fixed.flow_m3_s == pytest.approx(5.1e-19, rel=2e-2)
    assert abs(open_circuit.current_a) < 1e-16
    assert open_circuit.voltage_v == pytest.approx(11.6e-3, rel=1e-2)
    assert open_circuit.flow_m3_s == pytest.approx(2.4e-18, rel=2e-2)
    assert shorted.voltage_v == pytest.approx(SCALES.thermal_v * math.log(11))
    assert shorted.current_a == pytest.approx(4.4e-9, rel=1e-2)
    assert shorted.flow_m3_s == pytest.approx(1.16e-17, rel=2e-2)


def test_neutral_pore_without_current_stands_at_the_diffusion_potential():
    answer = coarse(1.4, 4.0, surface_charge_e_nm2=0.0, trans_mm=550.0, electrical="zero_current")
    exact = SCALES.thermal_v * (2.03 - 1.33) / (2.03 + 1.33) * math.log(11)
    assert answer.voltage_v == pytest.approx(exact, rel=1e-2)


def test_rounded_rim_tends_to_the_sharp_one():
    sharp = coarse()
    gaps = []
    for rim_nm in (4.0, 1.0):
        rounded = coarse(0.7, 3.0, rim_radius_nm=rim_nm)
        gaps.append(rounded.flow_m3_s / sharp.flow_m3_s - 1)
    # The current grows with the opening; so does the flow, whose slip the corner had hindered.
    assert gaps[0] > 2 * gaps[1] > 0
    assert gaps[1] < 0.05


def test_steep_salt_toward_the_field_turns_the_flow_at_1_v():
    # div(sigma E) = 0 makes a charge -eps E.grad(sigma)/sigma, which E pulls against grad(sigma).
    answer = coarse(1.4, 4.0, voltage_v=1.0, cis_mm=550.0)
    assert answer.flow_m3_s < 0 < answer.current_a


@pytest.mark.parametrize(
    "values",
    [
        {"surface_charge_e_nm2": -0.4},
        {"cis_mm": 5.0, "trans_mm": 5.0},
        {"cis_mm": 500.0, "trans_mm": 500.0},
        {"voltage_v": 1.0},
        {"voltage_v": 1.0, "trans_mm": 550.0},
        {"surface_charge_e_nm2": -0.4, "cis_mm": 500.0, "trans_mm": 500.0},
        {"surface_charge_e_nm2": 0.4, "cis_mm": 5.0, "trans_mm": 5.0},
    ],
)
def test_hard_pores_are_solved_without_continuation(values):
    answer = coarse(1.4, 4.0, **values)
    assert math.isfinite(answer.current_a)
    sign = -math.copysign(1, values.get("surface_charge_e_nm2", -0.1))
    assert sign * answer.flow_m3_s > 1e-17


def test_grids_hold_the_walls_exactly_and_refine_into_four():
    grid = pore_grid(
        pore_nm=25, membrane_nm=20, box_radius_nm=500, box_height_nm=1000, first_nm=1, ratio=2
    )
    assert {0.0, 25.0, 500.0} <= set(grid.r_nm)
    np.testing.assert_allclose([grid.z_nm.min(), grid.z_nm.max()], [-500, 500])
    assert np.isclose(grid.z_nm[:, None], [-10.0, 10.0], atol=1e-12).any(axis=0).all()
    assert grid.refined(2.0).cells == 4 * grid.cells
    assert (np.diff(grid.refined(2.0).r_nm) > 0).all()
