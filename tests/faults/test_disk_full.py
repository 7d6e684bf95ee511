"""A full disk ends a command with a sentence, tears nothing, and spoils no older result.

`enospc` lets one change of the disk fail, `full` that one and all later ones; a limit on the size
of files fails writes midway, as a disk does that fills up within a file.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="changes are counted on Linux")

SLOW = pytest.mark.slow
ACTS = ("enospc", "full")

HARMLESS = re.compile(r"open log\.jsonl|write log\.jsonl|fsync (parts(/[^.]*)?|figures|/.*)")
"""What may fail without a word: the log, and flushing names, which not every system can."""


def growing(changes: Sequence[str]) -> list[int]:
    """Give the moments at which space is needed."""
    return [i for i, change in enumerate(changes) if not change.startswith("remove")]


def must_be_told(bench: Any, ended: Any, folder: Path) -> None:
    """Expect exit 7, and one sentence that names a place in the folder."""
    sentence = bench.sentence(ended, 7)
    assert str(folder) in sentence
    assert "free space" in sentence


def must_hold_old_run(bench: Any, runs: ModuleType, folder: Path) -> None:
    """Expect that the results of an earlier run are what they were."""
    assert runs.different(folder, bench.whole) == []
    old = json.loads((bench.whole / "run.json").read_text())
    manifest = json.loads((folder / "run.json").read_text())
    assert manifest["state"] == "complete"
    assert manifest["options"] == old["options"]


@pytest.mark.parametrize(
    ("act", "every"), [("full", False), *(pytest.param(act, True, marks=SLOW) for act in ACTS)]
)
def test_run_into_a_new_folder(bench: Any, runs: ModuleType, act: str, every: bool) -> None:
    folder = bench.root / "new"
    changes = bench.changes(bench.run)
    for moment in runs.some(growing(changes), 1 if every else 60, 6):
        shutil.rmtree(folder, ignore_errors=True)
        ended = bench.server(*bench.run(folder), fault=runs.Fault(act, moment, str(folder)))
        if ended.code == 0:
            still_to_come = changes[moment:] if act == "full" else [changes[moment]]
            assert all(HARMLESS.fullmatch(change) for change in growing_of(still_to_come))
            assert runs.different(folder, bench.whole) == []
            continue
        must_be_told(bench, ended, folder)
        if folder.exists():
            runs.check_whole(folder)
            told = bench.must_work("info", folder)
            done = moment > changes.index("rename parts/commit/run.json")
            assert "ended early (" in told or "was killed" in told or done
        bench.must_end_like(bench.whole, bench.run, folder)


def growing_of(changes: Sequence[str]) -> list[str]:
    return [changes[i] for i in growing(changes)]


@pytest.mark.parametrize(
    ("act", "every"), [("enospc", False), *(pytest.param(act, True, marks=SLOW) for act in ACTS)]
)
def test_rerun_over_older_results(bench: Any, runs: ModuleType, act: str, every: bool) -> None:
    changes = bench.changes(bench.run_changed, bench.whole)
    prepared = changes.index("rename parts/commit/run.json")
    for moment in runs.some(growing(changes), 1 if every else 50, 7):
        folder = bench.copy(bench.whole, "old")
        fault = runs.Fault(act, moment, str(folder))
        ended = bench.server(*bench.run_changed(folder), fault=fault)
        runs.check_whole(folder)
        if ended.code:
            must_be_told(bench, ended, folder)
            if moment <= prepared:
                must_hold_old_run(bench, runs, folder)
                assert runs.leftovers(folder) == []
        bench.must_end_like(bench.changed, bench.run_changed, folder)


def sizes(folder: Path) -> list[int]:
    """List the sizes of a run's files, each kind of file once."""
    found = {
        re.sub(r"\d+|-[0-9a-f]{16}", "", str(path.relative_to(folder))): path.stat().st_size
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
    return sorted(set(found.values()))


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=SLOW)])
@pytest.mark.parametrize("over", ["nothing", "older results"])
def test_files_that_cannot_grow(bench: Any, runs: ModuleType, over: str, every: bool) -> None:
    """Parts, checkpoints, tables, manifest, lock and log, each cut short by the limit."""
    new = over == "nothing"
    words = bench.run if new else bench.run_changed
    expected = bench.whole if new else bench.changed
    limits = [0, 40, *(size - 1 for size in sizes(bench.whole))]
    folder = bench.root / "limited"
    for limit in limits if every else limits[1 :: len(limits) // 2]:
        shutil.rmtree(folder, ignore_errors=True)
        if not new:
            bench.copy(bench.whole, folder.name)
        ended = bench.server(*words(folder), fault=runs.Fault(largest_bytes=limit))
        if folder.exists():
            runs.check_whole(folder)
        if ended.code == 0:
            # A log that is full stops nothing, and other options make smaller tables.
            assert limit < (folder / "log.jsonl").stat().st_size + 500 or not new
            assert runs.different(folder, expected) == []
        else:
            must_be_told(bench, ended, folder)
            if not new:
                must_hold_old_run(bench, runs, folder)
        bench.must_end_like(expected, words, folder)


@SLOW
def test_figures_that_cannot_be_written(bench: Any, runs: ModuleType) -> None:
    bench.copy(bench.whole, "drawn")
    drawn = bench.made("drawn", bench.run_drawing)
    table = max(path.stat().st_size for path in drawn.glob("*.parquet"))
    pictures = sorted(path.stat().st_size for path in drawn.glob("figures/*.png"))
    for limit in (table + 1, pictures[-1] - 1):
        assert limit < pictures[-1]
        folder = bench.copy(bench.whole, "figures")
        fault = runs.Fault(largest_bytes=limit)
        must_be_told(bench, bench.server(*bench.run_drawing(folder), fault=fault), folder)
        runs.check_whole(folder)
        assert runs.leftovers(folder) == []
        told = bench.must_work("info", folder)
        assert "run ended early (" in told
        assert "in the stage figures: give the same command again" in told
        bench.must_end_like(drawn, bench.run_drawing, folder)


LENGTH_AND_LIGHT = ("--pixel-size-nm", "108.3", "--offset-adu", "100", "--gain-e-per-adu", "1")
SINGLE = [
    ("convert", "hdf5"),
    ("drift", "csv"),
    *(
        pytest.param(command, ending, marks=SLOW)
        for command in ("localise", "convert", "drift", "filter")
        for ending in ("parquet", "csv", "csv.gz", "hdf5")
    ),
]


def single(bench: Any, command: str, target: Path) -> Sequence[object]:
    """Give the words of a command that writes one table."""
    table = bench.whole / "localisations.parquet"
    match command:
        case "localise":
            known = (*LENGTH_AND_LIGHT, "--read-noise-e", "1", "--workers", "1")
            return ("localise", bench.movie, *known, "-o", target, "--quiet")
        case "convert":
            return ("convert", table, target, "--quiet")
    return (command, table, "-o", target, "--quiet")


@pytest.mark.parametrize(("command", "ending"), SINGLE)
def test_single_tables(
    bench: Any, runs: ModuleType, command: str, ending: str, tmp_path: Path
) -> None:
    """With what lies beside them: the drift, and Picasso's description."""
    folder = tmp_path / "tables"
    folder.mkdir()
    target = folder / f"table.{ending}"
    words = single(bench, command, target)
    changes = bench.server(*words, fault=runs.Fault(within=str(folder))).changes
    whole = {path.name: path.read_bytes() for path in folder.iterdir()}
    limits = [0, *(len(data) - 1 for data in whole.values())]
    faults = [runs.Fault(largest_bytes=limit) for limit in limits]
    # The last name of several is changed when all is on the disk.
    final = [i for i, change in enumerate(changes) if change.startswith("rename")]
    needed = [i for i in growing(changes) if i <= final[0] and "fsync /" not in changes[i]]
    faults += [runs.Fault(act, i, str(folder)) for act in ("enospc", "full") for i in needed]
    older = dict.fromkeys(whole, b"older")
    for fault in faults:
        for before in ({}, older):
            for path in folder.iterdir():
                path.unlink()
            for name, data in before.items():
                (folder / name).write_bytes(data)
            must_be_told(bench, bench.server(*words, fault=fault), folder)
            assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    bench.must_work(*words)
    assert {path.name for path in folder.iterdir()} == set(whole)


@pytest.mark.parametrize("name", ["movie.tif", "spots.parquet", "rotors.csv", "daq.csv"])
@SLOW
def test_sample(bench: Any, runs: ModuleType, name: str, tmp_path: Path) -> None:
    folder = tmp_path / "sample"
    words = ("simulate", "sample", "-o", folder, "--quiet")
    bench.must_work(*words)
    files = {path.name: path for path in folder.rglob("*.*")}
    whole = {path: path.read_bytes() for path in files.values()}
    for path in whole:
        path.write_bytes(b"older")
    limit = len(whole[files[name]]) - 1
    must_be_told(bench, bench.server(*words, fault=runs.Fault(largest_bytes=limit)), folder)
    assert files[name].read_bytes() == b"older"
    for path in folder.rglob("*.*"):
        assert path.read_bytes() in (b"older", whole[path])
