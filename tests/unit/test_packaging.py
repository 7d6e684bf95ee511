"""What is inside the distributions that pip installs."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build wheel and sdist with the tools of this environment, nothing downloaded."""
    if not (ROOT / "pyproject.toml").is_file():
        pytest.skip("the tests do not run from a source tree")
    for tool in ("build", "hatchling"):
        if importlib.util.find_spec(tool) is None:
            pytest.skip(f"{tool} is not installed (it is in the extra [dev])")
    folder = tmp_path_factory.mktemp("dist")
    command = ["-m", "build", "--wheel", "--sdist", "--no-isolation", "--outdir", str(folder)]
    done = subprocess.run(
        [sys.executable, *command, str(ROOT)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def wheel(built: Path) -> set[str]:
    """Names in the wheel."""
    (path,) = built.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        return set(archive.namelist())


def test_the_wheel_holds_both_packages_with_their_types(wheel: set[str]) -> None:
    assert {"rotortrack/__init__.py", "rotortrack/localise/wavelet.py"} <= wheel
    assert {"rotortrack_cli/main.py", "rotortrack_cli/commands/convert.py"} <= wheel
    assert {"rotortrack/py.typed", "rotortrack_cli/py.typed"} <= wheel
    assert "rotortrack/simulate/field/default_field.npz" in wheel


def test_the_wheel_holds_nothing_else(wheel: set[str]) -> None:
    tops = {name.split("/")[0] for name in wheel}
    (metadata,) = (top for top in tops if top.endswith(".dist-info"))
    assert tops == {"rotortrack", "rotortrack_cli", metadata}
    assert f"{metadata}/licenses/LICENSE" in wheel
    assert not [name for name in wheel if "__pycache__" in name or name.endswith(".tif")]


def test_every_source_file_is_in_the_wheel(wheel: set[str]) -> None:
    sources = {
        path.relative_to(base).as_posix()
        for base, package in [(ROOT, "rotortrack"), (ROOT / "cli", "rotortrack_cli")]
        for path in (base / package).rglob("*.py")
    }
    assert len(sources) > 30
    assert sources <= wheel


def test_the_wheel_installs_the_command(built: Path) -> None:
    (path,) = built.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        (name,) = (n for n in archive.namelist() if n.endswith("entry_points.txt"))
        text = archive.read(name).decode()
    assert "rotortrack = rotortrack_cli.main:main" in text


def test_cli_cannot_be_imported_from_the_wheel(built: Path) -> None:
    (path,) = built.glob("*.whl")
    code = f"""
import sys
sys.path.insert(0, {str(path)!r})
import rotortrack.errors, rotortrack_cli.exits
print(rotortrack.errors.__file__, rotortrack_cli.exits.__file__)
import cli
"""
    # Without `site`, so that an editable installation does not put the source tree on the path.
    command = [sys.executable, "-I", "-S", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=built)
    assert done.stdout.count(str(path)) == 2
    assert "No module named 'cli'" in done.stderr


def test_the_sdist_holds_the_chosen_entries_only(built: Path) -> None:
    (path,) = built.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = [Path(name) for name in archive.getnames()]
    tops = {name.parts[1] for name in names if len(name.parts) > 1}
    wished = {"rotortrack", "cli", "tests", "pyproject.toml", "README.md", "LICENSE"}
    assert wished <= tops
    added_by_hatchling = {"PKG-INFO", ".gitignore"}
    assert tops <= wished | {"sample_data", "constraints.txt"} | added_by_hatchling
    assert not [name for name in names if "__pycache__" in name.parts]
