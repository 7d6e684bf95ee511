"""Scenes: sections that are absent are off, and every mistake is told at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from rotortrack.errors import ConfigurationError, InputError
from rotortrack.settings import Layer
from rotortrack.simulate.film.scene import FILM_SECTIONS
from rotortrack.simulate.options import ScanOptions
from rotortrack.simulate.rod.options import StartOptions, SteppingOptions
from rotortrack.simulate.scene import SCENE_SECTIONS, make_scene, read_scene

SAMPLES = Path(__file__).parents[3] / "sample_data" / "scenes"


def scene_of(tmp_path: Path, text: str, **kwargs):
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return read_scene(path, **kwargs)


def test_effects_that_an_empty_scene_does_not_name_are_off(tmp_path):
    scene = scene_of(tmp_path, "")
    assert (scene.field, scene.rod, scene.thermal, scene.scan) == (None, None, None, None)
    assert scene.start == StartOptions()
    assert scene.stepping == SteppingOptions()


@pytest.mark.parametrize("section", [name for name in SCENE_SECTIONS if name not in FILM_SECTIONS])
def test_a_named_section_holds_its_defaults_and_brings_no_other(tmp_path, section):
    scene = scene_of(tmp_path, f"[{section}]\n")
    assert getattr(scene, section) == SCENE_SECTIONS[section]()
    others = {"field", "rod", "thermal", "scan"} - {section}
    assert all(getattr(scene, name) is None for name in others)


def test_values_and_their_origins(tmp_path):
    scene = scene_of(tmp_path, "[rod]\nlambda_eff = 0.3\n[scan]\nflow_ratio = [90, 100.5]\n")
    assert scene.rod.lambda_eff == 0.3
    assert scene.scan.flow_ratio == (90.0, 100.5)
    assert scene.settings.origins["rod.lambda_eff"] == f"scene {tmp_path / 'scene.toml'}"
    assert scene.settings.origins["rod.flow_ratio"] == "default"
    assert scene.as_dict()["scan"]["flow_ratio"] == [90.0, 100.5]
    assert "thermal" not in scene.as_dict()


def test_what_is_set_beside_the_file_wins_and_names_effects_too(tmp_path):
    layer = Layer("--set", {"rod": {"lambda_eff": 0.4}, "thermal": {"seed": 7}})
    scene = scene_of(tmp_path, "[rod]\nlambda_eff = 0.3\n", layers=[layer])
    assert scene.rod.lambda_eff == 0.4
    assert scene.thermal.seed == 7


def test_a_preset_fills_what_the_scene_leaves_open_and_brings_no_effect(tmp_path):
    scene = scene_of(tmp_path, "[rod]\nwall = 'none'\n", preset="paper_literal")
    assert (scene.rod.bending, scene.rod.wall) == ("printed", "none")
    assert scene.stepping.method == "paper"
    assert scene_of(tmp_path, "", preset="paper_literal").rod is None


def test_every_mistake_of_every_section_is_told_at_once(tmp_path):
    text = """
        [rodd]
        length_nm = 450
        [rod]
        lenght_nm = 450
        n_vertices = 2
        lambda_eff = "much"
        [scan]
        offset_x_nm = [0, 1]
        offset_y_nm = [3]
        [thermal]
        temperature_k = -1
        seed = 1.5
    """
    with pytest.raises(ConfigurationError) as caught:
        scene_of(tmp_path, text)
    sentences = caught.value.mistakes
    assert len(sentences) == 7
    for words in (
        ("[rodd]", "did you mean rod?"),
        ("lenght_nm", "did you mean length_nm?"),
        ("n_vertices", "at least 3"),
        ("lambda_eff", "much"),
        ("[scan]", "2 and 1 numbers"),
        ("temperature_k", "greater than 0"),
        ("seed", "1.5"),
    ):
        assert len([told for told in sentences if all(word in told for word in words)]) == 1


@pytest.mark.parametrize("text", ["[rod", "lambda_eff = 0.2", "[[rod]]\n", "[rod]\nx = nan nan"])
def test_text_that_is_no_scene_is_one_sentence(tmp_path, text):
    with pytest.raises(ConfigurationError) as caught:
        scene_of(tmp_path, text)
    assert len(caught.value.mistakes) == 1
    assert "scene.toml" in str(caught.value)


def test_a_file_that_cannot_be_read_is_an_input_error(tmp_path):
    for path in (tmp_path / "absent.toml", tmp_path):
        with pytest.raises(InputError, match=path.name):
            read_scene(path)


def test_a_missing_section_is_named_with_the_file(tmp_path):
    scene = scene_of(tmp_path, "[field]\n")
    scene.require("field")
    with pytest.raises(ConfigurationError) as caught:
        scene.require("field", "rod", "scan")
    assert [mistake.split(": ")[0] for mistake in caught.value.mistakes] == [
        f"{tmp_path / 'scene.toml'} has no [rod] section",
        f"{tmp_path / 'scene.toml'} has no [scan] section",
    ]


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"lambda_eff": ()}, "at least one number"),
        ({"lambda_eff": (0.1, 0.2, 0.1)}, "0.1 more than once"),
        ({"lambda_eff": (0.1, 0.0)}, "greater than 0"),
        ({"flow_ratio": (float("inf"),)}, "finite"),
        ({"offset_x_nm": ()}, "at least one number"),
        ({"offset_x_nm": (0.0,) * 999, "offset_y_nm": (0.0,) * 1000}, "999 and 1000"),
        ({"lambda_eff": tuple(range(1, 4000)), "flow_ratio": tuple(range(400))}, "4798800 runs"),
    ],
)
def test_grids_that_make_no_scan_are_refused(values, sentence):
    with pytest.raises(ConfigurationError, match=sentence):
        ScanOptions(**values)


def test_the_shipped_scenes_name_what_they_need():
    scenes = {path.stem: read_scene(path) for path in SAMPLES.glob("*.toml")}
    assert scenes.keys() == {"check", "field", "rod", "scan", "small_scan"}
    scenes["check"].require("field", "rod", "scan", "film")
    scenes["field"].require("field")
    scenes["rod"].require("field", "rod")
    scenes["small_scan"].require("field", "rod", "scan")
    assert scenes["scan"].scan == ScanOptions()
    assert scenes["scan"].scan.runs == 264


def test_a_scene_is_made_of_values_without_a_file():
    scene = make_scene([Layer("test", {"rod": {"n_vertices": 11}})])
    assert scene.rod.n_vertices == 11
    with pytest.raises(ConfigurationError, match="the scene has no \\[scan\\]"):
        scene.require("scan")
