"""The doctor names what is missing and what to do, and its warm-up compiles every kernel."""

from __future__ import annotations

import errno
import importlib
import importlib.util
import shutil
import sys
import tempfile
from collections import namedtuple
from pathlib import Path
from typing import Any

import pytest

from rotortrack import kernels
from rotortrack.pipeline import doctor
from rotortrack.pipeline.doctor import Finding, examine, examine_kernels


def by_topic(findings: list[Finding]) -> dict[str, Finding]:
    return {finding.topic: finding for finding in findings}


def test_a_sound_installation_is_able(tmp_path: Path) -> None:
    findings = by_topic(examine(tmp_path))
    assert all(finding.level != "impossible" for finding in findings.values())
    assert "numba" in findings["libraries"].state
    assert sys.executable in findings["python"].state
    assert str(tmp_path) in findings["working folder"].state
    assert {"processors", "memory", "temporary folder", "kernel cache", "threads"} <= set(findings)


def test_every_doubt_has_a_remedy_and_nothing_else_has(tmp_path: Path) -> None:
    for finding in [*examine(tmp_path), examine_kernels()]:
        assert bool(finding.remedy) == (finding.level != "ok"), finding


def test_a_library_that_cannot_be_imported_makes_work_impossible(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = importlib.import_module

    def fail(name: str, package: str | None = None) -> Any:
        if name == "numba":
            raise ImportError("Numba needs NumPy 2.4 or less\nsecond line")
        return load(name, package)

    monkeypatch.setattr(importlib, "import_module", fail)
    findings = by_topic(examine(tmp_path))
    assert findings["numba"].level == "impossible"
    assert "Numba needs NumPy 2.4 or less)" in findings["numba"].state
    assert "threads" not in findings


def test_a_missing_extra_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "h5py" else find(name)
    )
    finding = by_topic(examine(tmp_path))["extra picasso"]
    assert finding.level == "warning"
    assert "h5py" in finding.state
    assert "pip install 'rotortrack[picasso]'" in finding.remedy


def test_a_full_disk_and_little_memory_are_warnings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**12, 10**12, 5 * 10**8))
    monkeypatch.setattr(doctor, "memory_bytes", lambda: 10**9)
    findings = by_topic(examine(tmp_path))
    for topic in ("working folder", "kernel cache", "temporary folder"):
        assert findings[topic].level == "warning"
        assert "0.5 GB free" in findings[topic].state
    assert findings["memory"].level == "warning"
    monkeypatch.setattr(doctor, "memory_bytes", lambda: None)
    assert by_topic(examine(tmp_path))["memory"].level == "ok"


def test_folders_that_cannot_be_written_are_warnings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: Any) -> Any:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    finding = by_topic(examine(tmp_path / "not" / "there"))["working folder"]
    assert finding.level == "warning"
    assert "cannot be written (Permission denied)" in finding.state
    assert not (tmp_path / "not").exists()


def test_no_temporary_folder_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> str:
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found")

    monkeypatch.setattr(tempfile, "gettempdir", none)
    assert "TMPDIR" in by_topic(examine(tmp_path))["temporary folder"].remedy


def test_kernels_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels, "cache_folder", lambda: tmp_path)
    assert "--warm" in examine_kernels().remedy
    (tmp_path / "wavelet_1").mkdir()
    for name in ("a", "b"):
        (tmp_path / "wavelet_1" / f"{name}.nbi").write_text("")
    assert examine_kernels() == Finding("kernels", f"2 compiled in {tmp_path}")
    monkeypatch.setattr(kernels, "cache_folder", lambda: None)
    assert "ROTORTRACK_CACHE_DIR" in examine_kernels().remedy
