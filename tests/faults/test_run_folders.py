"""Run folders that are shared, moved, read-only, damaged, or made by somebody else."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas as pd
import pytest
import tifffile

from rotortrack_cli.main import main

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="faults are made in Linux's way")


SLOW = pytest.mark.slow

WAITING = """
import sys
from rotortrack.pipeline import stages
from rotortrack_cli.main import main
correct = stages.correct
def wait(*arguments, **options):
    print("at work", flush=True)
    input()
    return correct(*arguments, **options)
stages.correct = wait
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start a program and wait for its first line."""
    running: list[subprocess.Popen[str]] = []

    def go(code: str, *words: object) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", code, *map(str, words)]
        pipe = subprocess.PIPE
        running.append(subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True))
        assert running[-1].stdout is not None
        assert running[-1].stdout.readline() == "at work\n"
        return running[-1]

    yield go
    for process in running:
        process.kill()
        process.communicate()


def test_second_run_on_a_folder_is_refused_and_harms_nothing(
    bench: Any, runs: ModuleType, start: Callable[..., subprocess.Popen[str]]
) -> None:
    folder = bench.root / "shared"
    first = start(WAITING, *bench.run(folder))
    before = sorted(folder.rglob("*"))
    for words in (bench.run(folder), ("motion", folder, "--quiet")):
        sentence = bench.must_fail(6, *words)
        assert f"{folder} is being written by process {first.pid}" in sentence
        assert "(run since" in sentence
    out = bench.must_work("info", folder)
    assert f"at work now: process {first.pid}" in out
    assert "is at the stage correct" in out
    assert sorted(folder.rglob("*")) == before
    _, err = first.communicate("\n", timeout=60)
    assert first.returncode == 0, err
    assert runs.different(folder, bench.whole) == []


@SLOW
def test_reader_sees_whole_results_while_a_rerun_is_at_work(
    bench: Any, runs: ModuleType, start: Callable[..., subprocess.Popen[str]]
) -> None:
    folder = bench.copy(bench.whole, "read")
    option = ("--set", "quality.max_uncertainty_nm=25")
    first = start(WAITING, *bench.run(folder, *option))
    assert runs.different(folder, bench.whole) == []
    out = bench.must_work("info", folder)
    assert f"{folder}: complete run" in out
    assert "is at the stage correct" in out
    first.communicate("\n", timeout=60)
    assert first.returncode == 0
    assert runs.different(folder, bench.whole) != []


@pytest.mark.usefixtures("modes_obeyed")
def test_folder_that_may_not_be_written(
    bench: Any, runs: ModuleType, capfd: pytest.CaptureFixture[str]
) -> None:
    def call(*words: object) -> tuple[int, str]:
        code = main([str(word) for word in words])
        return code, "".join(capfd.readouterr())

    folder = bench.copy(bench.whole, "read-only")
    shut = bench.root / "shut"
    shut.mkdir()
    for path in (folder, shut):
        path.chmod(0o500)
    try:
        code, said = call("info", folder)
        assert code == 0
        assert "complete run" in said
        for words in (bench.run(folder), ("motion", folder, "-q"), bench.run(shut / "new")):
            code, said = call(*words)
            assert code == 7, said
            assert str(folder if words[-1] != shut / "new" else shut) in said or str(shut) in said
        assert runs.different(folder, bench.whole) == []
        (folder / "tracks.parquet").chmod(0o000)
        code, said = call("run", "--reproduce", folder, "--workers", "1", "-q")
        assert code == 3
        assert "tracks.parquet" in said
    finally:
        for path in (folder, shut):
            path.chmod(0o700)


def test_folder_that_was_moved_with_its_movie(bench: Any) -> None:
    here = bench.root / "here"
    here.mkdir()
    shutil.copy2(bench.movie, here / "film.tif")
    words = bench.run(here / "run", movie=here / "film.tif")
    bench.must_work(*words)
    there = bench.root / "there"
    here.rename(there)
    assert "complete run" in bench.must_work("info", there / "run")
    assert "identical" in bench.must_work("run", "--reproduce", there / "run", "-q")
    changes = bench.changes_in(there / "run", *bench.run(there / "run", movie=there / "film.tif"))
    assert not made(changes, "localise")


def test_folder_that_was_moved_without_its_movie(bench: Any, tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "copy"
    shutil.copytree(bench.whole, folder)
    assert "complete run" in bench.must_work("info", folder)
    bench.must_work("motion", folder, "--no-figures", "-q")
    sentence = bench.must_fail(3, "run", "--reproduce", folder, "-q")
    assert "movie.tif" in sentence
    assert "`rotortrack run MOVIE --reproduce RUN`" in sentence
    out = bench.must_work("run", bench.movie, "--reproduce", folder, "-q")
    assert "differs" not in out
    changes = bench.changes_in(folder, *bench.run(folder))
    assert not made(changes, "localise")


def made(changes: Sequence[str], stage: str) -> bool:
    """Whether a stage was made anew."""
    return any(change.startswith(f"rename parts/{stage}-") for change in changes)


@pytest.mark.parametrize(
    ("option", "first"),
    [
        ("motion.gap_mode=bridge", "motion"),
        pytest.param("circle.method=taubin", "rotors", marks=SLOW),
        ("quality.max_uncertainty_nm=25", "correct"),
        pytest.param("localise.method=lsq", "localise", marks=SLOW),
        pytest.param("movie.frames=[0, 200]", "check", marks=SLOW),
    ],
)
def test_changed_option_reruns_its_stage_and_later_ones(
    bench: Any, runs: ModuleType, option: str, first: str
) -> None:
    order = ("check", "localise", "correct", "rotors", "motion")
    folder, fresh = bench.copy(bench.whole, f"changed-{first}"), bench.root / f"fresh-{first}"
    words = bench.run(folder, "--set", option)
    changes = bench.changes_in(folder, *words)
    for stage in order[:-1]:
        assert made(changes, stage) == (order.index(stage) >= order.index(first)), stage
    bench.must_work(*bench.run(fresh, "--set", option))
    assert runs.different(folder, fresh) == []
    assert sorted(p.name for p in (folder / "parts").iterdir()) == sorted(
        p.name for p in (fresh / "parts").iterdir()
    )


def test_number_of_workers_changes_nothing(bench: Any, runs: ModuleType) -> None:
    folder = bench.root / "two"
    bench.must_work(*(*bench.run(folder), "--workers", "2"))
    assert runs.different(folder, bench.whole) == []


def test_other_movie_needs_leave_to_replace_results(bench: Any, runs: ModuleType) -> None:
    other = runs.make_movie(bench.root / "other.tif", 200)
    folder = bench.copy(bench.whole, "replaced")
    sentence = bench.must_fail(2, *bench.run(folder, movie=other))
    assert "movie.tif" in sentence
    assert "other.tif" in sentence
    assert "--overwrite" in sentence
    assert runs.different(folder, bench.whole) == []
    fresh = bench.root / "of-other"
    bench.must_work(*bench.run(fresh, movie=other))
    bench.must_work(*bench.run(folder, "--overwrite", movie=other))
    assert runs.different(folder, fresh) == []
    assert len(list((folder / "parts").iterdir())) == 4


def test_movie_that_changed_between_stop_and_resume(
    bench: Any, runs: ModuleType, tmp_path: Path
) -> None:
    movie = tmp_path / "movie.tif"
    shutil.copy2(bench.movie, movie)
    folder = tmp_path / "run"
    words = bench.run(folder, movie=movie)
    fault = runs.Fault("signal", 40, str(folder))
    assert bench.server(*words, fault=fault).code == -9
    assert list(folder.glob("parts/localise-*/*.parquet"))
    with tifffile.TiffFile(movie) as file:
        offset = file.pages[130].dataoffsets[0]
    with movie.open("rb+") as stream:
        stream.seek(offset)
        stream.write(bytes(4000))
    bench.must_work(*words)
    fresh = tmp_path / "fresh"
    bench.must_work(*bench.run(fresh, movie=movie))
    assert runs.different(folder, fresh) == []
    assert runs.different(folder, bench.whole) != []


CHANGING = """
import os, sys
from rotortrack.pipeline import localise_parts
from rotortrack_cli.main import main
how, movie = sys.argv[1:3]
write = localise_parts.write_frame_part
def change(*arguments):
    write(*arguments)
    size = os.path.getsize(movie)
    with open(movie, "rb+") as file:
        if how == "grown":
            file.seek(size)
            file.write(b"more")
        elif how == "cut":
            file.truncate(size // 3)
        elif how == "rewritten":
            file.seek(size // 2)
            file.write(bytes(2**16))
    if how == "gone":
        os.unlink(movie)
localise_parts.write_frame_part = change
localise_parts.PART_PIXELS = int(sys.argv[3])
print("at work", flush=True)
sys.exit(main(sys.argv[4:]))
"""


@pytest.mark.parametrize(
    "how",
    ["rewritten", *(pytest.param(how, marks=SLOW) for how in ("cut", "grown", "gone"))],
)
def test_movie_that_changes_while_it_is_read(
    bench: Any,
    runs: ModuleType,
    how: str,
    tmp_path: Path,
    start: Callable[..., subprocess.Popen[str]],
) -> None:
    movie = tmp_path / "movie.tif"
    shutil.copy2(bench.movie, movie)
    folder = tmp_path / "run"
    words = bench.run(folder, movie=movie)
    running = start(CHANGING, how, movie, runs.PART_PIXELS, *words)
    _, err = running.communicate(timeout=60)
    assert running.returncode == 3, err
    assert "movie.tif" in err.splitlines()[-1]
    assert not (folder / "tracks.parquet").exists()
    shutil.copy2(bench.movie, movie)
    bench.must_work(*words)
    assert pd.read_parquet(folder / "tracks.parquet").equals(
        pd.read_parquet(bench.whole / "tracks.parquet")
    )


def test_finished_run_is_repeated_and_a_changed_one_told(bench: Any, runs: ModuleType) -> None:
    folder = bench.copy(bench.whole, "repeated")
    out = bench.must_work("run", "--reproduce", folder, "-q")
    assert out.count("identical") >= 5
    assert "differs" not in out
    found = json.loads(bench.must_work("run", "--reproduce", folder, "-q", "--json"))
    assert found["identical"] is True
    for name in ("tracks", "localisations"):
        path = folder / f"{name}.parquet"
        table = pd.read_parquet(path)
        data = path.read_bytes()
        table.loc[3, table.columns[2]] *= 1.01
        table.to_parquet(path)
        sentence = bench.must_fail(3, "run", "--reproduce", folder, "-q")
        assert f"{folder} was not reproduced ({name}: " in sentence
        assert str(table.columns[2]) in sentence
        path.write_bytes(data)
    assert runs.different(folder, bench.whole) == []


def test_run_is_not_repeated_from_another_movie(bench: Any, tmp_path: Path) -> None:
    shutil.copytree(bench.whole, tmp_path / "run")
    data = bytearray(bench.movie.read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path.parent / "movie.tif").write_bytes(data)
    try:
        sentence = bench.must_fail(
            3, "run", tmp_path.parent / "movie.tif", "--reproduce", tmp_path / "run", "-q"
        )
        assert "SHA-256 differs" in sentence
    finally:
        (tmp_path.parent / "movie.tif").unlink()
    unfinished = bench.killed("unfinished", "mkdir parts/commit")
    assert "not finished" in bench.must_fail(3, "run", "--reproduce", unfinished, "-q")
