"""Field, flow and salt: signs, sizes and where they act; what is not asked for is not looked up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.simulate.rod import forces
from rotortrack.simulate.rod.contact import add_contact_force
from rotortrack.simulate.rod.elasticity import add_bending_force
from rotortrack.simulate.rod.forces import NO_NODES, add_field_force, total_force
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import rod_parameters

CHARGE_C_M = 12 * 1.602176634e-19 / 0.34e-9


def field_force(x, table, **options):
    force = np.zeros_like(x)
    rod = RodOptions(n_vertices=len(x), length_nm=9.0 * (len(x) - 1), **options)
    add_field_force(x, rod_parameters(rod, None), *table, force)
    return force


def straight(direction, n=51):
    return 9.0 * np.arange(n)[:, None] * np.asarray(direction)[None, :]


def test_a_uniform_field_pulls_a_negative_rod_against_itself(linear_table):
    table = linear_table(e_applied_z=(1e6, 0.0, 0.0))
    force = field_force(straight([1.0, 0.0, 0.0]), table, flow_ratio=0.0)
    # lambda rho L E in newtons, times 1e12
    total = -0.26 * CHARGE_C_M * 450e-9 * 1e6 * 1e12
    np.testing.assert_allclose(force.sum(axis=0), [0.0, 0.0, total], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(force[1:-1, 2], total / 50)
    np.testing.assert_allclose(force[[0, -1], 2], total / 100)


@pytest.mark.parametrize(("direction", "share"), [((1.0, 0.0, 0.0), 1.0), ((0.0, 0.0, 1.0), 0.5)])
def test_a_uniform_flow_drags_along_half_as_much_as_across(linear_table, direction, share):
    table = linear_table(u_z=(2.0, 0.0, 0.0))
    force = field_force(straight(direction), table, lambda_eff=0.26, flow_ratio=100.0)
    # The charge acts on no field here; lambda_flow pi eta L u, 1 mPa s = 1e-3 pN us/nm^2
    total = 26.0 * math.pi * 1e-3 * 450.0 * 2.0 * share
    np.testing.assert_allclose(force.sum(axis=0), [0.0, 0.0, total], rtol=1e-12, atol=1e-12)


def test_an_oblique_segment_is_dragged_towards_its_normal(linear_table):
    table = linear_table(u_z=(2.0, 0.0, 0.0))
    force = field_force(straight([0.6, 0.0, 0.8]), table, lambda_eff=1.0, flow_ratio=1.0)
    t, u = np.array([0.6, 0.0, 0.8]), np.array([0.0, 0.0, 2.0])
    friction = math.pi * 1e-3 * 450.0
    expected = friction * (u - t * (t @ u)) + 0.5 * friction * t * (t @ u)
    np.testing.assert_allclose(force.sum(axis=0), expected, rtol=1e-12, atol=1e-12)


def test_a_salt_gradient_drives_by_its_mobility_alone(linear_table):
    table = linear_table(lnc_z=(-0.01, 0.0, 0.0))
    x = straight([1.0, 0.0, 0.0])
    assert not field_force(x, table).any()
    force = field_force(x, table, diffusiophoretic_mobility_nm2_us=300.0)
    # M grad ln c points to more salt, which is on the trans side.
    total = -math.pi * 1e-3 * 450.0 * 3.0
    np.testing.assert_allclose(force.sum(axis=0), [0.0, 0.0, total], rtol=1e-12, atol=1e-12)


def test_the_double_layers_field_acts_in_the_total_reading_only(linear_table):
    table = linear_table(e_applied_z=(1e6, 0.0, 0.0), e_equilibrium_z=(2e6, 0.0, 0.0))
    x = straight([1.0, 0.0, 0.0])
    applied = field_force(x, table)
    np.testing.assert_allclose(field_force(x, table, electric_field="total"), 3.0 * applied)


def test_forces_act_at_the_middle_of_segments(linear_table):
    # A field that grows with r: each segment takes the value at its own middle, half to each end.
    table = linear_table(e_applied_r=(0.0, 1e3, 0.0))
    x = straight([1.0, 0.0, 0.0], 4)
    force = field_force(x, table, flow_ratio=0.0)
    per_segment = -0.26 * CHARGE_C_M * 9e-9 * 1e12 * 1e3 * np.array([4.5, 13.5, 22.5])
    expected = np.array(
        [per_segment[0], per_segment[:2].sum(), per_segment[1:].sum(), per_segment[2]]
    )
    np.testing.assert_allclose(force[:, 0], expected / 2.0)


def test_field_and_flow_scale_with_their_factors(linear_table, wavy):
    field = linear_table(e_applied_z=(1e6, 0.0, 3.0), e_applied_r=(0.0, 5e3, 0.0))
    flow = linear_table(u_z=(0.4, 0.01, 0.002))
    once = field_force(wavy, field, lambda_eff=0.1, flow_ratio=100.0)
    np.testing.assert_allclose(field_force(wavy, field, lambda_eff=0.3), 3.0 * once)
    dragged = field_force(wavy, flow, lambda_eff=0.1, flow_ratio=100.0)
    np.testing.assert_allclose(
        field_force(wavy, flow, lambda_eff=0.2, flow_ratio=50.0), dragged, rtol=1e-12
    )
    # lambda_flow = 19.5 in the paper's examples is a ratio of 75.
    np.testing.assert_allclose(
        field_force(wavy, flow, lambda_eff=0.26, flow_ratio=75.0), 1.95 * dragged, rtol=1e-12
    )


def test_the_printed_segment_length_multiplies_the_drag_but_not_the_pull(linear_table, wavy):
    field = linear_table(e_applied_z=(1e6, 0.0, 0.0))
    flow = linear_table(u_z=(0.4, 0.0, 0.0))
    np.testing.assert_array_equal(
        field_force(wavy, field, friction_length_nm=30.0), field_force(wavy, field)
    )
    np.testing.assert_allclose(
        field_force(wavy, flow, friction_length_nm=30.0), field_force(wavy, flow) * 30.0 / 9.0
    )


def test_total_force_is_the_sum_of_its_parts(linear_table, wavy, pore):
    table = linear_table(e_applied_z=(1e6, 0.0, 0.0), u_r=(0.0, 0.01, 0.0))
    rod = rod_parameters(RodOptions(), pore)
    x = wavy + np.array([0.0, 3.0, 12.0])
    expected = np.zeros_like(x)
    add_bending_force(x, rod, expected)
    add_field_force(x, rod, *table, expected)
    add_contact_force(x, rod, expected)
    force = np.full_like(x, 1e300)
    assert total_force(x, rod, *table, force) == -1
    np.testing.assert_allclose(force, expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    ("with_table", "options", "looks"),
    [
        (False, {}, 0),
        (True, {"lambda_eff": 0.0}, 0),
        (True, {}, 50),
        (True, {"lambda_eff": 0.0, "diffusiophoretic_mobility_nm2_us": 1.0}, 50),
    ],
)
def test_only_a_rod_that_feels_the_field_looks_it_up(
    monkeypatch, linear_table, wavy, with_table, options, looks
):
    calls = []

    def counted(*arguments):
        calls.append(arguments)
        arguments[-1][:] = 0.0

    # The same code as compiled, run by the interpreter.
    monkeypatch.setattr(forces, "sample_field", counted)
    table = linear_table() if with_table else NO_NODES
    rod = rod_parameters(RodOptions(**options), None)
    forces.add_field_force.py_func(wavy, rod, *table, np.zeros_like(wavy))
    assert len(calls) == looks


def test_turning_the_rod_about_the_axis_turns_its_forces(linear_table, wavy, pore):
    table = linear_table(
        e_applied_z=(1e6, 300.0, 40.0), e_applied_r=(0.0, 2e3, 0.0), u_r=(0.0, 0.01, 0.0)
    )
    rod = rod_parameters(RodOptions(), pore)
    x = wavy + np.array([0.0, 3.0, 11.0])
    turn = np.array([[0.28, -0.96, 0.0], [0.96, 0.28, 0.0], [0.0, 0.0, 1.0]])
    force, turned = np.empty_like(x), np.empty_like(x)
    total_force(x, rod, *table, force)
    total_force(np.ascontiguousarray(x @ turn.T), rod, *table, turned)
    np.testing.assert_allclose(turned, force @ turn.T, atol=1e-9 * np.abs(force).max())


def test_the_mirror_image_has_mirrored_forces(linear_table, wavy, pore):
    table = linear_table(e_applied_z=(1e6, 300.0, 40.0), u_r=(0.0, 0.01, 0.0))
    rod = rod_parameters(RodOptions(), pore)
    x = wavy + np.array([0.0, 3.0, 11.0])
    mirror = np.array([1.0, -1.0, 1.0])
    force, mirrored = np.empty_like(x), np.empty_like(x)
    total_force(x, rod, *table, force)
    total_force(x * mirror, rod, *table, mirrored)
    np.testing.assert_allclose(mirrored, force * mirror, rtol=1e-12, atol=1e-12)
