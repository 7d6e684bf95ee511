"""Options, presets and the numbers that come of them."""

from __future__ import annotations

import dataclasses

import pytest

from rotortrack.errors import ConfigurationError, RodError
from rotortrack.settings import option_fields
from rotortrack.simulate.rod import parameters
from rotortrack.simulate.rod.options import (
    CORRECTED,
    PAPER_LITERAL,
    PRESETS,
    RodOptions,
    StartOptions,
    SteppingOptions,
    ThermalOptions,
)
from rotortrack.simulate.rod.parameters import rod_parameters

SECTIONS = {"rod": RodOptions, "stepping": SteppingOptions}


@pytest.mark.parametrize("preset", PRESETS)
def test_every_value_of_a_preset_is_an_option_and_passes_its_check(preset):
    for section, values in PRESETS[preset].items():
        options = SECTIONS[section](**values)
        for name, value in values.items():
            assert getattr(options, name) == value


def test_the_corrected_preset_is_the_default():
    for section, values in CORRECTED.items():
        assert SECTIONS[section](**values) == SECTIONS[section]()


def test_the_literal_preset_differs_from_the_default_in_all_it_names():
    for section, values in PAPER_LITERAL.items():
        default = SECTIONS[section]()
        assert all(getattr(default, name) != value for name, value in values.items())


def test_the_literal_preset_gives_the_flow_factor_of_the_papers_examples():
    rod = rod_parameters(RodOptions(**PAPER_LITERAL["rod"]), None)
    assert rod[parameters.FLOW] == pytest.approx(19.5)


@pytest.mark.parametrize(
    "options_class", [RodOptions, SteppingOptions, StartOptions, ThermalOptions]
)
def test_every_option_is_described_without_a_full_stop(options_class):
    for field in option_fields(options_class):
        assert field.description
        assert not field.description.endswith(".")


def test_wrong_values_are_listed_at_once():
    with pytest.raises(ConfigurationError, match=r"n_vertices must be at least 3.*bending must be"):
        RodOptions(n_vertices=2, bending="typo")


def test_parameters_are_those_of_the_paper_in_nm_us_and_pn(pore):
    rod = rod_parameters(RodOptions(lambda_eff=1.0), pore)
    assert rod[parameters.BENDING_PN_NM2] == pytest.approx(6213.0, abs=0.5)
    assert rod[parameters.EDGE_NM] == 9.0
    assert rod[parameters.ELECTRIC_PN_NM_PER_V_M] == pytest.approx(-5.6546e-6, rel=1e-4)
    assert rod[parameters.ZETA_PERP_PER_NM] == 2.0 * rod[parameters.ZETA_PAR_PER_NM]
    assert rod[parameters.HALF_MEMBRANE_NM] == 10.0


def test_positions_in_the_vector_are_all_different():
    names = [name for name in vars(parameters) if name.isupper()]
    indices = [
        getattr(parameters, name) for name in names if isinstance(getattr(parameters, name), int)
    ]
    assert sorted(indices) == list(range(parameters.PARAMETERS + 1))


def test_a_rod_thicker_than_the_pore_is_refused(make_pore):
    with pytest.raises(RodError, match=r"must be below the pore's radius of 2\.5 nm"):
        rod_parameters(RodOptions(), make_pore(pore_radius_nm=2.5))
    # Without contact its radius means nothing.
    rod_parameters(RodOptions(wall="none"), make_pore(pore_radius_nm=2.5))


def test_options_survive_a_round_trip_through_their_values():
    rod = RodOptions(n_vertices=101, wall="z_only", friction_length_nm=30.0)
    assert RodOptions(**dataclasses.asdict(rod)) == rod
