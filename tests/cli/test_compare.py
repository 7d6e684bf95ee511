"""`rotortrack compare` as a user calls it: tables, figures, sentences and exit codes."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pandas as pd
import pytest

from rotortrack.twocolour.compare_tables import COMPARISON

sys.path.insert(0, str(Path(__file__).parents[1] / "unit" / "twocolour"))
from planted_groups import GRID, write_run, write_scan

SCENES = Path(__file__).parents[2] / "sample_data" / "scenes"
FAST = ("--resamples", 100, "--permutations", 99, "--twins", 2)
FILES = {"comparison.csv", "comparison.json", "distances.png", "speeds.png"}


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """Write two runs and a scan, which tests only read."""
    folder = tmp_path_factory.mktemp("compare")
    write_run(folder / "one", 1, mirrored="false")
    write_run(folder / "other", 2, mean_nm=260.0)
    write_scan(folder / "grid")
    return folder


def names(folder):
    return {path.name for path in folder.iterdir()}


def test_runs_and_a_scan_become_a_table_facts_and_figures(call, given, tmp_path):
    paths = [given / name for name in ("one", "other", "grid")]
    ended = call("compare", *paths, "-o", tmp_path / "out", "-q", *FAST)
    assert (ended.code, ended.err) == (0, "")
    assert names(tmp_path / "out") == FILES
    table = pd.read_csv(tmp_path / "out" / "comparison.csv")
    assert list(table) == COMPARISON.names
    assert set(zip(table["first"], table["second"], strict=True)) == {
        *(("one", "other"), ("one", "grid"), ("other", "grid")),
    }
    told = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert len(told["comparisons"]) == len(table)
    assert told["provenance"]["options"]["compare"]["twins"]["value"] == 2
    files = {entry["path"].rpartition("/")[2] for entry in told["provenance"]["inputs"]}
    assert files == {
        *("end_to_end.parquet", "end_to_end_rotors.parquet", "rotors.parquet"),
        *("runs.parquet", "shapes.npz"),
    }
    assert "one against grid" in ended.out
    assert "simulated rods are rigid" in ended.out
    assert "no p-value: a grid of parameters is not a population" in ended.out
    assert "other: whether the optics flip the image is not known" in ended.out
    assert max(map(len, ended.out.split("note:")[0].splitlines())) <= 100


def test_one_run_alone_is_compared_into_its_own_folder_and_twice(call, tmp_path):
    run = write_run(tmp_path / "run", 3)
    for _ in range(2):
        ended = call("compare", run, "--json", "-q", *FAST)
        assert ended.code == 0
        assert ended.json["comparisons"] == []
        assert ended.json["groups"][0]["correlation"]["rho"]["value"] > 0.3
        assert ended.json["output"] == str(run / "comparison")
    assert names(run / "comparison") == FILES


def test_equal_calls_give_equal_files(call, given, tmp_path):
    for name in ("a", "b"):
        call("compare", given / "one", given / "grid", "-o", tmp_path / name, "-q", *FAST)
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


@pytest.mark.parametrize("prior", ["uniform", "file"])
def test_a_declared_prior_gives_p_values(call, given, tmp_path, prior):
    if prior == "file":
        prior = tmp_path / "prior.csv"
        prior.write_text("lambda_eff,flow_ratio,weight\n0.1,120,2\n0.2,130,1\n")
    paths = given / "one", given / "grid"
    ended = call("compare", *paths, "-o", tmp_path / "out", "--prior", prior, "--json", "-q", *FAST)
    assert ended.code == 0
    assert all(row["p"] is not None for row in ended.json["comparisons"])
    assert ended.json["scans"][0]["cells"] == (6 if prior == "uniform" else 2)


def test_handedness_is_compared_once_the_flip_is_given(call, given, tmp_path):
    paths = given / "one", given / "other"
    plain, flipped = (
        call("compare", *paths, "-o", tmp_path / "out", "--mirrored", word, "--json", "-q", *FAST)
        for word in ("false", "true")
    )
    shares = [
        next(row for row in ended.json["comparisons"] if row["quantity"] == "ccw_share")
        for ended in (plain, flipped)
    ]
    assert shares[0]["first_mean"] == pytest.approx(1.0 - shares[1]["first_mean"])
    assert shares[0]["p"] == shares[1]["p"]


def test_a_scan_as_it_is_simulated_is_read(call, given, tmp_path):
    scan = tmp_path / "small-scan"
    assert call("simulate", "scan", SCENES / "small_scan.toml", "-o", scan, "-q").code == 0
    ended = call("compare", given / "one", scan, "-o", tmp_path / "out", "--json", "-q", *FAST)
    assert ended.code == 0
    told = ended.json["scans"][0]
    assert (told["rods"], told["shapes"], told["cells"]) == (1, 1, 1)
    row = ended.json["comparisons"][0]
    assert row["second_mean"] == pytest.approx(told["mean_nm"], rel=0.05)


def refused(call, code, *arguments):
    """Call, and give the one sentence that says why not."""
    ended = call("compare", *arguments, "-q", *FAST)
    assert ended.code == code
    assert ended.err.count("\n") == 1
    assert ended.out == ""
    return ended.err


def test_what_cannot_be_compared_is_one_sentence(call, given, tmp_path):
    one, grid = given / "one", given / "grid"
    assert "is a scan: name first the run" in refused(call, 2, grid, one)
    assert "is given twice" in refused(call, 2, one, given / "other" / ".." / "one")
    assert "--prior is of the cells of a scan" in refused(call, 2, one, "--prior", "uniform")
    assert "holds the results of a run or scan" in refused(call, 2, one, "-o", grid)
    assert "is not a run folder" in refused(call, 3, one, tmp_path)
    sentence = refused(call, 4, one, "--test-frames")
    assert "whole rotors are permuted instead" in sentence
    assert "no.csv" in refused(call, 3, one, grid, "--prior", tmp_path / "no.csv")
    assert names(given) == {"one", "other", "grid"}
    assert not (one / "comparison").exists()


def test_a_run_without_two_colours_is_told_what_to_do(call, tmp_path):
    run = write_run(tmp_path / "run", 1, without=("end_to_end", "end_to_end_rotors"))
    sentence = refused(call, 3, run)
    assert f"{run} has no end_to_end.parquet" in sentence
    assert "rotortrack end-to-end" in sentence


def test_one_rotor_is_too_few(call, tmp_path):
    run = write_run(tmp_path / "run", 1, n=1)
    assert "run has 1 kept rotor with an end-to-end distance" in refused(call, 3, run)


def test_a_scan_in_which_nothing_turns_is_refused(call, given, tmp_path):
    still = [(charge, ratio, "docked_still", *rest) for charge, ratio, _, *rest in GRID]
    scan = write_scan(tmp_path / "still", still)
    sentence = refused(call, 3, given / "one", scan, "-o", tmp_path / "out")
    assert f"{scan} has no rod that rotates steadily" in sentence
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("changed", [{"state": "unfinished"}, {"options": {}}, {"options": 3}])
def test_a_scan_that_is_not_whole_is_refused(call, given, tmp_path, changed):
    scan = write_scan(tmp_path / "scan", **changed)
    assert str(scan) in refused(call, 3, given / "one", scan, "-o", tmp_path / "out")


def test_a_run_that_is_not_finished_is_refused(call, tmp_path):
    run = write_run(tmp_path / "run", 1)
    manifest = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps({**manifest, "state": "unfinished"}))
    assert "not finished" in refused(call, 3, run)
