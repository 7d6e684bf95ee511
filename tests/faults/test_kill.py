"""A run that is killed or stopped at any moment tears no file and ends as if nothing had been.

A moment is a change that the command is about to make on the disk, so that every state in which a
killed process can leave a folder is met, and not only those that chance finds. The usual suite
takes some of the moments, `-m slow` all of them.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="moments are counted on Linux")

STAGES = ("check", "localise", "correct", "rotors", "motion", "tables", "figures")


ALL_OR_SOME = [
    pytest.param(False, id="some"),
    pytest.param(True, id="all", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("every", ALL_OR_SOME)
def test_run_killed_before_any_change_of_the_disk(
    bench: Any, runs: ModuleType, every: bool
) -> None:
    changes = bench.changes(bench.run)
    assert len(changes) > 100
    for moment in runs.some(range(len(changes)), 1 if every else 24, 1):
        folder = bench.root / f"run-{moment}-{every}"
        assert bench.stopped(bench.run, folder, moment, signal.SIGKILL).code == -signal.SIGKILL
        runs.check_whole(folder) if folder.exists() else None
        bench.must_end_like(bench.whole, bench.run, folder)
        shutil.rmtree(folder)


@pytest.mark.parametrize("every", ALL_OR_SOME)
def test_rerun_with_a_changed_option_killed_before_any_change(
    bench: Any, runs: ModuleType, every: bool
) -> None:
    """The old results stay whole until the new ones take their place."""
    changes = bench.changes(bench.run_changed, bench.whole)
    for moment in runs.some(range(len(changes)), 1 if every else 40, 2):
        folder = bench.copy(bench.whole, f"rerun-{moment}-{every}")
        ended = bench.stopped(bench.run_changed, folder, moment, signal.SIGKILL)
        assert ended.code == -signal.SIGKILL
        runs.check_whole(folder)
        must_hold_one_run(runs, bench, folder, bench.whole, bench.changed)
        bench.must_end_like(bench.changed, bench.run_changed, folder)
        shutil.rmtree(folder)


def must_hold_one_run(runs: ModuleType, bench: Any, folder: Path, old: Path, new: Path) -> None:
    """Expect that a manifest never calls other tables than its own complete."""
    info = bench.server("info", folder)
    assert info.code == 0, info.err
    manifest = json.loads((folder / "run.json").read_text())
    if manifest["state"] == "complete":
        assert f"{folder}: complete run" in info.out
        of = [run for run in (old, new) if not runs.different(folder, run)]
        assert len(of) == 1
        assert manifest["options"] == json.loads((of[0] / "run.json").read_text())["options"]
    else:
        assert f"{folder}: unfinished run" in info.out
        assert "was killed in the stage tables: give the same command again" in info.out
        assert (folder / "parts" / "commit" / "run.json").exists()


@pytest.mark.parametrize("every", ALL_OR_SOME)
def test_motion_killed_before_any_change(bench: Any, runs: ModuleType, every: bool) -> None:
    changes = bench.changes(bench.run_motion, bench.rotors)
    moments = range(len(changes)) if every else around_the_commit(changes)
    for moment in moments:
        folder = bench.copy(bench.rotors, f"motion-{moment}-{every}")
        ended = bench.stopped(bench.run_motion, folder, moment, signal.SIGKILL)
        assert ended.code == -signal.SIGKILL
        runs.check_whole(folder)
        must_hold_one_run(runs, bench, folder, bench.rotors, bench.moved)
        bench.must_end_like(bench.moved, bench.run_motion, folder)
        shutil.rmtree(folder)


def around_the_commit(changes: Sequence[str]) -> list[int]:
    """Choose the moments at which results change hands."""
    prepared = changes.index("rename parts/commit/run.json")
    return [prepared, prepared + 3, prepared + 8]


@pytest.mark.parametrize("every", ALL_OR_SOME)
def test_rotors_killed_before_any_change(bench: Any, runs: ModuleType, every: bool) -> None:
    changes = bench.changes(bench.run_rotors)
    for moment in runs.some(range(len(changes)), 1 if every else 40, 3):
        folder = bench.root / f"rotors-{moment}-{every}"
        ended = bench.stopped(bench.run_rotors, folder, moment, signal.SIGKILL)
        assert ended.code == -signal.SIGKILL
        runs.check_whole(folder) if folder.exists() else None
        bench.must_end_like(bench.rotors, bench.run_rotors, folder)
        shutil.rmtree(folder)


def test_one_run_killed_again_and_again_still_ends(bench: Any, runs: ModuleType) -> None:
    folder = bench.root / "often"
    chance = random.Random(4)
    kills = 0
    while True:
        ended = bench.stopped(bench.run, folder, chance.randrange(8, 120), signal.SIGKILL)
        runs.check_whole(folder)
        if ended.code == 0:
            break
        kills += 1
        assert kills < 40
    assert kills >= 3
    bench.must_end_like(bench.whole, bench.run, folder)


def test_a_killed_run_is_told_and_its_lock_taken_over(bench: Any, runs: ModuleType) -> None:
    changes = bench.changes(bench.run)
    folder = bench.root / "told"
    first = next(i for i, change in enumerate(changes) if "00000192-00000255" in change)
    bench.stopped(bench.run, folder, first, signal.SIGKILL)
    assert (folder / "lock").exists()
    info = bench.server("info", folder)
    assert info.code == 0
    assert "unfinished run" in info.out
    assert "was killed in the stage localise: give the same command again" in info.out
    assert f"192 of {runs.FRAMES} frames" in info.out
    assert "at work now" not in info.out
    bench.must_end_like(bench.whole, bench.run, folder)
    assert "finished" in bench.server("info", folder).out


FUNCTIONS = {
    "localise": "rotortrack.pipeline.localise_parts:write_frame_part",
    "correct": "rotortrack.pipeline.stages:correct",
    "rotors": "rotortrack.pipeline.stages:find",
    "motion": "rotortrack.pipeline.stages:move",
    "tables": "rotortrack.pipeline.store:write",
}
"""What each stage calls in its midst."""

SIGNALS = {signal.SIGINT: (130, "stopped"), signal.SIGTERM: (143, "stopped by the system")}


@pytest.mark.parametrize(
    ("stage", "number"),
    [
        *(("localise", signal.SIGINT), ("rotors", signal.SIGTERM), ("tables", signal.SIGTERM)),
        *(
            pytest.param(stage, number, marks=pytest.mark.slow)
            for stage in FUNCTIONS
            for number in SIGNALS
        ),
    ],
)
def test_run_stopped_within_a_stage(
    bench: Any, runs: ModuleType, stage: str, number: signal.Signals
) -> None:
    code, sentence = SIGNALS[number]
    folder = bench.root / f"stopped-{stage}-{number}"
    fault = runs.Fault("signal", signal=number, function=FUNCTIONS[stage])
    ended = bench.server(*bench.run(folder), fault=fault)
    assert ended.code == code
    assert ended.err.splitlines()[-1] == f"rotortrack: {sentence}"
    assert "Traceback" not in ended.err
    manifest = json.loads((folder / "run.json").read_text())
    assert manifest["state"] == "unfinished"
    told = manifest["unfinished"]
    assert (told["command"], told["stage"], told["reason"]) == ("run", stage, "stopped")
    info = bench.server("info", folder).out
    assert f"ended early (stopped) in the stage {stage}: give the same command again" in info
    assert f"64 of {runs.FRAMES} frames" in info or stage != "localise"
    bench.must_end_like(bench.whole, bench.run, folder)


@pytest.mark.parametrize("every", ALL_OR_SOME)
def test_run_stopped_before_any_change(bench: Any, runs: ModuleType, every: bool) -> None:
    changes = bench.changes(bench.run)
    for moment in runs.some(range(len(changes)), 1 if every else 50, 5):
        number = list(SIGNALS)[moment % 2]
        code, sentence = SIGNALS[number]
        folder = bench.root / f"stop-{moment}-{every}"
        ended = bench.stopped(bench.run, folder, moment, number)
        assert (ended.code, ended.err.splitlines()[-1:]) == (code, [f"rotortrack: {sentence}"])
        if folder.exists():
            runs.check_whole(folder)
        bench.must_end_like(bench.whole, bench.run, folder)
        shutil.rmtree(folder)


@pytest.mark.slow
def test_run_killed_or_stopped_among_its_figures(bench: Any, runs: ModuleType) -> None:
    changes = bench.changes(bench.run_drawing, bench.whole)
    drawn = bench.copy(bench.root / "counted", "drawn")
    pictures = [i for i, change in enumerate(changes) if change.startswith("rename figures/")]
    assert len(pictures) == 9
    codes = {signal.SIGKILL: -signal.SIGKILL, signal.SIGINT: 130, signal.SIGTERM: 143}
    cases = [(number, moment) for number in codes for moment in pictures]
    for number, moment in cases:
        folder = bench.copy(bench.whole, f"drawn-{number}-{moment}")
        assert bench.stopped(bench.run_drawing, folder, moment, number).code == codes[number]
        runs.check_whole(folder)
        info = bench.server("info", folder).out
        assert "complete run" in info
        assert "in the stage figures: give the same command again" in info
        bench.must_end_like(drawn, bench.run_drawing, folder)
        shutil.rmtree(folder)


PROGRAM = """
import sys
from rotortrack.pipeline import localise_parts
from rotortrack_cli.main import main
localise_parts.PART_PIXELS = int(sys.argv[1])
sys.exit(main(sys.argv[2:]))
"""


@pytest.fixture
def start(runs: ModuleType) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Start a command in a process that is all its own."""
    running: list[subprocess.Popen[bytes]] = []

    def go(*words: object) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-c", PROGRAM, str(runs.PART_PIXELS), *map(str, words)]
        running.append(
            subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        )
        return running[-1]

    yield go
    for process in running:
        process.kill()
        process.wait()


