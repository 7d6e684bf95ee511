"""Which reading of the paper gives which of its printed numbers; README.md of simulate lists them.

Each test names the number and holds both sides: the reading that gives it and the one that does
not.
"""

import re
from importlib import resources

import numpy as np
import pytest

from rotortrack.simulate import estimates as e
from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.rod.elasticity import bending_energy
from rotortrack.simulate.rod.ends import RodEnd
from rotortrack.simulate.rod.forces import NO_NODES, total_force
from rotortrack.simulate.rod.friction import drag_frames
from rotortrack.simulate.rod.options import PAPER_LITERAL, RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.parameters import BENDING_PN_NM2, EDGE_NM, rod_parameters
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.run import run_rod

from .rod.steps import at, straight, uniform_field

KT = e.thermal_energy_pn_nm()


def wavy():
    rng = np.random.default_rng(11)
    return straight(11, 90.0) + rng.normal(0.0, 1.0, (11, 3))


def bending_force(x, bending):
    parameters = rod_parameters(
        RodOptions(n_vertices=len(x), length_nm=9.0 * (len(x) - 1), bending=bending), None
    )
    force = np.empty_like(x)
    assert total_force(x, parameters, *NO_NODES, force) == -1
    return force, parameters


def downhill(x, parameters, step=1e-4):
    force = np.empty_like(x)
    for index in np.ndindex(x.shape):
        ends = []
        for sign in (-1.0, 1.0):
            moved = x.copy()
            moved[index] += sign * step
            ends.append(bending_energy(moved, parameters))
        force[index] = -(ends[1] - ends[0]) / (2.0 * step)
    return force


def s_shape(radius_nm, n=401):
    """An S of two arcs of 225 nm through the axis."""
    s = np.linspace(0.0, 225.0, n)
    arm = radius_nm * np.stack([np.sin(s / radius_nm), 1 - np.cos(s / radius_nm), 0 * s], axis=1)
    return np.concatenate([-arm[:0:-1], arm])


def test_bending_sign_printed_plus_makes_a_torque_out_of_nothing():
    x = wavy()
    right, _ = bending_force(x, "energy")
    printed, _ = bending_force(x, "printed")
    scale = np.abs(x).max() * np.abs(right).max()
    assert np.abs(np.cross(x, right).sum(axis=0)).max() < 1e-10 * scale
    assert np.abs(np.cross(x, printed).sum(axis=0)).max() > 1e-2 * scale
    doubled, _ = bending_force(x, "doubled")
    assert np.linalg.norm(printed - doubled) > 0.05 * np.linalg.norm(doubled)


def test_bending_factor_printed_two_makes_the_rod_twice_as_stiff():
    x = wavy()
    right, parameters = bending_force(x, "energy")
    np.testing.assert_allclose(right, downhill(x, parameters), atol=1e-6 * np.abs(right).max())
    assert parameters[BENDING_PN_NM2] / KT == pytest.approx(1500.0)
    doubled, twice = bending_force(x, "doubled")
    np.testing.assert_allclose(doubled, 2.0 * right, rtol=1e-12)
    assert twice[BENDING_PN_NM2] / KT == pytest.approx(3000.0)
    assert PAPER_LITERAL["rod"]["bending"] == "printed"


def test_bending_energy_of_an_arc_is_that_of_the_printed_integral():
    angle = np.arange(51) * 2.0 * np.arcsin(9.0 / 300.0)
    arc = 150.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    _, parameters = bending_force(arc, "energy")
    # The two ends carry no curvature: 49 joints of 9 nm.
    integral = 0.5 * 1500.0 * KT * 49.0 * 9.0 / 150.0**2
    assert bending_energy(arc, parameters) == pytest.approx(integral, rel=2e-3)


def test_balance_sign_rod_moves_with_the_flow_not_against_it():
    flow = uniform_field(u_z_nm_us=0.01)
    rod = RodOptions(lambda_eff=0.1, flow_ratio=10.0, wall="none", end_weight="half")
    stepping = SteppingOptions(duration_us=10.0, sample_us=5.0)
    run = run_rod(rod, stepping, at(straight(), 0.0, 0.0, 100.0), flow)
    speed = (run.positions_nm[-1] - run.positions_nm[0])[:, 2] / run.time_us[-1]
    np.testing.assert_allclose(speed, 0.01, rtol=1e-6)


