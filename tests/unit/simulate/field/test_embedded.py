"""The table that comes with the package: whose it is, and that its fields are right."""

import subprocess
import sys

import numpy as np
import pytest

from rotortrack.simulate.field import embedded
from rotortrack.simulate.field.embedded import EMBEDDED, embedded_table, is_embedded
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.sample import QUANTITIES, sample_fields
from rotortrack.simulate.field.solve import as_solution, field_grid, solve_on
from rotortrack.simulate.field.table import FieldTable

MOBILITY_NM2_US_V = 2.063e4
"""Permittivity times wall potential over viscosity: 2.063e-8 m2/(V s)."""


@pytest.fixture(scope="module")
def table():
    return embedded_table()


def sampled(table, r, z):
    r, z = np.broadcast_arrays(np.asarray(r, float), np.asarray(z, float))
    points = np.ascontiguousarray(np.stack((r, 0 * r, z), axis=-1).reshape(-1, 3))
    out = np.empty((len(points), 4, 3))
    sample_fields(table.r_nm, table.z_nm, table.nodes, points, out)
    return {name: out[:, k // 2, 2 * (k % 2)] for k, name in enumerate(QUANTITIES)}


def test_file_is_small_and_of_the_careful_default():
    assert EMBEDDED.stat().st_size <= 500_000
    options = embedded_table().options
    assert FieldOptions(**options) == FieldOptions(accuracy="careful")


def test_only_the_default_pore_is_the_embedded_one_at_any_voltage():
    assert is_embedded(FieldOptions())
    assert is_embedded(FieldOptions(voltage_v=-0.15, accuracy="fast"))
    for other in ({"pore_radius_nm": 20.0}, {"trans_mm": 550.0}, {"rim_radius_nm": 1.0}):
        assert not is_embedded(FieldOptions(**other))


def test_current_and_flow_are_those_of_the_trials_to_1_percent(table):
    assert table.current_a == pytest.approx(2.05e-9, rel=1e-2)
    assert table.flow_m3_s == pytest.approx(4.0e-17, rel=1e-2)
    assert 0 < table.current_error_rel < 1e-3
    assert 0 < table.flow_error_rel < 1e-3


def test_fields_are_those_of_the_trials(table):
    pore = sampled(table, [0.0, 20.0], 0.0)
    assert pore["e_applied_z"][0] == pytest.approx(1.38e6, rel=0.01)
    np.testing.assert_allclose(pore["u_z"], [16.8, 25.0], rtol=0.02)
    out = sampled(table, [100.0, 200.0], 12.0)
    np.testing.assert_allclose(out["e_applied_r"], [5.4e4, 1.26e4], rtol=0.03)


def test_fields_outside_the_pore_are_those_of_a_disc(table):
    # Oblate spheroidal potential of the access region; in the pore between, a uniform field.
    r, height = np.meshgrid(np.linspace(60.0, 200.0, 15), np.linspace(8.0, 60.0, 9))
    mouth_v = 0.1 * (np.pi * 25 / 4) / (2 * np.pi * 25 / 4 + 20)

    def potential(r, s):
        return 2 / np.pi * mouth_v * np.arcsin(50 / (np.hypot(r - 25, s) + np.hypot(r + 25, s)))

    found = sampled(table, r, 10.0 + height)
    step = 1e-3
    disc_r = -(potential(r + step, height) - potential(r - step, height)) / (2e-9 * step)
    disc_z = -(potential(r, height + step) - potential(r, height - step)) / (2e-9 * step)
    size = np.hypot(disc_r, disc_z).ravel()
    error = np.hypot(found["e_applied_r"] - disc_r.ravel(), found["e_applied_z"] - disc_z.ravel())
    assert (error / size).max() < 0.15
    assert np.median(error / size) < 0.05


def test_flow_along_the_wall_is_mobility_times_field(table):
    r, height = np.linspace(100.0, 250.0, 16), 6.0 * 1.36
    found = sampled(table, r, 10.0 + height)
    slip = MOBILITY_NM2_US_V * 1e-9 * found["e_applied_r"]
    np.testing.assert_allclose(found["u_r"], slip, rtol=0.06)


def test_far_potential_falls_with_the_distance(table):
    # Beyond the box the field keeps its direction and falls with the square of the distance.
    rays = np.array([[300.0, 400.0], [100.0, 490.0], [200.0, -450.0]])
    edge = rays * (500.0 / np.abs(rays[:, 1:]))
    near, far = sampled(table, *edge.T), sampled(table, *(3.0 * edge.T))
    for name in ("e_applied_r", "e_applied_z", "u_r", "u_z"):
        np.testing.assert_allclose(far[name], near[name] / 9.0, rtol=1e-9)
    assert (far["e_applied_z"] > 0).all()


def test_layers_at_rest_are_mirror_images(table):
    rng = np.random.default_rng(3)
    r, z = rng.uniform(0, 300, 3000), rng.uniform(0, 100, 3000)
    off_wall = (z > 10.2) | (r < 24.8)
    above, below = (sampled(table, r[off_wall], side * z[off_wall]) for side in (1, -1))
    most = np.abs(above["e_equilibrium_z"]).max()
    for name, sign in (("e_equilibrium_r", 1), ("e_equilibrium_z", -1)):
        np.testing.assert_allclose(above[name], sign * below[name], rtol=0, atol=2e-4 * most)


def test_fields_of_the_voltage_are_mirror_images_to_its_first_order(table):
    # Exactly so when the voltage is reversed as well: what is off is of its second order.
    rng = np.random.default_rng(3)
    r, z = rng.uniform(0, 300, 3000), rng.uniform(13, 100, 3000)
    above, below = sampled(table, r, z), sampled(table, r, -z)
    for stem, most in (("e_applied", 0.05), ("u", 0.08)):
        size = np.hypot(above[f"{stem}_r"], above[f"{stem}_z"])
        off_r = np.abs(above[f"{stem}_r"] + below[f"{stem}_r"]) / size
        off_z = np.abs(above[f"{stem}_z"] - below[f"{stem}_z"]) / size
        assert np.median(off_r) < most
        assert np.median(off_z) < most


def test_table_is_the_solution_of_a_mesh_of_its_own(table):
    options = FieldOptions()
    solution = as_solution(options, solve_on(options, field_grid(options, 0.35, 1.7)))
    assert table.flow_m3_s == pytest.approx(solution.flow_m3_s, rel=5e-3)
    rng = np.random.default_rng(11)
    r, z = rng.uniform(0, 300, 3000), rng.uniform(-20, 80, 3000)
    off_wall = (np.abs(z) > 12.5) | (r < 22.5)
    r, z = r[off_wall], z[off_wall]
    found, exact = sampled(table, r, z), solution.evaluate_all(QUANTITIES, r, z)
    for stem, median, most in (("e_applied", 0.01, 0.05), ("u", 3e-3, 0.015)):
        parts = [f"{stem}_r", f"{stem}_z"]
        size = np.hypot(*(exact[part] for part in parts))
        size = np.maximum(size, 1e-3 * size.max())
        error = np.hypot(*(found[part] - exact[part] for part in parts)) / size
        assert np.median(error) < median
        assert np.percentile(error, 90) < most


def test_command_makes_the_table_anew(monkeypatch, tmp_path):
    # Meshes coarser than the command's, for time.
    monkeypatch.setattr(embedded, "_MESHES", ((1.4, 3.0), (0.7, 3.0)))
    monkeypatch.setattr(embedded, "EMBEDDED", tmp_path / "new.npz")
    embedded.main()
    made = FieldTable.load(tmp_path / "new.npz")
    assert made.options == embedded_table().options
    assert made.flow_m3_s == pytest.approx(4.0e-17, rel=0.03)
    assert 0 < made.flow_error_rel < 0.03


def test_reading_the_table_loads_no_finite_elements():
    program = (
        "import sys; from rotortrack.simulate.field.embedded import embedded_table;"
        "embedded_table().nodes; sys.exit('skfem' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
