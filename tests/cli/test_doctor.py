"""`rotortrack doctor` as a user calls it."""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rotortrack

SAMPLE = Path(__file__).parents[2] / "sample_data" / "rotors"
COMMAND = "import sys; from rotortrack_cli.main import main; sys.exit(main())"


def test_every_line_is_marked_and_fits_the_screen(call: Callable[..., Any]) -> None:
    shown = call("doctor")
    assert shown.code == 0
    lines = shown.out.splitlines()
    heads = [line for line in lines if not line.startswith(" ")]
    assert all(line.startswith(("ok ", "warning ")) for line in heads)
    assert max(map(len, lines)) <= 100 or max(map(len, shown.out.split())) > 70
    for topic in ("python", "libraries", "processors", "memory", "kernels"):
        assert any(line.split()[1] == topic for line in heads)


def test_json_holds_every_finding(call: Callable[..., Any]) -> None:
    shown = call("doctor", "--json", "-q").json
    assert shown["able"] is True
    assert shown["warm_up_s"] is None
    assert {"topic", "state", "level", "remedy"} == set(shown["findings"][0])


@pytest.mark.parametrize("flags", [(), ("--warm",), ("--json",)])
def test_a_broken_library_ends_with_exit_code_7(
    call: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, flags: tuple[str, ...]
) -> None:
    load = importlib.import_module

    def fail(name: str, package: str | None = None) -> Any:
        if name == "pyarrow":
            raise ImportError("libarrow.so is missing")
        return load(name, package)

    monkeypatch.setattr(importlib, "import_module", fail)
    shown = call("doctor", "-q", *flags)
    assert shown.code == 7
    assert "libarrow.so is missing" in shown.out
    assert shown.err.startswith("rotortrack: no work can be done here because of pyarrow")


def kernels_of_the_package() -> set[str]:
    """Names as numba gives them to the files in which it keeps kernels."""
    found = set()
    for module in pkgutil.walk_packages(rotortrack.__path__, "rotortrack."):
        for name, value in vars(importlib.import_module(module.name)).items():
            function = getattr(value, "py_func", None)
            if function is not None and function.__module__ == module.name:
                found.add(f"{module.name.rpartition('.')[2]}.{name}")
    return found


def test_a_warm_up_compiles_every_kernel_and_a_run_after_it_none(tmp_path: Path) -> None:
    (tmp_path / "tmp").mkdir()
    folders = {"ROTORTRACK_CACHE_DIR": tmp_path / "cache", "TMPDIR": tmp_path / "tmp"}
    environment = {**os.environ, **{name: str(path) for name, path in folders.items()}}

    def call(*words: object) -> str:
        done = subprocess.run(
            [sys.executable, "-c", COMMAND, *map(str, words)],
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def kept() -> list[Path]:
        return sorted((tmp_path / "cache").rglob("*.nb?"))

    shown = json.loads(call("doctor", "--warm", "--json"))
    assert shown["warm_up_s"] > 0
    assert {path.name.partition("-")[0] for path in kept()} == kernels_of_the_package()
    assert shown["findings"][-1]["state"].startswith(f"{len(kernels_of_the_package())} compiled")
    assert not list((tmp_path / "tmp").iterdir())
    before = kept()
    config = SAMPLE / "config.toml"
    call("run", SAMPLE / "movie.tif", "-c", config, "-o", "results", "--no-figures", "-q")
    assert kept() == before
