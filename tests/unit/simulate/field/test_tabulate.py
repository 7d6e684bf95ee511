"""Tables of fields: made, stored, scaled, and refused."""

import contextlib
import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import ArchiveError, FieldError
from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.sample import QUANTITIES, sample_fields
from rotortrack.simulate.field.solve import as_solution, field_grid, solve_on
from rotortrack.simulate.field.table import FieldTable, tabulate


def sampled(table, r, z):
    """Values (m, 8) in the order of QUANTITIES, in the half plane y = 0."""
    r, z = np.broadcast_arrays(np.asarray(r, float), np.asarray(z, float))
    points = np.ascontiguousarray(np.stack((r, 0 * r, z), axis=-1).reshape(-1, 3))
    out = np.empty((len(points), 4, 3))
    sample_fields(table.r_nm, table.z_nm, table.nodes, points, out)
    return out[:, :, [0, 2]].reshape(-1, 8)


class DiscSolution:
    """Fields known in closed form: the potential of a disc electrode of the pore's radius.

    It is that of the oblate spheroidal coordinates, (2/pi) asin(2a / (l1 + l2)), with l1 and l2 the
    distances from the two edges, blunted so that no rim is infinite. Asking for a point within the
    membrane is a mistake of the caller.
    """

    def __init__(self, **options):
        self.options = FieldOptions(**options)
        self.voltage_v = self.options.voltage_v
        self.current_a, self.flow_m3_s = 2e-9, 4e-17
        self.current_error_rel, self.flow_error_rel = 1e-4, 5e-4
        self.blunt_nm = 12.0

    def potential(self, r, z):
        a, height = self.options.pore_radius_nm, np.sqrt(z**2 + self.blunt_nm**2)
        both = np.hypot(r - a, height) + np.hypot(r + a, height)
        return 2.0 / np.pi * np.arcsin(2.0 * a / both)

    def is_wet(self, r, z):
        o = self.options
        rim, x = o.rim_radius_nm, o.pore_radius_nm + o.rim_radius_nm - r
        y = np.abs(z) - o.membrane_nm / 2 + rim
        on_arc = (x >= 0) & (y >= 0) & (np.hypot(x, y) > rim - 1e-9)
        return (r < o.pore_radius_nm + 1e-9) | (np.abs(z) > o.membrane_nm / 2 - 1e-9) | on_arc

    def evaluate_all(self, quantities, r_nm, z_nm):
        assert self.is_wet(r_nm, z_nm).all()
        step = 1e-3
        along_r = self.potential(r_nm + step, z_nm) - self.potential(r_nm - step, z_nm)
        along_z = self.potential(r_nm, z_nm + step) - self.potential(r_nm, z_nm - step)
        slopes = {"r": along_r / (2 * step), "z": along_z / (2 * step)}
        return {name: (1 + QUANTITIES.index(name)) * slopes[name[-1]] for name in quantities}


@pytest.fixture(scope="module")
def solution():
    options = FieldOptions()
    return as_solution(options, solve_on(options, field_grid(options, 0.7, 2.0)))


@pytest.fixture(scope="module")
def table(solution):
    return tabulate(solution)


@pytest.fixture(scope="module")
def about(table, tmp_path_factory):
    """What a saved table holds, to be spoiled."""
    path = tmp_path_factory.mktemp("table") / "field.npz"
    dataclasses.replace(table, current_error_rel=0.0, flow_error_rel=0.0).save(path)
    with np.load(path) as archive:
        content = {name: archive[name] for name in archive.files}
    return SimpleNamespace(content=content, words=json.loads(str(content["about"])), path=path)


def test_table_is_the_closed_form_wherever_a_rod_can_be():
    disc = DiscSolution()
    made = tabulate(disc)
    rng = np.random.default_rng(4)
    r, z = rng.uniform(0, 330, 4000), rng.uniform(-150, 150, 4000)
    wet = disc.is_wet(r, z)
    r, z = r[wet], z[wet]
    exact = np.stack(list(disc.evaluate_all(QUANTITIES, r, z).values()), axis=1)
    size = np.repeat(np.hypot(exact[:, ::2], exact[:, 1::2]), 2, axis=1)
    error = np.abs(sampled(made, r, z) - exact) / size
    assert np.percentile(error, 95) < 5e-3
    assert error.max() < 0.03


@pytest.mark.parametrize("rim", [0.0, 3.0])
def test_fields_within_the_membrane_are_those_of_the_nearest_water(rim):
    disc = DiscSolution(rim_radius_nm=rim)
    made = tabulate(disc)
    r, z = np.meshgrid(made.r_nm, made.z_nm, indexing="ij")
    inside = ~disc.is_wet(r, z)
    assert inside.sum() > 300
    if rim == 0.0:
        lumen = r - 25.0 < 10.0 - np.abs(z)
        near_r = np.where(lumen, 25.0, r)[inside]
        near_z = np.where(lumen, z, np.copysign(10.0, z))[inside]
        # On the diagonal both walls are as near.
        one = np.abs(r - 25.0 - (10.0 - np.abs(z)))[inside] > 1e-6
        wanted = np.stack(list(disc.evaluate_all(QUANTITIES, near_r, near_z).values()), axis=1)
        np.testing.assert_allclose(made.values[inside][one], wanted[one], atol=1e-4)
    within = np.abs(made.values[inside]).max(axis=0)
    assert (within <= np.abs(made.values[~inside]).max(axis=0)).all()


