"""Presets hold valid options, and say what they had to choose."""

from __future__ import annotations

import pytest

from rotortrack.errors import ConfigurationError
from rotortrack.pipeline.presets import PRESETS, SECTIONS, notes_on, preset_layer
from rotortrack.settings import Layer, resolve


@pytest.mark.parametrize("name", PRESETS)
def test_every_value_of_a_preset_is_an_option(name):
    settings = resolve(SECTIONS, [preset_layer(name)])
    for section, values in PRESETS[name].items():
        for key, value in values.items():
            assert getattr(settings[section], key) == value
            assert settings.origins[f"{section}.{key}"] == f"preset {name}"


def test_a_flag_wins_over_config_over_preset_over_file():
    layers = [
        Layer("file", {"movie": {"pixel_size_nm": 1.0, "exposure_s": 1.0}}),
        preset_layer("paper"),
        Layer("config", {"movie": {"pixel_size_nm": 2.0}, "localise": {"method": "lsq"}}),
        Layer("flag", {"movie": {"pixel_size_nm": 3.0}}),
    ]
    settings = resolve(SECTIONS, layers)
    assert settings["movie"].pixel_size_nm == 3.0
    assert settings["movie"].exposure_s == 1.0
    assert settings["localise"].method == "lsq"
    assert settings["localise"].uncertainty == "thunderstorm-2016"


def test_the_paper_preset_names_what_the_paper_leaves_open():
    assert any("radius" in note for note in notes_on(resolve(SECTIONS, [preset_layer("paper")])))
    assert notes_on(resolve(SECTIONS, [])) == ()


def test_an_unknown_preset_is_refused():
    with pytest.raises(ConfigurationError, match="paper"):
        preset_layer("nature")
