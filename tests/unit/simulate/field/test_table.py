"""Tables of fields: smooth look-up, what lies beyond and within, files, scaling, the own table."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import ArchiveError, FieldError
from rotortrack.simulate.field.embedded import EMBEDDED, embedded_table, is_embedded
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.sample import hermite_nodes, sample_field, sample_fields
from rotortrack.simulate.field.solve import as_solution, field_grid, solve_on
from rotortrack.simulate.field.table import FieldTable, tabulate

TABLE = embedded_table()


def at(points, table=TABLE):
    points = np.ascontiguousarray(np.atleast_2d(points), np.float64)
    out = np.empty((len(points), 4, 3))
    sample_fields(table.r_nm, table.z_nm, table.nodes, points, out)
    return out


@pytest.fixture(scope="module")
def solution():
    options = FieldOptions(rim_radius_nm=2.0)
    return as_solution(options, solve_on(options, field_grid(options, 0.7, 1.6)))


def smooth(r, z):
    """Fields that a table must carry: radial parts odd in r, axial ones even."""
    radial = r * np.exp(-((r / 60.0) ** 2)) * np.cos(z / 50.0)
    axial = np.exp(-((r / 60.0) ** 2)) * np.sin(z / 50.0 + 0.3)
    return np.stack([radial, axial] * 4, axis=-1)


def test_a_smooth_field_is_met_to_third_order():
    errors = []
    rng = np.random.default_rng(1)
    points = rng.uniform(-80, 80, (400, 3))
    r = np.hypot(points[:, 0], points[:, 1])
    for step in (8.0, 4.0):
        lines = np.arange(0.0, 160.0, step), np.arange(-160.0, 161.0, step)
        values = smooth(*np.meshgrid(*lines, indexing="ij"))
        out = np.empty((len(points), 4, 3))
        sample_fields(*lines, hermite_nodes(*lines, values), points, out)
        expected = smooth(r, points[:, 2])[:, 0] / r * points[:, 0]
        errors.append(np.abs(out[:, 0, 0] - expected).max())
    assert errors[1] < errors[0] / 6.0
    assert errors[1] < 0.03


@given(
    st.integers(0, TABLE.r_nm.size - 2),
    st.integers(0, TABLE.z_nm.size - 2),
    st.floats(0.05, 0.95),
    st.booleans(),
)
def test_values_and_slopes_are_continuous_across_the_lines(i, j, part, along_r):
    r, z = TABLE.r_nm, TABLE.z_nm
    if along_r:
        line, across = r[max(i, 1)], z[j] + part * (z[j + 1] - z[j])
        place, step = np.array([line, 0.0, across]), np.array([1.0, 0.0, 0.0])
    else:
        line, across = z[max(j, 1)], r[i] + part * (r[i + 1] - r[i])
        place, step = np.array([across, 0.0, line]), np.array([0.0, 0.0, 1.0])
    tiny = 1e-5
    far, near, mid, after, beyond = at([place + k * tiny * step for k in (-2, -1, 0, 1, 2)])
    scale = np.abs(TABLE.values).reshape(-1, 4, 2).max(axis=(0, 2))[:, np.newaxis] + 1e-30
    assert np.all(np.abs(after - near) < 1e-3 * scale)
    left, right = (
        (3 * mid - 4 * near + far) / (2 * tiny),
        (4 * after - 3 * mid - beyond) / (2 * tiny),
    )
    # Slopes of a nm on either side agree to rounding of the differences.
    assert np.all(np.abs(left - right) < 1e-4 * scale)


@given(st.floats(0.1, 900.0), st.floats(-900.0, 900.0), st.floats(-np.pi, np.pi))
def test_a_field_turns_with_its_point(r, z, angle):
    c, s = np.cos(angle), np.sin(angle)
    plain = at([r, 0.0, z])[0]
    turned = at([r * c, r * s, z])[0]
    back = turned @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(back, plain, rtol=1e-7, atol=1e-9 * np.abs(plain).max())
    assert plain[:, 1] == pytest.approx([0.0] * 4, abs=1e-12)


@given(st.floats(-400.0, 400.0))
def test_on_the_axis_nothing_points_sideways(z):
    assert at([0.0, 0.0, z])[0][:, :2] == pytest.approx(np.zeros((4, 2)))


@given(st.floats(0, np.pi), st.floats(1.0, 5.0))
def test_beyond_the_table_fields_fall_with_the_square_of_the_distance(tilt, times):
    direction = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    edge = 1.0 / max(abs(direction[0]) / TABLE.r_nm[-1], abs(direction[2]) / TABLE.z_nm[-1])
    inner, outer = at([edge * direction, times * edge * direction])
    np.testing.assert_allclose(outer * times**2, inner, rtol=1e-6, atol=1e-9 * np.abs(inner).max())


def test_fields_have_their_signs_and_mirror_images():
    # physics.md, section 1: the field and the flow point from trans to cis.
    axis = at([[0.0, 0.0, z] for z in (-60.0, 0.0, 60.0)])
    assert (axis[:, 0, 2] > 0).all()
    assert (axis[:, 2, 2] > 0).all()
    # In proportion to the voltage they are mirror images; salt that piles up on one side is not.
    above, below = at([[40.0, 0.0, 25.0], [40.0, 0.0, -25.0]])
    assert above[0] == pytest.approx(below[0] * [-1, 1, 1], rel=0.1)
    assert above[2] == pytest.approx(below[2] * [-1, 1, 1], rel=0.1)
    # At rest there is nothing but the double layer.
    assert above[1] == pytest.approx(below[1] * [1, 1, -1], abs=1e-3 * abs(above[0, 0]))
    assert at([0.0, 0.0, 0.0])[0, 0, 2] == pytest.approx(1.38e6, rel=0.01)
    assert at([100.0, 0.0, 12.0])[0, 0, 0] == pytest.approx(5.4e4, rel=0.05)


def test_within_the_membrane_the_nearest_water_is_told():
    inside, face = at([[60.0, 0.0, 8.0], [60.0, 0.0, 10.0]])
    np.testing.assert_allclose(inside[1], face[1], rtol=0.02)
    assert np.abs(inside[2]).max() < 1e-3 * np.abs(at([0.0, 0.0, 0.0])[0, 2]).max()


def test_a_table_meets_its_solution_where_rods_go(solution):
    table = tabulate(solution)
    rng = np.random.default_rng(2)
    r, z = rng.uniform(0.0, 200.0, 300), rng.uniform(13.0, 40.0, 300)
    out = at(np.stack([r, 0 * r, z], axis=1), table)
    for name, (kind, axis) in {
        "e_applied_r": (0, 0), "e_applied_z": (0, 2), "u_r": (2, 0), "u_z": (2, 2),
    }.items():  # fmt: skip
        expected = solution.evaluate(name, r, z)
        error = out[:, kind, axis] - expected
        assert np.sqrt(np.mean(error**2)) < 0.01 * np.sqrt(np.mean(expected**2))
    assert table.rim_radius_nm == 2.0
    assert np.isfinite(table.values).all()


def test_a_saved_table_comes_back(tmp_path):
    path = tmp_path / "field.npz"
    TABLE.save(path)
    again = FieldTable.load(path)
    np.testing.assert_array_equal(again.nodes, TABLE.nodes)
    assert again.options == TABLE.options
    assert again.flow_m3_s == TABLE.flow_m3_s


@pytest.mark.parametrize(
    "damage", ["short", "nan", "order", "options", "text", "missing", "folder"]
)
def test_a_file_that_is_no_table_is_refused_by_name(tmp_path, damage):
    path = tmp_path / "field.npz"
    TABLE.save(path)
    content = dict(np.load(path))
    about = json.loads(str(content["about"]))
    if damage == "short":
        content["values"] = content["values"][:-1]
    if damage == "nan":
        content["values"][3, 3, 3] = np.nan
    if damage == "order":
        content["r_nm"][5] = content["r_nm"][4]
    if damage == "options":
        about["options"].pop("rim_radius_nm")
    content["about"] = np.array(json.dumps(about))
    np.savez(path, **content)
    if damage == "text":
        path.write_text("field")
    if damage in {"missing", "folder"}:
        path.unlink()
    if damage == "folder":
        path.mkdir()
    with pytest.raises(ArchiveError, match=r"field\.npz"):
        FieldTable.load(path)


@given(st.floats(-0.2, 0.2))
def test_what_the_voltage_drives_scales_and_the_double_layer_stays(voltage_v):
    scaled = TABLE.scaled(voltage_v)
    factor = voltage_v / TABLE.voltage_v
    points = np.array([[40.0, 0.0, 25.0], [5.0, 0.0, 2.0], [300.0, 0.0, -30.0]])
    image = points * [1.0, 1.0, np.sign(voltage_v) or 1.0]
    expected = at(image) * [1.0, 1.0, np.sign(voltage_v) or 1.0]
    expected[:, [0, 2, 3]] *= abs(factor)
    np.testing.assert_allclose(at(points, scaled), expected, rtol=1e-9, atol=1e-9)
    assert scaled.flow_m3_s == pytest.approx(factor * TABLE.flow_m3_s)
    assert scaled.options["voltage_v"] == scaled.voltage_v == voltage_v


@pytest.mark.parametrize(
    "table",
    [
        TABLE,
        dataclasses.replace(TABLE, voltage_v=0.0),
        dataclasses.replace(TABLE, voltage_v=0.5),
        dataclasses.replace(TABLE, options={**TABLE.options, "trans_mm": 550.0}),
    ],
)
def test_what_is_not_proportional_is_refused_with_the_remedy(table):
    with pytest.raises(FieldError, match="solve the field at voltage_v"):
        table.scaled(0.3 if table is TABLE else 0.15)


def test_the_own_table_is_small_and_that_of_the_paper():
    assert EMBEDDED.stat().st_size <= 500_000
    assert TABLE.current_a == pytest.approx(2.05e-9, rel=0.01)
    assert TABLE.flow_m3_s == pytest.approx(4.0e-17, rel=0.01)
    assert TABLE.flow_error_rel < 1e-3
    assert is_embedded(FieldOptions(voltage_v=0.05, accuracy="fast"))
    assert not is_embedded(FieldOptions(trans_mm=51.0))


def test_one_point_is_like_many():
    out = np.empty((4, 3))
    sample_field(TABLE.r_nm, TABLE.z_nm, TABLE.nodes, 31.0, -7.0, 14.0, out)
    np.testing.assert_array_equal(out, at([31.0, -7.0, 14.0])[0])
