"""Which field a scene gets, and that the choice is told."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from rotortrack.errors import ArchiveError, ConfigurationError, FieldError
from rotortrack.simulate import scene_field
from rotortrack.simulate.field import solve
from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.scene_field import field_for


@pytest.fixture
def solved(monkeypatch):
    """Stand for the solver; give the options that it was called with."""
    asked = []

    def solve_field(options):
        asked.append(options)
        return SimpleNamespace(unknowns=12_345)

    monkeypatch.setattr(solve, "solve_field", solve_field)
    monkeypatch.setattr(scene_field, "tabulate", lambda _: embedded_table())
    return asked


def test_the_default_field_at_another_voltage_is_the_embedded_one_scaled(solved):
    found = field_for(FieldOptions(voltage_v=-0.05))
    assert found.source == "embedded"
    assert "-0.05 V" in found.origin
    assert found.unknowns is None
    assert found.table.voltage_v == -0.05
    assert found.table.current_a == pytest.approx(-0.5 * embedded_table().current_a, rel=0.03)
    assert solved == []
    assert field_for(FieldOptions()).table is embedded_table()


@pytest.mark.parametrize(
    "other",
    [{"surface_charge_e_nm2": -0.2}, {"cis_mm": 550.0}, {"voltage_v": 0.5}, {"voltage_v": -0.3}],
)
def test_another_pore_salt_or_high_voltage_is_solved(solved, other):
    options = FieldOptions(**other)
    found = field_for(options)
    assert found.source == "solved"
    assert found.unknowns == 12_345
    assert solved == [options]


def test_the_choice_can_be_made_by_hand(solved):
    assert field_for(FieldOptions(), solve=True).source == "solved"
    assert field_for(FieldOptions(), solve=False).source == "embedded"
    with pytest.raises(ConfigurationError) as caught:
        field_for(FieldOptions(surface_charge_e_nm2=-0.2, voltage_v=0.5), solve=False)
    assert len(caught.value.mistakes) == 2
    assert "surface_charge_e_nm2" in caught.value.mistakes[0]
    assert len(solved) == 1


def test_a_stored_field_is_scaled_and_one_of_another_pore_is_refused(tmp_path, solved):
    path = tmp_path / "field.npz"
    embedded_table().save(path)
    found = field_for(FieldOptions(voltage_v=0.15), file=path)
    assert found.source == "file"
    assert str(path) in found.origin
    assert found.table.voltage_v == 0.15
    with pytest.raises(ConfigurationError, match=r"field\.npz .*surface_charge_e_nm2"):
        field_for(FieldOptions(surface_charge_e_nm2=-0.2), file=path)
    assert solved == []


def test_a_stored_field_that_does_not_do_is_refused(tmp_path):
    path = tmp_path / "field.npz"
    embedded_table().save(path)
    with pytest.raises(FieldError, match=r"0\.2 V"):
        field_for(FieldOptions(voltage_v=0.5), file=path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ArchiveError, match=r"field\.npz"):
        field_for(FieldOptions(), file=path)