def wait_for_stage(folder: Path, stage: str, process: subprocess.Popen[bytes]) -> None:
    """Wait until a run says that it has begun a stage."""
    deadline = time.monotonic() + 300
    while stage not in begun(folder):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.002)


def begun(folder: Path) -> list[str]:
    try:
        lines = (folder / "log.jsonl").read_text().splitlines()
    except FileNotFoundError:
        return []
    return [event["stage"] for event in map(json.loads, lines) if event["event"] == "begun"]


@pytest.mark.slow
def test_thirty_kills_at_random_moments(
    tmp_path: Path, runs: ModuleType, start: Callable[..., subprocess.Popen[bytes]]
) -> None:
    """Whole processes with all their threads, killed from outside by the clock."""
    movie = runs.make_movie(tmp_path / "movie.tif", 800, (64, 96))
    whole = tmp_path / "whole"
    for folder in (tmp_path / "warm", whole):
        assert start(*runs.run_words(movie, folder)).wait(timeout=600) == 0
    seconds = json.loads((whole / "run.json").read_text())["seconds"]
    chance = random.Random(30)
    killed: dict[str, int] = {}
    for number in range(30):
        stage = STAGES[number % len(STAGES)]
        folder = tmp_path / f"run-{number}"
        words = runs.run_words(movie, folder)
        delay_s = chance.random() * seconds[stage]
        while True:
            process = start(*words)
            wait_for_stage(folder, stage, process)
            time.sleep(delay_s)
            process.kill()
            if process.wait() == -signal.SIGKILL:
                break
            # It was quicker this time.
            shutil.rmtree(folder)
            delay_s /= 2
        last = begun(folder)[-1]
        killed[last] = killed.get(last, 0) + 1
        runs.check_whole(folder)
        assert start(*words).wait(timeout=600) == 0
        assert runs.different(folder, whole) == []
        assert runs.leftovers(folder) == []
        shutil.rmtree(folder)
    assert killed.keys() == set(STAGES), killed


@pytest.mark.slow
@pytest.mark.parametrize("number", SIGNALS)
def test_signals_from_outside_in_every_stage(
    number: signal.Signals,
    tmp_path: Path,
    runs: ModuleType,
    start: Callable[..., subprocess.Popen[bytes]],
) -> None:
    movie = runs.make_movie(tmp_path / "movie.tif", 800, (64, 96))
    whole = tmp_path / "whole"
    assert start(*runs.run_words(movie, whole)).wait(timeout=600) == 0
    for stage in STAGES:
        folder = tmp_path / stage
        words = runs.run_words(movie, folder)
        process = start(*words)
        wait_for_stage(folder, stage, process)
        os.kill(process.pid, number)
        assert process.wait(timeout=60) == SIGNALS[number][0]
        if folder.exists():
            runs.check_whole(folder)
            manifest = json.loads((folder / "run.json").read_text())
            assert manifest["unfinished"]["reason"] == "stopped"
        assert start(*words).wait(timeout=600) == 0
        assert runs.different(folder, whole) == []
        assert runs.leftovers(folder) == []
