"""`rotortrack simulate film|check|sample` and `tradeoff effects`: what they say and refuse."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

FILM = """[film]
width_px = 40
height_px = 32
n_frames = 12
[[rotors]]
x_nm = [2000.0]
y_nm = [1500.0]
[camera]
"""


@pytest.fixture
def scene(tmp_path: Path) -> Callable[..., Path]:
    def write(more: str = "") -> Path:
        path = tmp_path / "scene.toml"
        path.write_text(FILM + more, encoding="utf-8")
        return path

    return write


def test_a_film_is_told_with_its_truth(call, scene, tmp_path) -> None:
    done = call("simulate", "film", scene(), "-o", tmp_path / "film.tif", "--json")
    assert done.code == 0
    told = done.json
    assert (told["frames"], told["rotors"], told["effects"]) == (12, 1, ["rotors", "camera"])
    assert (tmp_path / "film.tif").is_file()
    assert Path(told["truth"]) == tmp_path / "film.truth"


def test_a_film_is_filmed_again_but_no_other_movie_is_lost(call, scene, tmp_path) -> None:
    for _ in range(2):
        assert call("simulate", "film", scene(), "-o", tmp_path / "film.tif").code == 0
    precious = tmp_path / "cells.tif"
    precious.write_bytes(b"a night of imaging")
    refused = call("simulate", "film", scene(), "-o", precious)
    assert refused.code == 2
    assert "cells.tif is there already without a truth beside it" in refused.err
    assert precious.read_bytes() == b"a night of imaging"


def test_of_a_film_that_fails_nothing_is_left(call, scene, tmp_path, monkeypatch) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("rotortrack.simulate.film.filming.write_movie", stop)
    assert call("simulate", "film", scene(), "-o", tmp_path / "film.tif").code == 130
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


@pytest.mark.parametrize(
    ("name", "effect", "said"),
    [
        ("film.tif", "[dropped]\nframes = [3]\n", "cannot know of [dropped]: name it .ome.tif"),
        ("film.tif", "[timestamps]\n", "cannot know of [timestamps]: name it .ome.tif"),
        ("film.ome.tif", "[dropped]\nframes = [3]\n", None),
        ("film.tif", "", None),
    ],
)
def test_times_that_a_movie_does_not_hold_are_told(
    call, scene, tmp_path, name, effect, said
) -> None:
    done = call("simulate", "film", scene(effect), "-o", tmp_path / name)
    assert done.code == 0
    assert (said in done.out) if said else ("cannot know" not in done.out)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--set", "film.n_frames=9"], "--set and --preset change a scene"),
        (["--analysis", "paper"], "a twin is analysed by its run's options"),
    ],
)
def test_what_a_twin_has_no_use_for_is_refused(call, tmp_path, given, says) -> None:
    done = call("simulate", "check", "--from-run", tmp_path / "run", *given, "-o", tmp_path / "t")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert says in done.err
    assert not list(tmp_path.iterdir())


def test_an_unknown_analysis_is_refused_before_the_film(call, scene, tmp_path) -> None:
    done = call("simulate", "check", scene(), "-o", tmp_path / "out", "--analysis", "papper")
    assert (done.code, done.err.count("\n")) == (4, 1)
    assert "--analysis papper is not known: known are default, paper" in done.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("name", "hint"), [("fiducials", "localise"), ("salt", "run")])
def test_a_sample_says_what_to_do_with_it(call, tmp_path, monkeypatch, name, hint) -> None:
    monkeypatch.setattr("rotortrack.simulate.sample.make_sample", lambda *_: None)
    done = call("simulate", "sample", name, "-o", tmp_path)
    assert f"try `rotortrack {hint} {tmp_path / 'movie.tif'} -c" in done.out


def test_effects_of_a_short_scene_are_told(call, scene, tmp_path) -> None:
    path = scene("[dropped]\nframes = [3]\n")
    done = call("tradeoff", "effects", path, "--quick", "-o", tmp_path / "costs", "--json")
    assert done.code == 0
    assert done.json["frames"] == 12
    assert {row["effect"] for row in done.json["effects"]} == {
        *("everything", "rotors", "camera", "dropped"),
    }
    assert {path.name for path in (tmp_path / "costs").iterdir()} == {
        *("effects.json", "effects.png"),
    }
