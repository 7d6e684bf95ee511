"""`rotortrack simulate field|rod|scan`: results as files and JSON, failures in one sentence."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rotortrack.errors import RodError
from rotortrack.simulate import scan

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "sample_data" / "scenes"

FREE_ROD = "[rod]\nn_vertices = 11\n[stepping]\nduration_us = 2.0\n"
ROD = f"[field]\n{FREE_ROD}"
SCAN = f"{ROD}[scan]\nlambda_eff = [0.1, 0.26]\nflow_ratio = [90]\n" + (
    "offset_x_nm = [0]\noffset_y_nm = [3]\n"
)

MODULES = """
import json, sys
from rotortrack_cli.main import main
code = main(sys.argv[1:])
print(json.dumps([code, sorted(sys.modules)]))
"""


@pytest.fixture
def scene(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "scene.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize("word", ["field", "rod", "scan"])
def test_help_loads_neither_numpy_nor_numba(word: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", MODULES, "simulate", word, "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    code, modules = json.loads(done.stdout.splitlines()[-1])
    assert code == 0
    assert not {"numpy", "numba", "scipy", "skfem", "pandas", "pyarrow"} & set(modules)
    assert "SCENE.toml" in done.stdout


@pytest.mark.parametrize("word", ["field", "rod", "scan"])
def test_a_broken_scene_tells_every_mistake_and_makes_nothing(call, scene, tmp_path, word) -> None:
    path = scene("[rod]\nlambda_ef = 0.2\nn_vertices = 1\n[feild]\n")
    done = call("simulate", word, path, "-o", tmp_path / "out.npz")
    assert done.code == 4
    lines = done.err.splitlines()
    assert len(lines) == 3
    assert all(line.startswith("rotortrack: ") for line in lines)
    assert "did you mean lambda_eff?" in done.err
    assert "did you mean field?" in done.err
    assert [path] == list(tmp_path.iterdir())


@pytest.mark.parametrize("text", ["[rod", "x = 1", "[rod]\nlambda_eff = nan"])
def test_a_scene_with_one_mistake_is_one_sentence(call, scene, tmp_path, text) -> None:
    done = call("simulate", "rod", scene(text), "-o", tmp_path / "rod.npz")
    assert (done.code, done.err.count("\n")) == (4, 1)


def test_a_scene_that_cannot_be_read_is_unusable_input(call, tmp_path) -> None:
    for path in (tmp_path / "absent.toml", tmp_path):
        done = call("simulate", "rod", path, "-o", tmp_path / "rod.npz")
        assert (done.code, done.err.count("\n")) == (3, 1)
        assert str(path) in done.err


@pytest.mark.parametrize(
    ("word", "text", "absent"),
    [("field", FREE_ROD, "[field]"), ("rod", "[field]", "[rod]"), ("scan", FREE_ROD, "[scan]")],
)
def test_a_section_that_the_command_needs_is_named(call, scene, tmp_path, word, text, absent):
    done = call("simulate", word, scene(text), "-o", tmp_path / "out.npz")
    assert (done.code, done.err.count("\n")) == (4, 1)
    assert f"no {absent} section" in done.err


def test_values_set_on_the_command_line_win_and_are_checked(call, scene, tmp_path) -> None:
    output = tmp_path / "rod.npz"
    path = scene(FREE_ROD)
    done = call("simulate", "rod", path, "-o", output, "--set", "rod.n_vertices=2")
    assert done.code == 4
    assert "--set" in done.err
    done = call("simulate", "rod", path, "-o", output, "--set", "rod.n_vertices=7", "--json", "-q")
    assert done.code == 0
    with np.load(output) as content:
        assert content["positions_nm"].shape[1:] == (7, 3)


@pytest.mark.parametrize("word", ["field", "rod"])
def test_a_name_without_the_ending_is_refused(call, scene, tmp_path, word) -> None:
    done = call("simulate", word, scene(ROD), "-o", tmp_path / "out.csv")
    assert done.code == 2
    assert ".npz" in done.err


def test_a_field_cannot_be_chosen_for_a_scene_that_has_none(call, scene, tmp_path) -> None:
    done = call("simulate", "rod", scene(FREE_ROD), "-o", tmp_path / "rod.npz", "--solve")
    assert done.code == 2
    assert "no [field] section" in done.err


def test_the_field_of_the_shipped_scene(call, tmp_path) -> None:
    output = tmp_path / "field.npz"
    done = call("simulate", "field", SAMPLES / "field.toml", "-o", output, "--json", "-q")
    assert done.code == 0
    keys = {"current_a", "flow_m3_s", "current_error_rel", "flow_error_rel", "unknowns", "seconds"}
    assert keys <= done.json.keys()
    assert done.json["current_a"] == pytest.approx(2.05e-9, rel=0.01)
    assert done.json["flow_m3_s"] == pytest.approx(4.0e-17, rel=0.01)
    assert done.json["field"].startswith("embedded table")
    again = call(
        *("simulate", "rod", SAMPLES / "rod.toml", "-o", tmp_path / "rod.npz", "--field", output),
        *("--set", "stepping.duration_us=1", "--json", "-q"),
    )
    assert again.code == 0
    assert str(output) in again.json["field"]


def test_a_free_rod(call, scene, tmp_path) -> None:
    done = call("simulate", "rod", scene(FREE_ROD), "-o", tmp_path / "rod.npz", "--json", "-q")
    assert done.code == 0
    keys = {"end", "rate_rev_s", "end_to_end_nm", "power_pn_nm_s", "simulated_us", "seconds"}
    assert keys <= done.json.keys()
    assert done.json["end"] == "time_reached"
    assert done.json["simulated_us"] == pytest.approx(2.0)
    # Nothing pulls at it, so it stays straight.
    assert done.json["end_to_end_nm"] == pytest.approx(450.0, abs=1e-6)


def test_a_scan_is_made_told_and_not_made_again(call, scene, tmp_path) -> None:
    path, folder = scene(SCAN), tmp_path / "scan"
    done = call("simulate", "scan", path, "-o", folder, "--workers", "1", "--json", "-q")
    assert done.code == 0
    assert {"runs", "ends", "seconds"} <= done.json.keys()
    assert done.json["runs"] == sum(done.json["ends"].values()) == 2
    written = (folder / "runs.parquet").stat().st_mtime_ns
    again = call("simulate", "scan", path, "-o", folder)
    assert again.code == 0
    assert (folder / "runs.parquet").stat().st_mtime_ns == written
    assert again.out.splitlines()[0].split() == ["ratio", "0.1", "0.26"]
    assert "2 runs in" in again.out
    refused = call("simulate", "scan", path, "-o", folder, "--set", "scan.flow_ratio=[100]")
    assert refused.code == 2
    assert "--overwrite" in refused.err
    replaced = call(
        *("simulate", "scan", path, "-o", folder, "--set", "scan.flow_ratio=[100]"),
        *("--overwrite", "--workers", "2"),
    )
    assert replaced.code == 0


def test_a_rod_that_cannot_be_made_is_told_before_the_scan(call, scene, tmp_path) -> None:
    thick = SCAN.replace("[rod]", "[rod]\nrod_radius_nm = 30")
    done = call("simulate", "scan", scene(thick), "-o", tmp_path / "scan")
    assert done.code == 3
    assert "rod_radius_nm" in done.err
    assert not (tmp_path / "scan").exists()


def test_runs_that_fail_are_counted_and_the_first_is_explained(call, scene, tmp_path, monkeypatch):
    def fail(*_):
        raise RodError("step 3 at 1 us: a vertex is not finite: give a shorter step_us")

    monkeypatch.setattr(scan, "simulate_rod", fail)
    done = call("simulate", "scan", scene(SCAN), "-o", tmp_path / "scan", "--workers", "1")
    assert done.code == 0
    assert "2 runs; the first: step 3 at 1 us" in done.out
    assert done.out.splitlines()[1].split() == ["90", "x", "x"]


def test_a_rotating_rod_tells_its_own_state_errors_and_picture(call, tmp_path) -> None:
    output, animation = tmp_path / "rod.npz", tmp_path / "rod.gif"
    words = ("-o", output, "--equilibrium", "--budget", "--animate", animation, "--json")
    settled = ("--set", "start.offset_x_nm=40", "--set", "start.offset_y_nm=8")
    done = call("simulate", "rod", SAMPLES / "rod.toml", *settled, *words)
    assert done.code == 0, done.err
    told = done.json
    assert told["end"] == "rotating_steadily"
    assert told["equilibrium"]["is_stable"]
    assert told["equilibrium"]["rate_rev_s"] == pytest.approx(told["rate_rev_s"], rel=5e-4)
    assert told["rate_error_rel"]["stepping"] < 1e-4
    assert told["rate_error_rel"]["total"] >= told["rate_error_rel"]["vertices"] > 0.0
    assert {path.name for path in tmp_path.iterdir()} == {"rod.npz", "rod.png", "rod.gif"}


def test_pictures_can_be_left_out_and_other_animations_are_refused(call, scene, tmp_path) -> None:
    folder = tmp_path / "made"
    folder.mkdir()
    path = scene(FREE_ROD)
    done = call("simulate", "rod", path, "-o", folder / "rod.npz", "--animate", folder / "rod.avi")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "rod.avi" in done.err
    done = call("simulate", "rod", path, "-o", folder / "rod.npz", "--no-figures")
    assert done.code == 0
    assert [one.name for one in folder.iterdir()] == ["rod.npz"]
