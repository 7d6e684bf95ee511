"""`--accuracy` sets what it says, gives way to everything else, and quotes stored tables."""

from __future__ import annotations

import pytest

from rotortrack.errors import ConfigurationError
from rotortrack.pipeline.accuracy import (
    DIALS,
    LEVELS,
    accuracy_layer,
    accuracy_of,
    cost_notes,
    stored_costs,
)
from rotortrack.pipeline.keys import stage_keys
from rotortrack.pipeline.presets import SECTIONS, preset_layer
from rotortrack.settings import Layer, resolve


def value_of(settings, option):
    section, _, key = option.partition(".")
    return getattr(settings[section], key)


@pytest.mark.parametrize("level", LEVELS)
def test_a_level_sets_every_dial_and_says_so(level):
    settings = resolve(SECTIONS, [accuracy_layer(level)])
    for dial in DIALS:
        assert value_of(settings, dial.option) == dial.value(level)
        assert settings.origins[dial.option] == f"accuracy {level}"
    assert accuracy_of(settings) == level


def test_balanced_is_the_defaults_and_changes_no_key():
    balanced, plain = resolve(SECTIONS, [accuracy_layer("balanced")]), resolve(SECTIONS, [])
    assert balanced.sections == plain.sections
    assert stage_keys([], balanced) == stage_keys([], plain)


@pytest.mark.parametrize("level", ["fast", "best"])
def test_another_level_is_another_choice_of_some_dials(level):
    assert any(dial.value(level) != dial.balanced for dial in DIALS)
    plain, chosen = resolve(SECTIONS, []), resolve(SECTIONS, [accuracy_layer(level)])
    keys, others = stage_keys([], plain), stage_keys([], chosen)
    assert keys["check"] == others["check"]
    assert keys["localise"] != others["localise"]


def test_what_is_given_wins_and_is_named():
    given = Layer("flag", {"localise": {"max_emitters": 2}})
    settings = resolve(SECTIONS, [accuracy_layer("fast"), given])
    assert settings["localise"].max_emitters == 2
    assert settings["circle"].method == "hyper"
    cost, others = cost_notes(settings)
    assert cost.startswith("--accuracy fast: beside balanced fast takes ")
    assert others == "--accuracy fast does not set localise.max_emitters: given otherwise"


def test_a_level_says_what_it_costs_beside_balanced():
    (cost,) = cost_notes(resolve(SECTIONS, [accuracy_layer("best")]))
    scenes = stored_costs()["scenes"]
    for kind, scene in scenes.items():
        (time, error), (usual_s, usual_nm) = scene["best"], scene["balanced"]
        assert f"{time / usual_s:.2f} times the time" in cost
        assert f"{error / usual_nm:.2f} times the error of {scene['measure']} ({kind})" in cost
    (cost,) = cost_notes(resolve(SECTIONS, [accuracy_layer("balanced")]))
    assert "the defaults: beside balanced fast takes" in cost
    assert "best takes" in cost


def test_without_a_level_nothing_is_said():
    assert cost_notes(resolve(SECTIONS, [])) == ()
    assert cost_notes(resolve(SECTIONS, [preset_layer("paper")])) == ()


def test_an_unknown_level_is_refused():
    with pytest.raises(ConfigurationError, match="known are fast, balanced, best"):
        accuracy_layer("sloppy")