def test_values_within_the_membrane_hold_no_flow(table):
    r, z = np.random.default_rng(1).uniform((25.6, -9.4), (600.0, 9.4), (500, 2)).T
    found = sampled(table, r, z)
    assert np.isfinite(found).all()
    assert np.abs(found[:, 4:6]).max() < 0.05 * np.abs(table.values[..., 5]).max()


def test_table_repeats_the_solution_where_a_rod_moves(solution, table):
    rng = np.random.default_rng(7)
    # Half of the points lie in and about the pore; a rod's own radius keeps its axis off the walls.
    r = np.concatenate((rng.uniform(0, 300, 1500), rng.uniform(0, 45, 1500)))
    z = np.concatenate((rng.uniform(10, 80, 1500), rng.uniform(-30, 40, 1500)))
    away = (np.abs(z) > 12) | (r < 23)
    r, z = r[away], z[away]
    exact = np.stack(list(solution.evaluate_all(QUANTITIES, r, z).values()), axis=1)
    found = sampled(table, r, z)
    for part, median, most in (("e_applied", 5e-3, 0.05), ("u", 1e-3, 0.01)):
        k = QUANTITIES.index(f"{part}_r")
        size = np.hypot(exact[:, k], exact[:, k + 1])
        # On a wall flow vanishes, and so no share of it can be asked for.
        size = np.maximum(size, 0.01 * size.max())
        error = np.hypot(*(found[:, k : k + 2] - exact[:, k : k + 2]).T) / size
        assert np.median(error) < median
        assert np.percentile(error, 99) < most


def test_table_passes_the_flow_and_the_voltage_of_its_solution(table):
    r = np.linspace(0.0, 25.0, 2001)
    through_pore = np.trapezoid(2e-21 * np.pi * r * sampled(table, r, 0.0)[:, 5], r)
    assert through_pore == pytest.approx(table.flow_m3_s, rel=3e-3)
    z = np.linspace(-500.0, 500.0, 20_001)
    along_axis = sampled(table, 0.0, z)
    assert np.trapezoid(1e-9 * along_axis[:, 1], z) == pytest.approx(0.1, rel=1e-3)
    assert np.trapezoid(1e-9 * along_axis[:, 3], z) == pytest.approx(0.0, abs=1e-6)


def test_scaling_to_the_same_voltage_or_there_and_back_changes_nothing(table):
    assert table.scaled(0.1) is table
    back = table.scaled(-0.2).scaled(0.1)
    np.testing.assert_allclose(back.values, table.values, rtol=1e-12)
    assert not table.scaled(0.0).values[..., 4:].any()


@pytest.mark.parametrize("voltage", [0.2001, -0.3, 1.0, np.inf, np.nan])
def test_scaling_beyond_200_mv_is_refused_with_the_remedy(table, voltage):
    with pytest.raises(FieldError, match=r"0\.2 V only.*solve the field at voltage_v"):
        table.scaled(voltage)


def test_tables_that_nothing_is_proportional_in_are_refused_with_the_remedy(table):
    far = dataclasses.replace(table, voltage_v=0.5)
    salty = dataclasses.replace(table, options={**table.options, "trans_mm": 550.0})
    idle = dataclasses.replace(table, voltage_v=0.0)
    for other in (far, salty, idle):
        with pytest.raises(FieldError, match=r"solve the field at voltage_v = 0\.15 instead"):
            other.scaled(0.15)


@pytest.mark.parametrize(
    ("voltage", "most"), [(-0.1, 1e-3), (0.05, 0.03), (-0.05, 0.03), (0.2, 0.06)]
)
def test_scaled_table_is_that_of_the_other_voltage_to_its_linearity(table, voltage, most):
    options = FieldOptions(voltage_v=voltage)
    other = tabulate(as_solution(options, solve_on(options, field_grid(options, 0.7, 2.0))))
    scaled = table.scaled(voltage)
    assert scaled.flow_m3_s == pytest.approx(other.flow_m3_s, rel=0.025)
    r, z = np.meshgrid(table.r_nm, table.z_nm, indexing="ij")
    wet = (r <= 25.0) | (np.abs(z) >= 10.0)
    error = np.abs(scaled.values - other.values)[wet].max(axis=0)
    assert (error < most * np.abs(other.values[wet]).max(axis=0)).all()


