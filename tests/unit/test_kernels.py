"""Compiled kernels: right, kept on disk for the user alone, and never stale.

Each trial runs in a process of its own on a small copy of the package, because a kernel is
compiled, and its cache folder chosen, once a process.
"""

from __future__ import annotations

import json
import os
import shutil
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotortrack.errors
from rotortrack import kernels
from rotortrack.kernels import count_compiled, kernel, source_hash

PACKAGE = Path(rotortrack.errors.__file__).parent

CALLEE = """
from rotortrack.kernels import kernel

@kernel
def scale(x):
    return 2.0 * x
"""

CALLER = """
from rotortrack.callee import scale
from rotortrack.kernels import kernel

@kernel
def total(values):
    result = 0.0
    for value in values:
        result += scale(value)
    return result
"""

TRIAL = """
import json, warnings
import numpy as np
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    from rotortrack import caller, kernels
    value = caller.total(np.arange(4.0))
    folder = kernels.cache_folder()
print(json.dumps({
    "value": value,
    "package": kernels.__file__,
    "folder": str(folder) if folder else None,
    "hits": sum(caller.total.stats.cache_hits.values()),
    "misses": sum(caller.total.stats.cache_misses.values()),
    "warnings": [(w.category.__name__, str(w.message)) for w in caught],
}))
"""


MIXED = """
import json, sys
import numpy as np
from rotortrack import caller, callee
# The first process compiled it for its caller.
first = callee.scale(3.0)
quiet = "numba.np.linalg" not in sys.modules
values = [caller.total(np.arange(4, dtype=kind)) for kind in ("f8", "f4", "i2")]
print(json.dumps({
    "first": first,
    "quiet": quiet,
    "values": values,
    "package": callee.__file__,
    "hits": sum(caller.total.stats.cache_hits.values()),
    "misses": sum(caller.total.stats.cache_misses.values()),
}))
"""