def test_friction_prefactor_printed_3_pi_misses_the_printed_0_012():
    shapes = [s_shape(radius) for radius in (70.0, 80.0, 90.0, 100.0)]
    ends = [np.linalg.norm(x[-1] - x[0]) for x in shapes]
    assert 279.0 < min(ends) < max(ends) < 361.0
    of_note_2 = [e.rotational_friction_pn_nm_s(x) for x in shapes]
    assert min(of_note_2) < 0.012 < max(of_note_2)
    assert min(e.rotational_friction_pn_nm_s(x, prefactor=3 * np.pi) for x in shapes) > 0.024


def test_viscosity_printed_mp_s_misses_the_friction_by_ten():
    # 1 mP s would be a tenth of 1 mPa s.
    shape = s_shape(80.0)
    low = e.rotational_friction_pn_nm_s(shape, viscosity_mpa_s=0.1)
    assert low < 0.002
    assert e.rotational_friction_pn_nm_s(shape) == pytest.approx(0.012, rel=0.25)


def test_power_printed_190_and_45_kt_follow_from_0_012_and_125():
    power = e.rotational_power_pn_nm_s(0.012, 125.0)
    assert round(power, -1) == 190.0
    assert power / KT == pytest.approx(45.0, abs=0.5)


def test_flux_printed_25_follows_from_no_reading():
    assert e.salt_flux_mol_m2_s(450.0) == pytest.approx(36.0)
    assert e.salt_flux_mol_m2_s(500.0) == pytest.approx(40.0)
    # Nor from the ends' own diffusivities or from diffusion up to the pore.
    for diffusion in (1.33e-9, 1.6e-9, 1.607e-9, 2.03e-9):
        for difference in (450.0, 500.0):
            flux = e.salt_flux_mol_m2_s(difference, diffusion_m2_s=diffusion)
            assert abs(flux - 25.0) > 4.0
            assert abs(flux / e.access_factor() - 25.0) > 4.0


def test_rate_printed_0_6_follows_from_36_or_40_not_from_25():
    rates = [e.concentration_rate_um_s(flux) for flux in (25.0, 36.0, 40.0)]
    np.testing.assert_allclose(rates, [0.39, 0.57, 0.63], atol=0.005)
    assert [round(rate, 1) for rate in rates] == [0.4, 0.6, 0.6]
    # 28 min for 1 mM is the printed rate, less than 1 % of the gradient.
    minutes = 1e3 / (0.6 * 60.0)
    assert minutes == pytest.approx(28.0, abs=0.3)
    # Diffusion up to the pore leaves a third of it.
    assert rates[2] / e.access_factor() == pytest.approx(0.21, abs=0.005)


def test_difference_printed_450_mm_is_not_550_less_50():
    fluxes = [e.salt_flux_mol_m2_s(difference) for difference in (450.0, 550.0 - 50.0)]
    rates = [e.concentration_rate_um_s(flux) for flux in fluxes]
    # Both round to the printed 0.6 uM/s, so the slip has no consequence.
    assert [round(rate, 1) for rate in rates] == [0.6, 0.6]
    assert rates[1] / rates[0] == pytest.approx(10.0 / 9.0)


def test_segment_printed_30_nm_is_not_that_of_51_vertices():
    rod = RodOptions()
    assert rod_parameters(rod, None)[EDGE_NM] == pytest.approx(450.0 / 50.0)
    assert rod_parameters(RodOptions(n_vertices=16), None)[EDGE_NM] == pytest.approx(30.0)
    totals = []
    for length_nm in (None, 30.0):
        zeta = np.empty((51, 2))
        parameters = rod_parameters(RodOptions(friction_length_nm=length_nm), None)
        drag_frames(straight(), parameters, np.empty((51, 3)), zeta)
        totals.append(zeta[:, 0].sum())
    # With 9 nm the vertices together have pi eta L; with 30 nm 3.3 times that.
    assert totals[0] == pytest.approx(np.pi * 1e-3 * 450.0)
    assert totals[1] / totals[0] == pytest.approx(30.0 / 9.0)


