"""What the README shows is true: its Python runs, its commands and exit codes exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rotortrack.exchange.tables import TableInfo, write_localisations
from rotortrack.movies.tiff import open_movie
from rotortrack.movies.write import write_movie
from rotortrack.simulate.film.scene import FILM_SECTIONS
from rotortrack.simulate.scene import SCENE_SECTIONS
from rotortrack_cli.exits import Exit
from rotortrack_cli.main import main, rotortrack

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_notebook_example_finds_the_rotors(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict[str, object] = {}
    exec(code, names)
    assert len(names["found"].rotors) == 8
    assert "omega_rad_s" in capsys.readouterr().out


def test_the_calibration_example_gives_maps_that_a_run_takes(monkeypatch, tmp_path):
    (block,) = re.findall(r"# calibrate the camera.*?\n(.*?)```", README, re.DOTALL)
    with open_movie(ROOT / "sample_data" / "rotors" / "movie.tif") as movie:
        write_movie(tmp_path / "movie.tif", [movie.frames(0, 200)])
        size = movie.shape[1:]
    rng = np.random.default_rng(1)
    for name, light in (("dark", 0), ("flat-1", 100), ("flat-2", 500), ("flat-3", 2000)):
        electrons = rng.poisson(light, (100, *size)) + rng.normal(0, 1.4, (100, *size))
        counts = np.rint(electrons / 1.5 + 100).astype(np.uint16)
        write_movie(tmp_path / f"{name}.tif", [counts])
    monkeypatch.chdir(tmp_path)
    lines = block.replace("\\\n", " ").splitlines()
    assert [shlex.split(line)[1] for line in lines] == ["calibrate", "info", "run"]
    for line in lines:
        assert main([*shlex.split(line)[1:], *(["-q"] if "info" not in line else [])]) == 0
    assert (tmp_path / "camera.png").is_file()
    assert len(pd.read_csv(tmp_path / "results" / "rotors.csv")) >= 6


def test_the_plan_that_is_shown_gives_the_advice_that_is_quoted(monkeypatch, tmp_path, capsys):
    (block,) = re.findall(r"# will 16 s show.*?\n(.*?)```", README, re.DOTALL)
    line = block.replace("\\\n", " ").splitlines()[0]
    (quoted,) = re.findall(r"The first ends with: \*(.*?)\*", README, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(line)[1:]) == 0
    assert " ".join(quoted.split()) in capsys.readouterr().out
    assert (tmp_path / "plan.png").is_file()


def test_the_tracking_example_makes_what_is_named(monkeypatch, tmp_path, swimming):
    (line,) = re.findall(r"# follow what moves freely\n(.*?)\n", README)
    spots = swimming(np.random.default_rng(1), 10, 60).drop(columns="truth")
    write_localisations(tmp_path / "localisations.parquet", spots, TableInfo())
    monkeypatch.chdir(tmp_path)
    assert main([*shlex.split(line)[1:], "-q"]) == 0
    for name in re.findall(r"`(mobile[-.]\w+(?:\.\w+)?)`", README):
        assert (tmp_path / name).is_file()


def test_every_section_of_a_scene_that_is_filmed_is_listed():
    (table,) = re.findall(r"\| section \| what it adds \|\n(.*?)\n\n", README, re.DOTALL)
    listed = re.findall(r"`\[+(\w+)\]+`", table)
    assert len(listed) == len(set(listed))
    assert set(listed) >= {*FILM_SECTIONS, "rotors"}
    assert set(listed) <= {*SCENE_SECTIONS, "rotors"}


COMMANDS = set(re.findall(r"(?:`|^|/|&& )rotortrack ([a-z-]+)\b", README, re.MULTILINE))


@pytest.mark.parametrize("word", sorted(COMMANDS))
def test_every_command_that_is_named_exists(word):
    assert word in rotortrack.lazy


def test_exit_codes_are_the_ones_that_are_used():
    (listed,) = re.findall(r"## Exit codes\n\n(.*?)\n*\Z", README, re.DOTALL)
    numbers = {int(number) for number in re.findall(r"\b\d+\b", listed)}
    assert numbers == {int(code) for code in Exit} - {Exit.READER_GONE}


def test_files_of_the_run_folder_and_pictures_exist():
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / picture).is_file()
