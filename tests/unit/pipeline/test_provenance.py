"""The manifest records inputs, options and warnings, and can be read again."""

from __future__ import annotations

import hashlib
import json
import tomllib
import warnings

import pytest

from rotortrack.errors import InputError, RotortrackWarning
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import Record, describe_input, to_toml
from rotortrack.settings import Layer, resolve

GIVEN = {"movie": {"pixel_size_nm": 108.3, "region": [1, 2, 30, 40]}, "motion": {"min_steps": 9}}


def settings():
    return resolve(SECTIONS, [Layer("flag", GIVEN)])


def test_toml_of_the_settings_gives_the_same_settings():
    again = resolve(SECTIONS, [Layer("again", tomllib.loads(to_toml(settings().as_dict())))])
    assert again.sections == settings().sections


def test_an_input_is_named_from_the_run_folder_with_size_and_hash(tmp_path):
    (tmp_path / "movies").mkdir()
    path = tmp_path / "movies" / "a.tif"
    path.write_bytes(b"12345")
    found = describe_input(path, tmp_path / "runs" / "one")
    assert found == {
        "path": "../../movies/a.tif",
        "bytes": 5,
        "sha256": hashlib.sha256(b"12345").hexdigest(),
    }
    with pytest.raises(InputError, match=r"none\.tif"):
        describe_input(tmp_path / "none.tif", tmp_path)


def test_a_manifest_gives_the_options_back_with_their_origin():
    record = Record("rotors")
    record.options(settings())
    record.count(frames=7)
    layers = Record("motion").continue_from(json.loads(record.json()))
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