def test_ratio_printed_75_pulls_the_rod_in_at_the_printed_wall_charge():
    lambda_flow, lambda_eff = 19.5, 0.26
    assert lambda_flow / lambda_eff == pytest.approx(75.0)
    weak, strong = (
        e.drag_over_pull(75.0, e.electroosmotic_mobility_m2_vs(e.grahame_potential_v(sigma)))
        for sigma in (-0.1, -0.2)
    )
    assert weak < 0.9
    assert strong > 1.5
    mobility = e.electroosmotic_mobility_m2_vs(e.grahame_potential_v())
    assert 1.0 / e.drag_over_pull(1.0, mobility) == pytest.approx(87.3, abs=0.1)
    # The typical values of Note 2, taken in order, give 200 and 100: not below 87 either.
    assert e.drag_over_pull(10.0 / 0.05, mobility) > 1.0
    assert e.drag_over_pull(25.0 / 0.25, mobility) > 1.0


@pytest.mark.parametrize("offset_nm", [(0.0, 3.0), (40.0, 8.0), (90.0, 15.0)])
def test_ratio_printed_75_translocates_where_130_rotates(offset_nm):
    field = embedded_table()
    start = StartOptions(offset_x_nm=offset_nm[0], offset_y_nm=offset_nm[1])
    ends = []
    for ratio in (75.0, 130.0):
        rod = RodOptions(lambda_eff=0.26, flow_ratio=ratio)
        stepping = SteppingOptions(duration_us=400.0, stop_when_settled=True)
        run = run_rod(rod, stepping, place_rod(rod, start, membrane_nm=field.membrane_nm), field)
        ends.append(run.end)
    assert ends == [RodEnd.TRANSLOCATED, RodEnd.ROTATING_STEADILY]


def test_surface_charge_printed_0_1x_e_gives_the_flow_in_units_of_e_per_nm2():
    charge = 0.1 * e.ELEMENTARY_CHARGE_C * 1e18
    assert charge == pytest.approx(0.0160, abs=5e-5)
    # 1.4 MV/m in the pore at 100 mV: cm/s, as in Fig. S13, and 10 cm/s were it 0.1 C/m^2.
    as_e = e.electroosmotic_mobility_m2_vs(e.grahame_potential_v(-0.1)) * 1.4e6
    as_c = e.electroosmotic_mobility_m2_vs(e.grahame_potential_v(-0.1 / charge * 0.1)) * 1.4e6
    assert as_e == pytest.approx(0.029, abs=0.001)
    assert as_c > 0.09


def test_tables_printed_s1_to_s5_are_the_defaults_of_the_field():
    options = FieldOptions()
    # W is a radius: Table S2 gives the membrane from the rim to the side as W - R.
    assert options.box_radius_nm == 500.0
    assert options.box_height_nm == 1000.0
    assert options.membrane_nm == 20.0
    assert options.pore_radius_nm == 25.0
    assert options.surface_charge_e_nm2 == -0.1
    assert options.voltage_v == 0.1
    assert options.cis_mm == options.trans_mm == 50.0


def test_line_charge_printed_5_7_is_rounded():
    assert round(e.bare_line_charge_c_m() * 1e9, 1) == 5.7
    assert e.bare_line_charge_c_m() * 1e9 == pytest.approx(5.6547, abs=1e-4)


def test_stokes_viscosity_of_note_2_is_not_that_of_water_at_300_k():
    zeta = e.grahame_potential_v()
    slow, fast = (
        e.electroosmotic_mobility_m2_vs(zeta, viscosity_mpa_s=viscosity)
        for viscosity in (1.0, 0.85)
    )
    assert fast / slow == pytest.approx(1.0 / 0.85)
    # With one viscosity for flow and friction it drops out of who wins, drag or pull.
    assert e.drag_over_pull(75.0, slow) == pytest.approx(
        e.drag_over_pull(75.0, fast, viscosity_mpa_s=0.85)
    )


def test_page_names_every_test_of_this_file_and_no_other():
    page = resources.files("rotortrack.simulate").joinpath("README.md").read_text("utf-8")
    named = set(re.findall(r"`(test_\w+)`", page))
    here = {name for name in globals() if name.startswith("test_")}
    assert named == here - {"test_page_names_every_test_of_this_file_and_no_other"}