@kernel
def _ratio(a: Any, b: float) -> Any:
    out = np.empty(len(a))
    for i in range(len(a)):
        out[i] = a[i] / b
    return out


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Copy what kernels need of the package, with two kernels of which one calls the other."""
    copy = tmp_path / "site" / "rotortrack"
    copy.mkdir(parents=True)
    (copy / "__init__.py").write_text("")
    for name in ("errors.py", "kernels.py"):
        shutil.copy(PACKAGE / name, copy)
    (copy / "callee.py").write_text(CALLEE)
    (copy / "caller.py").write_text(CALLER)
    return copy


@pytest.fixture
def trial(package: Path, tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Call the kernel in a new process; give its value and what became of the cache."""

    def run(program: str = TRIAL, **environment: object) -> dict[str, Any]:
        chosen = {"ROTORTRACK_CACHE_DIR": tmp_path / "cache", **environment}
        variables = {**os.environ, "PYTHONPATH": str(package.parent)}
        variables.pop("NUMBA_CACHE_DIR", None)
        variables |= {key: str(value) for key, value in chosen.items() if value is not None}
        if chosen["ROTORTRACK_CACHE_DIR"] is None:
            variables.pop("ROTORTRACK_CACHE_DIR", None)
        done = subprocess.run(
            [sys.executable, "-B", "-c", program],
            env=variables,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        outcome: dict[str, Any] = json.loads(done.stdout)
        assert Path(outcome["package"]).parent == package
        return outcome

    return run


def modes(folder: Path) -> set[int]:
    return {stat.S_IMODE(path.stat().st_mode) for path in folder.glob("kernels-*")}


def test_a_kernel_computes_what_python_computes() -> None:
    values = np.random.default_rng(1).normal(size=100)
    expected = _ratio.py_func(values, 3.0)  # type: ignore[attr-defined]
    np.testing.assert_allclose(_ratio(values, 3.0), expected, rtol=1e-15)


def test_division_by_zero_and_nan_behave_as_in_numpy() -> None:
    values = np.array([1.0, -1.0, 0.0, np.nan])
    np.testing.assert_array_equal(_ratio(values, 0.0), [np.inf, -np.inf, np.nan, np.nan])


def test_the_second_process_loads_what_the_first_compiled(
    trial: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    first, second = trial(), trial()
    assert first["value"] == second["value"] == 12.0
    assert (first["hits"], first["misses"]) == (0, 1)
    assert (second["hits"], second["misses"]) == (1, 0)
    assert first["warnings"] == second["warnings"] == []
    assert Path(first["folder"]).parent == tmp_path / "cache"
    assert list(Path(first["folder"]).rglob("*.nbc"))
    if os.name == "posix":
        assert modes(tmp_path / "cache") == {0o700}


def test_a_process_that_only_loads_prepares_no_compiler_and_may_compile_later(
    trial: Callable[..., dict[str, Any]],
) -> None:
    assert trial()["value"] == 12.0
    first, second = trial(MIXED), trial(MIXED)
    assert first["values"] == second["values"] == [12.0, 12.0, 12.0]
    assert first["first"] == second["first"] == 6.0
    assert first["quiet"]
    assert second["quiet"]
    assert (first["hits"], first["misses"]) == (1, 2)
    assert (second["hits"], second["misses"]) == (3, 0)


def test_a_changed_callee_in_another_file_gives_the_new_result(
    trial: Callable[..., dict[str, Any]], package: Path
) -> None:
    assert trial()["value"] == 12.0
    (package / "callee.py").write_text(CALLEE.replace("2.0", "3.0"))
    changed = trial()
    assert changed["value"] == 18.0
    (package / "callee.py").write_text(CALLEE)
    again = trial()
    assert again["value"] == 12.0
    assert again["folder"] != changed["folder"]


def test_a_read_only_installation_is_cached_in_the_user_cache(
    trial: Callable[..., dict[str, Any]], package: Path, tmp_path: Path
) -> None:
    # Root writes into folders without the permission, so a file also takes the place of the
    # folder that numba would make there.
    (package / "__pycache__").write_text("")
    package.chmod(0o555)
    try:
        home = {"ROTORTRACK_CACHE_DIR": None, "XDG_CACHE_HOME": tmp_path / "xdg"}
        home |= {"HOME": tmp_path / "home", "LOCALAPPDATA": tmp_path / "xdg"}
        first, second = trial(**home), trial(**home)
    finally:
        package.chmod(0o755)
    assert first["value"] == 12.0
    assert first["warnings"] == []
    assert tmp_path in Path(first["folder"]).parents
    assert package not in Path(first["folder"]).parents
    assert second["hits"] == 1


def test_no_cache_folder_means_one_warning_and_the_right_result(
    trial: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    for _ in range(2):
        outcome = trial(ROTORTRACK_CACHE_DIR=tmp_path / "file" / "cache")
        assert outcome["value"] == 12.0
        assert outcome["folder"] is None
        ((category, sentence),) = outcome["warnings"]
        assert category == "KernelCacheWarning"
        assert "ROTORTRACK_CACHE_DIR" in sentence


@pytest.mark.usefixtures("modes_obeyed")
def test_a_cache_without_permission_means_one_warning_and_the_right_result(
    trial: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    outcome = trial(ROTORTRACK_CACHE_DIR=closed)
    assert outcome["value"] == 12.0
    assert [category for category, _ in outcome["warnings"]] == ["KernelCacheWarning"]


@pytest.mark.skipif(os.name != "posix", reason="modes exist on POSIX only")
def test_a_folder_open_to_others_is_refused(
    trial: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    """Whoever can write there could have us run their machine code."""
    folder = Path(trial()["folder"])
    folder.chmod(0o777)
    refused = trial()
    assert refused["folder"] is None
    assert refused["hits"] == 0
    assert refused["value"] == 12.0
    assert "open to other users" in refused["warnings"][0][1]

    folder.chmod(0o700)
    (tmp_path / "cache").chmod(0o777)
    assert trial()["folder"] is None
    (tmp_path / "cache").chmod(0o1777)
    assert trial()["hits"] == 1


def test_the_hash_is_stable_within_a_version() -> None:
    assert source_hash() == source_hash()
    assert len(source_hash()) == 20


DAY_S = 86_400.0


def old_folder(cache: Path, name: str, days: float) -> Path:
    folder = cache / name
    (folder / "rotortrack_1").mkdir(parents=True)
    (folder / "rotortrack_1" / "loop.nbi").write_text("")
    set_age(folder, days)
    return folder


def set_age(path: Path, days: float) -> None:
    then = time.time() - days * DAY_S
    os.utime(path, (then, then))


def test_a_new_folder_sweeps_versions_unused_for_thirty_days(
    trial: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    stale = old_folder(cache, f"kernels-{'a' * 20}", 31)
    recent = old_folder(cache, f"kernels-{'b' * 20}", 29)
    others = [
        old_folder(cache, name, 400)
        for name in ("kernels-mine", f"kernels-{'g' * 20}", f"kernels-{'a' * 20}.bak", "results")
    ]
    file = cache / f"kernels-{'c' * 20}"
    file.write_text("")
    set_age(file, 400)
    outcome = trial()
    assert outcome["value"] == 12.0
    assert outcome["warnings"] == []
    assert not stale.exists()
    assert recent.is_dir()
    assert file.is_file()
    assert all((other / "rotortrack_1" / "loop.nbi").is_file() for other in others)


def test_only_a_new_folder_sweeps_and_use_keeps_a_folder_young(
    trial: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    folder = Path(trial()["folder"])
    set_age(folder, 400)
    stale = old_folder(tmp_path / "cache", f"kernels-{'a' * 20}", 31)
    assert trial()["hits"] == 1
    assert stale.is_dir()
    assert time.time() - folder.stat().st_mtime < DAY_S


@pytest.mark.skipif(os.name != "posix", reason="links need no permission on POSIX only")
def test_the_sweep_follows_no_link(tmp_path: Path) -> None:
    outside = old_folder(tmp_path, "precious", 400)
    cache = tmp_path / "cache"
    stale = old_folder(cache, f"kernels-{'a' * 20}", 0)
    (stale / "link").symlink_to(outside)
    set_age(stale, 400)
    link = cache / f"kernels-{'b' * 20}"
    link.symlink_to(outside)
    kernels._sweep(cache / f"kernels-{'c' * 20}")
    assert not stale.exists()
    assert link.is_symlink()
    assert count_compiled(outside) == 1


def test_what_cannot_be_removed_does_not_stop_the_sweep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = (old_folder(tmp_path, f"kernels-{letter * 20}", 31) for letter in "ab")
    remove = shutil.rmtree

    def refuse_first(path: Path, **how: Any) -> None:
        if path == first:
            raise PermissionError("in use")
        remove(path, **how)

    monkeypatch.setattr(shutil, "rmtree", refuse_first)
    kernels._sweep(tmp_path / f"kernels-{'c' * 20}")
    assert first.is_dir()
    assert not second.exists()
    kernels._sweep(tmp_path / "absent" / f"kernels-{'c' * 20}")
