"""The manifest records inputs, options and warnings, and can be read again."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import tomllib
import warnings

import pytest

from rotortrack.errors import DriftWarning, RotortrackWarning
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import Noted, Record, versions
from rotortrack.settings import Layer, resolve
from rotortrack.toml import to_toml

GIVEN = {"movie": {"pixel_size_nm": 108.3, "region": [1, 2, 30, 40]}, "motion": {"min_steps": 9}}


def settings():
    return resolve(SECTIONS, [Layer("flag", GIVEN)])


def test_toml_of_the_settings_gives_the_same_settings():
    again = resolve(SECTIONS, [Layer("again", tomllib.loads(to_toml(settings().as_dict())))])
    assert again.sections == settings().sections


def test_a_manifest_gives_the_options_back_with_their_origin():
    record = Record("rotors")
    record.options(settings())
    record.count(frames=7)
    later = Record("motion")
    layers = later.continue_from(json.loads(json.dumps(record.content)))
    assert later.content["steps"] == ["rotors", "motion"]
    again = resolve(SECTIONS, layers)
    assert again.sections == settings().sections
    assert again.origins["movie.pixel_size_nm"] == "flag"
    assert again.origins["density.radius_nm"] == "default"


def test_our_warnings_are_recorded_and_still_shown():
    record = Record("run")
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        with record.warnings():
            warnings.warn("ours", RotortrackWarning, stacklevel=1)
            warnings.warn("theirs", DeprecationWarning, stacklevel=1)
    assert record.content["warnings"] == ["ours"]
    assert "ours" in [str(warning.message) for warning in shown]


def test_stages_are_timed_even_when_they_fail():
    record = Record("run")
    with pytest.raises(ZeroDivisionError), record.timed("stage"):
        raise ZeroDivisionError
    assert record.content["seconds"]["stage"] >= 0


def test_what_a_stage_notes_is_repeated_when_the_stage_is_taken_over():
    first = Record("run")
    first.count(frames=3)

    def stage():
        with first.warnings(), first.noting() as noted:
            first.note("a choice")
            first.count(precise=2)
            warnings.warn("weak", DriftWarning, stacklevel=1)
        return noted

    with pytest.warns(DriftWarning):
        noted = stage()
    kept = Noted.from_json(json.loads(json.dumps(dataclasses.asdict(noted))))
    second = Record("run")
    second.count(frames=3)
    with pytest.warns(DriftWarning, match="weak"), second.warnings():
        second.repeat(kept)
    for key in ("notes", "warnings", "counts"):
        assert second.content[key] == first.content[key]


@pytest.mark.parametrize(
    "content",
    [{}, {"notes": 3, "warnings": [], "counts": {}}, {"notes": [], "warnings": [3], "counts": {}}],
)
def test_what_was_not_noted_by_us_is_refused(content):
    with pytest.raises((KeyError, TypeError, ValueError)):
        Noted.from_json(content)


def test_tables_repeat_nothing_that_changes_from_run_to_run():
    records = [Record("run"), Record("run")]
    for record, seconds in zip(records, (1.0, 2.0), strict=True):
        record.content["seconds"]["localise"] = seconds
    assert records[0].provenance == records[1].provenance
    assert {"versions", "inputs", "options", "counts"} <= set(records[0].provenance)


def test_versions_are_those_of_the_installed_packages():
    told = versions()
    for name in ("numpy", "scipy", "numba", "pandas", "pyarrow", "tifffile", "rotortrack"):
        assert told[name] == importlib.metadata.version(name)
