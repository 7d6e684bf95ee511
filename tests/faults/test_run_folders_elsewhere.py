"""Run folders that are damaged, or were made by somebody who means harm."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas as pd
import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="faults are made in Linux's way")


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)


def empty(path: Path) -> None:
    path.write_bytes(b"")


def shorten(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-5])


def remove(path: Path) -> None:
    path.unlink()


def replace_by_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def endless(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def huge(path: Path) -> None:
    with path.open("r+b") as file:
        file.truncate(2**40)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "damage",
    [pipe, *(pytest.param(f, marks=SLOW) for f in (flip, empty, shorten, remove, endless, huge))],
)
def test_kept_work_that_was_damaged_is_made_again(
    bench: Any, runs: ModuleType, damage: Callable[[Path], None]
) -> None:
    """A run that was stopped before its tables, each of its files damaged in turn and at once."""
    folder = bench.killed(f"damaged-{damage.__name__}", "mkdir parts/commit")
    kept = sorted(path for path in folder.glob("parts/*/*"))
    names = [path.relative_to(folder) for path in kept]
    assert len(names) == 1 + 6 + 3 + 4
    stopped = shutil.copytree(folder, bench.root / f"stopped-{damage.__name__}")
    for chosen in (names[::5], names):
        shutil.rmtree(folder)
        shutil.copytree(stopped, folder)
        for name in chosen:
            damage(folder / name)
        bench.must_work(*bench.run(folder))
        assert runs.different(folder, bench.whole) == []
        runs.check_whole(folder)


def test_folder_in_place_of_a_kept_file_is_told(bench: Any) -> None:
    folder = bench.killed("blocked", "mkdir parts/commit")
    (part, *_) = sorted(folder.glob("parts/localise-*/*.parquet"))
    replace_by_folder(part)
    sentence = bench.must_fail(7, *bench.run(folder))
    assert str(part) in sentence


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        *(("run.json", pipe), ("log.jsonl", endless), ("lock", flip)),
        *(
            pytest.param(name, damage, marks=SLOW)
            for name in ("run.json", "log.jsonl", "lock")
            for damage in (flip, empty, shorten, pipe, endless, huge, replace_by_folder)
        ),
    ],
)
def test_damaged_files_beside_the_tables_end_in_order_or_a_sentence(
    bench: Any, name: str, damage: Callable[[Path], None]
) -> None:
    folder = bench.copy(bench.whole, f"beside-{name}-{damage.__name__}")
    path = folder / name
    if not path.exists():
        path.write_text(json.dumps({"host": "x", "pid": 1}))
    damage(path)
    for words in (("info", folder), ("motion", folder, "-q", "--no-figures"), bench.run(folder)):
        ended = bench.server(*words)
        assert ended.code in (0, 2, 3, 6, 7), (words, ended.err)
        assert "bug" not in ended.err
        if ended.code:
            assert str(folder) in ended.err.splitlines()[-1]
    if ended.code == 0:
        assert "complete run" in bench.must_work("info", folder)
    shutil.rmtree(folder)


class Outside:
    """A folder beside the run folder that nobody may touch."""

    def __init__(self, root: Path, whole: Path) -> None:
        self.path = root
        shutil.copytree(whole, root / "commit")
        shutil.copytree(whole, root, dirs_exist_ok=True)
        (root / "figures").mkdir()
        (root / "figures" / "field.png").write_text("mine")
        (root / "field.png").write_text("mine")
        (root / "victim.txt").write_text("mine")
        self.before = self.content()

    def content(self) -> dict[str, bytes | None]:
        return {
            str(path): path.read_bytes() if path.is_file() else None
            for path in sorted(self.path.rglob("*"))
        }


LINKS = {
    "parts": "",
    "parts/commit": "",
    "figures": "figures",
    "log.jsonl": "victim.txt",
    "run.json": "victim.txt",
    "rotors.parquet": "victim.txt",
    "config.resolved.toml": "victim.txt",
    "lock": "victim.txt",
}
STAGE_LINKS = ("check", "localise", "correct", "rotors")


@pytest.mark.parametrize(
    ("name", "state"),
    [
        *(("parts", "stopped"), ("parts/commit", "complete")),
        *(
            pytest.param(name, state, marks=SLOW)
            for name in (*LINKS, *STAGE_LINKS)
            for state in ("complete", "stopped")
        ),
    ],
)
def test_links_in_a_folder_from_elsewhere_lead_nowhere(
    bench: Any, name: str, state: str, tmp_path: Path
) -> None:
    outside = Outside(tmp_path / "outside", bench.whole)
    folder = bench.copy(bench.whole, f"linked-{name.replace('/', '-')}-{state}")
    if state == "stopped":
        manifest = json.loads((folder / "run.json").read_text())
        (folder / "run.json").write_text(
            json.dumps({**manifest, "state": "unfinished", "tables": []})
        )
    place = next(folder.glob(f"parts/{name}-*")) if name in STAGE_LINKS else folder / name
    if place.is_dir() and not place.is_symlink():
        shutil.rmtree(place)
    place.unlink(missing_ok=True)
    place.symlink_to(outside.path / LINKS.get(name, ""))
    option = ("--set", "quality.max_uncertainty_nm=25")
    figures = [word for word in bench.run(folder) if word != "--no-figures"]
    runs = (bench.run(folder), bench.run(folder, *option), figures)
    for words in (("motion", folder, "-q", "--no-figures"), *runs[: 3 if name == "figures" else 2]):
        ended = bench.server(*words)
        assert ended.code in (0, 2, 3, 7), ended.err
        assert "bug" not in ended.err
        assert outside.content() == outside.before
    shutil.rmtree(folder)


@pytest.mark.slow
def test_hostile_facts_of_kept_stages_end_in_order_or_a_sentence(bench: Any) -> None:
    folder = bench.killed("hostile", "mkdir parts/commit")
    stopped = shutil.copytree(folder, bench.root / "hostile-stopped")
    values: list[object] = [None, [], "x", 5, {}, {"sha256": 5}, {"sha256": ["x"] * 7}]
    values += [{"notes": 1}, {"notes": ["\x1b[2J"], "warnings": [["SystemExit", "x"]]}]
    for value in values:
        shutil.rmtree(folder)
        shutil.copytree(stopped, folder)
        for path in folder.glob("parts/*/done.json"):
            before = json.loads(path.read_text())
            mixed = {**before, **value} if isinstance(value, dict) else value
            path.write_text(json.dumps(mixed))
        ended = bench.server(*bench.run(folder))
        assert ended.code == 0, ended.err
        assert "\x1b" not in ended.err
        for name in ("localisations", "rotors", "tracks"):
            ours, expected = (
                pd.read_parquet(run / f"{name}.parquet") for run in (folder, bench.whole)
            )
            assert ours.equals(expected), (value, name)
