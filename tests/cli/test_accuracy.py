"""`rotortrack run --accuracy` and `rotortrack tradeoff`: what they say, record and refuse."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rotortrack.cameras.camera import Camera
from rotortrack.errors import RotortrackWarning
from rotortrack.movies.write import write_movie
from rotortrack.simulate.ideal_examples import example_scene
from rotortrack.simulate.ideal_film import film
from rotortrack.tradeoff.questions import QUESTIONS, noise

GIVEN = (
    *("--pixel-size-nm", 108.3, "--frame-interval-s", 0.002, "--exposure-s", 0.002),
    *("--offset-adu", 100.0, "--gain-e-per-adu", 1.5, "--read-noise-e", 1.4),
)


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RotortrackWarning)
        yield


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("movie") / "movie.tif"
    scene = example_scene(
        ("driven_ccw", "brownian"), rng=np.random.default_rng(3), shape_px=(48, 64), n_frames=240
    )
    camera = Camera(offset_adu=100.0, gain_e_per_adu=1.5, read_noise_e=1.4)
    made = film(scene, camera, np.random.default_rng(4))
    write_movie(path, made.blocks(), shape=made.shape)
    return path


def test_a_run_is_told_its_cost_recorded_resumed_and_reproduced(call, movie, tmp_path) -> None:
    run = tmp_path / "run"
    words = ("run", movie, "-o", run, *GIVEN, "--no-figures", "--accuracy", "fast")
    done = call(*words, "--set", "circle.method=kasa")
    assert done.code == 0
    told = " ".join(done.out.split())
    assert "--accuracy fast: beside balanced fast takes" in told
    assert "does not set circle.method: given otherwise" in told
    first = json.loads((run / "run.json").read_text())
    assert first["options"]["localise"]["max_emitters"] == {"value": 1, "origin": "accuracy fast"}
    assert first["options"]["circle"]["method"]["origin"] == "--set"
    assert call(*words).code == 0
    again = json.loads((run / "run.json").read_text())
    assert again["options"]["circle"]["method"] == {"value": "hyper", "origin": "accuracy fast"}
    # The option that changed reruns its stage and the later ones alone.
    same = {name for name, key in first["keys"].items() if again["keys"][name] == key}
    assert same == {"check", "localise", "correct"}
    assert call("run", "--reproduce", run, "--json").json["identical"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--preset", "paper"), "--accuracy best and --preset paper both set"),
        (("--reproduce", "run"), "takes all options from the run"),
    ],
)
def test_what_contradicts_a_level_is_one_sentence(call, movie, tmp_path, words, said) -> None:
    done = call("run", movie, "-o", tmp_path / "run", *GIVEN, "--accuracy", "best", *words)
    assert done.code == 2
    assert said in " ".join(done.err.split())
    assert not (tmp_path / "run").exists()


def test_a_question_is_answered_on_screen_in_files_and_in_json(call, tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(noise.SIZES, "quick", noise.Sizes(0.5, 0.5, (0.1, 0.2), (0.1,)))
    done = call("tradeoff", "noise", "--quick", "-o", tmp_path / "told")
    assert done.code == 0
    assert "midpoint 0.1 ns" in done.out
    assert "default" in done.out
    assert "Pareto" in done.out
    folder = tmp_path / "told"
    assert {path.name for path in folder.iterdir()} == {"noise.json", "noise.csv", "noise.png"}
    stored = json.loads((folder / "noise.json").read_text())
    assert stored["effort"] == "quick"
    assert call("tradeoff", "noise", "--quick", "--json").json["question"] == "noise"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("weather",), f"weather is not a question: known are {next(iter(QUESTIONS))}"),
        (("noise", "--quick", "--thorough"), "--quick and --thorough exclude each other"),
        (("noise", "scene.toml"), "scene.toml is not a question"),
    ],
)
def test_what_cannot_be_asked_is_one_sentence(call, words, said) -> None:
    done = call("tradeoff", *words)
    assert done.code == 2
    assert said in " ".join(done.err.split())


def test_answers_without_a_place_are_not_asked_for(call, tmp_path, monkeypatch):
    monkeypatch.setattr("rotortrack.tradeoff.ask.ask", lambda *_: pytest.fail("asked"))
    (tmp_path / "file").write_text("x", encoding="utf-8")
    done = call("tradeoff", "noise", "--quick", "-o", tmp_path / "file" / "told")
    assert done.code == 7
    assert "told cannot be made a folder" in done.err
