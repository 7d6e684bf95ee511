"""What is loaded when, and that every public name is there."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import rotortrack
import rotortrack.errors

PACKAGE = Path(rotortrack.errors.__file__).parent
HEAVY = {"h5py", "matplotlib", "numba", "numpy", "pandas", "pyarrow", "pydantic", "scipy"} | {
    *("click", "rich", "skimage", "tifffile", "trackpy")
}
OPTION_MODULES = sorted(
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
    for path in PACKAGE.rglob("*options.py")
)


def loaded_by(statement: str) -> set[str]:
    code = f"import json, sys\n{statement}\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


def test_importing_the_package_loads_nothing_scientific() -> None:
    modules = loaded_by("import rotortrack")
    assert not modules & HEAVY
    assert [name for name in modules if name.startswith("rotortrack.")] == []


def test_the_foundation_and_all_option_classes_load_nothing_scientific() -> None:
    assert len(OPTION_MODULES) >= 6
    names = ["errors", "settings", "tables", "files", "parallel", "flags", "units"]
    modules = [f"rotortrack.{name}" for name in names] + OPTION_MODULES
    assert not loaded_by("import " + ", ".join(modules)) & HEAVY


def test_a_public_name_loads_its_own_module_only() -> None:
    modules = loaded_by("from rotortrack import LocaliseOptions, RotortrackError")
    assert "rotortrack.localise.options" in modules
    assert not modules & HEAVY


def test_localising_does_not_load_tables_figures_or_the_simulator() -> None:
    modules = loaded_by("import rotortrack.localise.engine")
    assert not modules & {"pandas", "matplotlib", "trackpy", "skimage"}
    assert not [name for name in modules if name.startswith("rotortrack.simulate")]


@pytest.mark.parametrize("name", rotortrack.__all__)
def test_every_public_name_resolves(name: str) -> None:
    value = getattr(rotortrack, name)
    assert value is getattr(rotortrack, name)
    if name != "__version__":
        assert value.__module__.startswith("rotortrack.")
        assert value.__doc__


def test_type_checkers_see_the_names_that_are_found_at_run_time() -> None:
    source = (PACKAGE / "__init__.py").read_text()
    typed = source.split("if TYPE_CHECKING:")[1].split("\n_HOMES")[0]
    for name, home in rotortrack._HOMES.items():
        (line,) = (text for text in typed.splitlines() if f"from rotortrack.{home} import" in text)
        assert name in line.split(" import ")[1].split(", ")
    assert sorted(rotortrack.__all__) == sorted([*rotortrack._HOMES, "__version__"])


def test_dir_lists_public_names_and_unknown_names_fail_as_usual() -> None:
    assert set(rotortrack.__all__) <= set(dir(rotortrack))
    assert not hasattr(rotortrack, "nonsense")
    with pytest.raises(ImportError, match="nonsense"):
        from rotortrack import nonsense  # noqa: F401


def test_no_file_is_longer_than_400_lines() -> None:
    root = PACKAGE.parent
    folders = [PACKAGE, root / "cli"] if (root / "cli").is_dir() else [PACKAGE]
    files = [path for folder in folders for path in folder.rglob("*.py")]
    assert len(files) > 10
    assert {path.name for path in files if len(path.read_text().splitlines()) > 400} == set()