@pytest.mark.parametrize("compact", [False, True])
def test_saved_table_comes_back(table, tmp_path, compact):
    path = tmp_path / "field.npz"
    known = dataclasses.replace(table, current_error_rel=1e-4, flow_error_rel=2e-3)
    known.save(path, compact=compact)
    loaded = FieldTable.load(path)
    for field in dataclasses.fields(FieldTable):
        saved, back = getattr(known, field.name), getattr(loaded, field.name)
        if field.name == "values" and compact:
            np.testing.assert_allclose(back, saved, rtol=1e-7)
        else:
            np.testing.assert_array_equal(back, saved)
    assert loaded.values.dtype == np.float64
    assert (loaded.pore_radius_nm, loaded.membrane_nm, loaded.rim_radius_nm) == (25.0, 20.0, 0.0)


def test_table_of_unknown_errors_comes_back(table, tmp_path):
    dataclasses.replace(table, flow_error_rel=np.nan).save(tmp_path / "field.npz")
    assert np.isnan(FieldTable.load(tmp_path / "field.npz").flow_error_rel)


def without(mapping, name):
    return {key: value for key, value in mapping.items() if key != name}


def refused(path, arrays):
    np.savez(path, **arrays)
    with pytest.raises(ArchiveError, match=r"evil\.npz cannot be read as a table"):
        FieldTable.load(path)


@pytest.mark.parametrize(
    "spoiled",
    [
        lambda arrays: {"r_nm": arrays["r_nm"][::-1]},
        lambda arrays: {"r_nm": arrays["r_nm"] + 1.0},
        lambda arrays: {"r_nm": arrays["r_nm"][:-1]},
        lambda arrays: {"z_nm": arrays["z_nm"] + 600.0},
        lambda arrays: {"z_nm": np.zeros_like(arrays["z_nm"])},
        lambda arrays: {"values": arrays["values"][..., :7]},
        lambda arrays: {"values": arrays["values"] + 1.0},
        lambda arrays: {"values": np.full_like(arrays["values"], np.nan)},
        lambda arrays: {"values": arrays["values"].astype(object)},
        lambda arrays: {"values": arrays["values"].astype(complex)},
        lambda _: {"r_nm": np.zeros(1), "z_nm": np.zeros(1), "values": np.zeros((1, 1, 8))},
        lambda _: {"about": np.array("{")},
        lambda _: {"about": np.array([{}], dtype=object)},
    ],
)
def test_tables_of_hostile_arrays_are_refused_by_name(about, tmp_path, spoiled):
    refused(tmp_path / "evil.npz", {**about.content, **spoiled(about.content)})


@pytest.mark.parametrize("missing", ["r_nm", "z_nm", "values", "about"])
def test_tables_without_an_array_are_refused_by_name(about, tmp_path, missing):
    refused(tmp_path / "evil.npz", without(about.content, missing))


@pytest.mark.parametrize(
    "spoiled",
    [
        lambda words: {**words, "kind": "a rod's run"},
        lambda words: {**words, "quantities": list(QUANTITIES[::-1])},
        lambda words: {**words, "voltage_v": float("nan")},
        lambda words: {**words, "current_a": float("inf")},
        lambda words: {**words, "flow_m3_s": None},
        lambda words: {**words, "options": [1, 2]},
        lambda words: {**words, "options": without(words["options"], "cis_mm")},
        lambda words: {**words, "options": {**words["options"], "colour": 1}},
        lambda words: {**words, "options": {**words["options"], "membrane_nm": -1.0}},
        lambda words: {**words, "options": {**words["options"], "membrane_nm": "x"}},
        lambda words: {**words, "options": {**words["options"], "membrane_nm": None}},
        lambda words: {**words, "options": {**words["options"], "electrical": "loose"}},
        *(
            lambda words, name=name: without(words, name)
            for name in ("kind", "quantities", "options", "voltage_v", "flow_error_rel")
        ),
    ],
)
def test_tables_of_hostile_words_are_refused_by_name(about, tmp_path, spoiled):
    words = np.array(json.dumps(spoiled(about.words)))
    refused(tmp_path / "evil.npz", {**about.content, "about": words})


@settings(deadline=None, max_examples=60)
@given(place=st.floats(0, 1), new=st.binary(min_size=1, max_size=8))
def test_damaged_tables_are_refused_or_unchanged(about, tmp_path_factory, place, new):
    whole = bytearray(about.path.read_bytes())
    at = int(place * (len(whole) - len(new)))
    whole[at : at + len(new)] = new
    path = tmp_path_factory.getbasetemp() / "damaged.npz"
    path.write_bytes(whole)
    # Any other exception fails the test.
    with contextlib.suppress(ArchiveError):
        loaded = FieldTable.load(path)
        np.testing.assert_array_equal(loaded.values, about.content["values"])


def test_failed_save_leaves_the_old_table(table, tmp_path):
    path = tmp_path / "field.npz"
    table.save(path)
    before = path.read_bytes()
    with pytest.raises(TypeError):
        dataclasses.replace(table, options={"voltage_v": object()}).save(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_embedded_table_is_shared():
    assert embedded_table() is embedded_table()
