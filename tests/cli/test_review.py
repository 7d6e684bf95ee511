"""`rotortrack review`, and how `rotors`, `motion` and `run --reproduce` heed its verdicts."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rotortrack.exchange.tables import write_localisations
from rotortrack.exchange.writer import TableInfo
from rotortrack.motion.verdicts import replay
from rotortrack_cli import main as entry

FRAMES = 600
OPTIONS = ("--frame-interval-s", "0.002")


def spots(radius_of_each, first=0):
    """Rotors 1.5 um apart, numbered as they are given; radius 0 is a stuck spot."""
    rng = np.random.default_rng(1)
    parts = []
    for number, radius in enumerate(radius_of_each):
        theta = np.cumsum(rng.normal(0.03, 0.2, FRAMES))
        x = 1500.0 * (number + first) + radius * np.cos(theta) + 10.0 * rng.normal(size=FRAMES)
        # The topmost has the lowest number.
        y = 1500.0 * (number + first) + radius * np.sin(theta) + 10.0 * rng.normal(size=FRAMES)
        part = {"frame": np.arange(FRAMES), "x_nm": x, "y_nm": y, "photons": 1000.0}
        parts.append(pd.DataFrame({**part, "uncertainty_nm": 10.0}))
    return pd.concat(parts, ignore_index=True)


def write(path, table):
    info = TableInfo(frames=FRAMES, pixel_size_nm=100.0, frame_interval_s=0.002, provenance={})
    write_localisations(path, table, info)
    return path


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    folder = tmp_path_factory.mktemp("review")
    locs = write(folder / "locs.parquet", spots([100.0, 120.0, 0.0]))
    words = ("rotors", locs, *OPTIONS, "-o", folder / "run", "-q")
    assert entry.main([str(word) for word in words]) == 0
    return folder


@pytest.fixture
def work(base, tmp_path):
    """A folder with the table `locs.parquet` and the run `run`."""
    return Path(shutil.copytree(base, tmp_path / "work"))


def verdicts(run):
    table = pd.read_parquet(run / "rotors.parquet").set_index("rotor")
    return (table["verdict"] + ":" + table["reason"]).to_dict()


AUTOMATIC = {0: "kept:", 1: "kept:", 2: "refused:immobile"}


def test_rotors_are_listed_with_verdicts_and_reasons(call, work):
    outcome = call("review", work / "run")
    assert outcome.code == 0
    lines = [line.split() for line in outcome.out.splitlines()]
    assert lines[0][:3] == ["rotor", "x", "um"]
    assert [line[4:] for line in lines[1:]] == [["kept"], ["kept"], ["refused", "immobile"]]
    told = call("review", work / "run", "--json").json
    assert [row["verdict"] for row in told["rotors"]] == ["kept", "kept", "refused"]
    assert told["pending"] == []
    assert not (work / "run" / "curation.toml").exists()


def test_a_verdict_is_written_down_listed_and_heeded_by_motion(call, work):
    run = work / "run"
    outcome = call(
        *("review", run, "--rotor", 1, "--verdict", "refused"),
        *("--reason", 'it "wobbles"', "--by", "Ada"),
    )
    assert outcome.code == 0
    assert "rotor 1: refused by hand" in outcome.out
    assert "`rotortrack motion" in outcome.out
    assert verdicts(run) == AUTOMATIC
    assert call("review", run, "--json").json["pending"] == [1]
    done = call("motion", run, "--exposure-s", 0.002, "--no-figures")
    assert done.code == 0
    assert "by hand         1 decided, 1 against the screening" in done.out
    assert "1 by_hand" in done.out
    assert verdicts(run) == {**AUTOMATIC, 1: "refused:by_hand"}
    table = pd.read_parquet(run / "rotors.parquet")
    assert list(table["omega_rad_s"].notna()) == [True, False, False]
    counts = json.loads((run / "run.json").read_text())["counts"]
    assert (counts["rotors_kept"], counts["human_verdicts"], counts["overruled"]) == (1, 1, 1)
    decisions = pd.read_parquet(run / "decisions.parquet")
    row = decisions[decisions["feature"] == "human_verdict"].iloc[0]
    assert (row["rotor"], row["verdict_before"], row["verdict_after"]) == (1, "kept", "refused")
    assert row["remark"].startswith('it "wobbles" (Ada, 20')
    told = ["rotor", "verdict", "reason"]
    pd.testing.assert_frame_equal(replay(decisions), table[told])
    listed = call("review", run)
    assert "not in the tables yet" not in listed.out
    assert 'it "wobbles" (Ada' in listed.out


def test_later_verdicts_count_and_removed_ones_are_undone(call, work):
    run = work / "run"
    assert call("review", run, "--rotor", 0, "--rotor", 1, "--verdict", "refused").code == 0
    first = (run / "curation.toml").read_text()
    assert call("review", run, "--rotor", 1, "--verdict", "kept").code == 0
    assert (run / "curation.toml").read_text().startswith(first)
    motion = ("motion", run, "--exposure-s", 0.002, "--no-figures", "-q")
    assert call(*motion).code == 0
    assert verdicts(run) == {**AUTOMATIC, 0: "refused:by_hand"}
    counts = json.loads((run / "run.json").read_text())["counts"]
    assert (counts["human_verdicts"], counts["overruled"]) == (2, 1)
    (run / "curation.toml").unlink()
    shown = call(*motion)
    assert shown.code == 0
    assert "by hand" not in shown.out
    assert verdicts(run) == AUTOMATIC
    assert "human_verdict" not in set(pd.read_parquet(run / "decisions.parquet")["feature"])


def test_verdicts_follow_their_rotor_to_its_new_number(call, work):
    run = work / "run"
    assert call("review", run, "--rotor", 0, "--verdict", "refused").code == 0
    above = spots([90.0], first=-1)
    write(work / "locs.parquet", pd.concat([above, spots([100.0, 120.0, 0.0])]))
    again = call("rotors", work / "locs.parquet", *OPTIONS, "-o", run, "--overwrite")
    assert again.code == 0
    assert verdicts(run) == {0: "kept:", 1: "refused:by_hand", 2: "kept:", 3: "refused:immobile"}
    notes = " ".join(json.loads((run / "run.json").read_text())["notes"])
    assert "the human verdict on rotor 0" in notes
    assert "holds for rotor 1, which lies there now" in notes


def test_a_verdict_whose_rotor_is_gone_is_refused_and_changes_nothing(call, work):
    run = work / "run"
    assert call("review", run, "--rotor", 0, "--verdict", "refused").code == 0
    before = (run / "rotors.parquet").read_bytes(), (run / "curation.toml").read_bytes()
    write(work / "locs.parquet", spots([100.0], first=5))
    again = call("rotors", work / "locs.parquet", *OPTIONS, "-o", run, "--overwrite", "-q")
    assert again.code == 4
    assert again.err.count("\n") == 1
    assert "curation.toml: rotor 0 at" in again.err
    assert ((run / "rotors.parquet").read_bytes(), (run / "curation.toml").read_bytes()) == before


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (("--rotor", 1), 2, "a verdict needs both --rotor and --verdict"),
        (("--verdict", "kept"), 2, "a verdict needs both --rotor and --verdict"),
        (("--reason", "why"), 2, "a verdict needs both --rotor and --verdict"),
        (("--rotor", 1, "--verdict", "perhaps"), 2, "'perhaps' is not one of"),
        (("--rotor", 9, "--verdict", "kept"), 3, "has no rotor 9: its rotors are 0 to 2"),
        (("--rotor", 2, "--verdict", "kept"), 2, "rotor 2 has no circle (immobile)"),
    ],
)
def test_impossible_verdicts_are_refused_in_a_sentence(call, work, words, code, sentence):
    outcome = call("review", work / "run", *words)
    assert outcome.code == code
    assert sentence in outcome.err
    assert not (work / "run" / "curation.toml").exists()


def test_a_damaged_file_is_told_and_left_as_it_is(call, work):
    run = work / "run"
    (run / "curation.toml").write_text("[[rotor]]\nrotor = 1\n")
    for words in (
        ("review", run),
        ("review", run, "--rotor", 1, "--verdict", "kept"),
        ("motion", run, "--no-figures", "-q", "--exposure-s", 0.002),
        ("rotors", work / "locs.parquet", *OPTIONS, "-o", run, "-q"),
    ):
        outcome = call(*words)
        assert outcome.code == 4
        assert "[[rotor]] 1: x_nm, y_nm, verdict is missing: give it" in outcome.err
    assert (run / "curation.toml").read_text() == "[[rotor]]\nrotor = 1\n"


def test_what_is_no_run_cannot_be_reviewed(call, work):
    for path in (work, work / "locs.parquet", work / "nowhere"):
        outcome = call("review", path, "--rotor", 1, "--verdict", "kept")
        assert outcome.code == 3
        assert "not a run folder" in outcome.err
    assert not (work / "nowhere").exists()


def test_a_repetition_takes_the_verdicts_along(call, work):
    run = work / "run"
    assert call("review", run, "--rotor", 1, "--verdict", "refused").code == 0
    assert call("rotors", work / "locs.parquet", *OPTIONS, "-o", run, "-q").code == 0
    assert verdicts(run)[1] == "refused:by_hand"
    again = call("run", "--reproduce", run, "-o", work / "again", "-q")
    assert again.code == 0
    assert "decisions: " in again.out
    assert "differs" not in again.out
    assert verdicts(work / "again") == verdicts(run)


def test_places_are_those_of_the_rotors_table(call, work):
    run = work / "run"
    call("review", run, "--rotor", 1, "--verdict", "refused")
    text = (run / "curation.toml").read_text()
    row = pd.read_parquet(run / "rotors.parquet").set_index("rotor").loc[1]
    told = dict(line.split(" = ") for line in text.splitlines()[1:] if line)
    assert math.isclose(float(told["x_nm"]), row["x_nm"], abs_tol=0.001)
    assert math.isclose(float(told["y_nm"]), row["y_nm"], abs_tol=0.001)
