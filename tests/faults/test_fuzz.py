"""Whatever happens to a file, it is read as it was or refused in one sentence, soon and in memory.

`python tests/faults/fuzzer.py TASK KIND NUMBER` repeats a case that a failure names.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

if not sys.platform.startswith("linux"):
    pytest.skip("limits and memory are measured as Linux has them", allow_module_level=True)

_spec = importlib.util.spec_from_file_location("fuzzer", Path(__file__).with_name("fuzzer.py"))
fuzzer = importlib.util.module_from_spec(_spec)
sys.modules["fuzzer"] = fuzzer
_spec.loader.exec_module(fuzzer)
readers, corpus, damage = fuzzer.readers, fuzzer.corpus, fuzzer.damage

QUICK = [
    *[("info", kind) for kind in ("plain", "ome", "micro-manager")],
    *[("convert", kind) for kind in ("csv", "parquet", "picasso latest")],
]
COMMANDS = [
    *QUICK,
    *[("info", kind) for kind in ("imagej", "zlib", "bigtiff", "uint8", "run folder")],
    *[("info --json", kind) for kind in ("ome set", "series", "run folder")],
    *[("info", kind) for kind in ("csv", "csv.gz", "picasso", "parquet")],
    *[("info --json", kind) for kind in ("csv dialect", "picasso latest", "camera maps")],
    *[("localise", kind) for kind in ("pages", "int16", "zlib tiles", "camera maps", "protocol")],
    *[("run", kind) for kind in ("imagej float", "big-endian", "camera maps", "config")],
    *[("convert", kind) for kind in ("csv.gz", "csv dialect", "picasso")],
    *[("rotors", kind) for kind in ("csv", "parquet")],
    ("motion", "run folder"),
]


def judged(pairs: Iterable[tuple[str, str]], numbers: Iterable[int]) -> list[fuzzer.Outcome]:
    """Run the cases, fail with every fault, and check that the corpus is worth its name."""
    cases = [(task, kind, number) for task, kind in pairs for number in numbers]
    whole, outcomes = fuzzer.run_cases(cases)
    assert [outcome for outcome in whole if outcome.end != "read"] == []
    assert [(o.task, o.kind, o.number) for o in outcomes] == cases
    faults = [
        f"{o.task} {o.kind!r} {o.number} ({o.way}): {o.end} after {o.seconds:.1f} s\n{o.text}"
        for o in outcomes
        if o.is_fault
    ]
    assert not faults, f"{len(faults)} of {len(cases)}\n" + "\n\n".join(faults)
    most = max(outcomes, key=lambda outcome: outcome.grown_bytes)
    assert most.grown_bytes < fuzzer.LIMIT_BYTES, most
    ends = Counter(outcome.end for outcome in outcomes)
    assert ends["refused"] > 0.2 * len(cases)
    assert ends["read"] > 0.1 * len(cases)
    return outcomes


def test_some_of_the_corpus_of_every_kind() -> None:
    judged([("library", kind) for kind in corpus.SEEDS], range(1, 6))


def test_some_of_the_corpus_through_the_commands() -> None:
    judged(QUICK, range(1, 5))


@pytest.mark.slow
def test_whole_corpus(capsys: pytest.CaptureFixture[str]) -> None:
    outcomes = judged([("library", kind) for kind in corpus.SEEDS], range(1, 121))
    assert len(outcomes) >= 2000
    with capsys.disabled():
        summarise(outcomes)


@pytest.mark.slow
def test_whole_corpus_through_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    outcomes = judged(COMMANDS, range(1, 6))
    assert len(outcomes) >= 60
    with capsys.disabled():
        summarise(outcomes)


def summarise(outcomes: list[fuzzer.Outcome]) -> None:
    print()
    for task, kind in dict.fromkeys((o.task, o.kind) for o in outcomes):
        ends = Counter(o.end for o in outcomes if (o.task, o.kind) == (task, kind))
        print(f"{task:12} {kind:20} {ends['read']:4} read {ends['refused']:4} refused")
    slowest = max(outcomes, key=lambda outcome: outcome.seconds)
    grown = max(outcome.grown_bytes for outcome in outcomes)
    print(f"{len(outcomes)} cases; slowest {slowest.task} {slowest.kind} {slowest.number}")
    print(f"{slowest.seconds:.2f} s; memory grew by {grown / 2**20:.0f} MB")


def test_a_case_is_the_same_each_time() -> None:
    for kind in corpus.SEEDS:
        assert fuzzer.damaged(kind, 7) == fuzzer.damaged(kind, 7)
        if kind != "run folder":
            assert corpus.SEEDS[kind]() == corpus.seed_of(kind)


def test_every_way_of_damage_occurs_and_changes_the_file() -> None:
    ways = Counter()
    same = 0
    for kind in corpus.SEEDS:
        for number in range(1, 60):
            way, files = fuzzer.damaged(kind, number)
            ways[way.split(" in ")[0].split(" of ")[0]] += 1
            same += files == corpus.seed_of(kind).files
    wanted = {way.__name__ for way in damage.BLIND}
    wanted |= {way.__name__ for aimed in damage.AIMED.values() for way in aimed}
    assert wanted | {"loss"} == set(ways)
    assert same < 0.1 * ways.total()


def judge_with(
    reader: object, folder: Path, monkeypatch: pytest.MonkeyPatch, number: int = 1
) -> fuzzer.Outcome:
    monkeypatch.setitem(readers.READERS, "movie", reader)
    return fuzzer.judge("library", "plain", number, folder)


def test_judge_notices_a_traceback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def reader(*_arguments: object) -> None:
        raise KeyError("hidden")

    outcome = judge_with(reader, tmp_path, monkeypatch)
    assert outcome.is_fault
    assert outcome.end == "traceback"
    assert "hidden" in outcome.text


def test_judge_notices_a_hang(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzzer, "LIMIT_S", 0.2)
    outcome = judge_with(lambda *_: time.sleep(60), tmp_path, monkeypatch)
    assert outcome.end == "too slow"
    assert outcome.seconds < 30


@pytest.mark.parametrize("text", ["movie.tif\x1b[31m", "no name", "movie.tif " + "x" * 3000])
def test_judge_notices_a_sentence_that_is_none(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rotortrack.errors import MovieError

    def reader(*_arguments: object) -> None:
        raise MovieError(text)

    assert judge_with(reader, tmp_path, monkeypatch).end == "wrong"


def test_judge_notices_other_pixels_and_other_numbers_of_frames(tmp_path: Path) -> None:
    seed = corpus.seed_of("plain")
    frames = seed.frames.copy()
    frames[3, 4, 5] += 1
    case = readers.Case(seed, seed.files, tmp_path, 0)
    for found, missing in ((frames, 0), (seed.frames[:-1], 0), (seed.frames, 1)):
        with pytest.raises(readers.WrongError):
            readers.compare_movie(case, found, len(found), missing)
    readers.compare_movie(case, seed.frames, len(seed.frames), 0)


def test_judge_wants_the_pixels_that_the_damaged_file_has(tmp_path: Path) -> None:
    seed = corpus.seed_of("strips")
    content = np.frombuffer(seed.files[seed.first], np.uint8).copy()
    content[np.flatnonzero(damage.pixel_bytes(content.tobytes()))[1234]] ^= 255
    case = readers.Case(seed, {seed.first: content.tobytes()}, tmp_path, 0)
    frames = readers.frames_of(content.tobytes())
    assert np.sum(frames != seed.frames) == 1
    readers.compare_movie(case, frames, len(frames), 0)
    with pytest.raises(readers.WrongError):
        readers.compare_movie(case, seed.frames, len(frames), 0)


def test_a_child_that_dies_is_a_fault_of_its_case(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    child = tmp_path / "child.py"
    child.write_text(
        "import json, os, sys\n"
        "for line in sys.stdin:\n"
        "    print(line.strip(), flush=True)\n"
        "    task, kind, number = json.loads(line)\n"
        "    if number == 2:\n"
        "        os.abort()\n"
        "    print(json.dumps(dict(task=task, kind=kind, number=number, end='read')), flush=True)\n"
    )
    monkeypatch.setattr(fuzzer, "__file__", str(child))
    _, outcomes = fuzzer.run_cases([("library", "plain", number) for number in (1, 2, 3)])
    assert [outcome.end for outcome in outcomes] == ["read", "lost", "read"]
    assert outcomes[1].is_fault
