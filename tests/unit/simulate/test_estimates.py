"""Closed formulas against their known values, limits and each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.simulate import estimates as e


def test_values_at_the_defaults_are_those_of_the_docstrings():
    zeta = e.grahame_potential_v()
    np.testing.assert_allclose(
        [
            e.thermal_energy_pn_nm(),
            e.thermal_voltage_v() * 1e3,
            e.bare_line_charge_c_m() * 1e9,
            zeta * 1e3,
            e.grahame_potential_v(-0.2) * 1e3,
            e.electroosmotic_mobility_m2_vs(zeta) * 1e8,
            e.bulk_conductivity_s_m(),
            e.hall_conductance_ns(),
            e.hall_conductance_ns(access_radii=0.8217),
            e.access_factor(),
            e.straight_rod_friction_pn_nm_s(),
            e.straight_rod_friction_pn_nm_s(prefactor=3 * np.pi),
        ],
        [4.142, 25.85, 5.655, -29.87, -53.2, 2.063, 0.627, 20.77, 20.15, 2.963, 0.02386, 0.07157],
        rtol=5e-4,
    )


@given(st.floats(-0.5, 0.5), st.floats(1.0, 1000.0))
def test_wall_potential_carries_its_charge(charge_e_nm2, salt_mm):
    zeta = e.grahame_potential_v(charge_e_nm2, salt_mm)
    # Grahame's own form: sigma = sqrt(8 eps RT c) sinh(zeta e / 2 kT).
    permittivity = 78.0 * e.VACUUM_PERMITTIVITY_F_M
    scale = np.sqrt(8.0 * permittivity * 8.31446261815324 * 300.0 * salt_mm)
    back = scale * np.sinh(zeta / (2.0 * e.thermal_voltage_v())) / 1.602176634e-1
    assert back == pytest.approx(charge_e_nm2, rel=1e-6, abs=1e-12)


def test_thin_and_thick_pores_conduct_as_their_limits():
    assert e.hall_conductance_ns(25.0, 1e-9, 0.5) == pytest.approx(0.5 * 50.0, rel=1e-9)
    long = e.hall_conductance_ns(25.0, 1e6, 0.5)
    assert long == pytest.approx(0.5 * np.pi * 625.0 / 1e6, rel=1e-4)


@given(
    st.floats(-100.0, 100.0), st.floats(-100.0, 100.0), st.floats(0.0, np.pi), st.integers(2, 60)
)
def test_rotational_friction_of_a_straight_rod_anywhere_is_its_integral(x0, y0, angle, n):
    s = np.linspace(-225.0, 225.0, n)[:, np.newaxis]
    direction = np.array([np.cos(angle), np.sin(angle), 0.0])
    rod = np.array([x0, y0, 7.0]) + s * direction
    # About its centre eta L^3/12; moved, the distance d of its line counts half: par is perp / 2.
    along = x0 * direction[0] + y0 * direction[1]
    across = x0 * direction[1] - y0 * direction[0]
    exact = np.pi * 1e-9 * (450.0**3 / 12.0 + 450.0 * (along**2 + 0.5 * across**2))
    assert e.rotational_friction_pn_nm_s(rod) == pytest.approx(exact, rel=1e-9)


def test_ring_turns_along_itself_with_half_the_friction():
    angle = np.linspace(0.0, 2.0 * np.pi, 2001)
    ring = 70.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    exact = 0.5 * np.pi * 1e-9 * 70.0**2 * 2.0 * np.pi * 70.0
    assert e.rotational_friction_pn_nm_s(ring) == pytest.approx(exact, rel=1e-5)


def test_power_counts_joules():
    # 1 pN nm s (rad/s)^2 = 1e-21 W: a rod of 0.02 at 100 rad/s takes 2e-19 W.
    assert e.rotational_power_pn_nm_s(0.02, 100.0) * 1e-21 == pytest.approx(2e-19)
