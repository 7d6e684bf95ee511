"""`--help` is quick because it loads nothing that it does not show."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys

import pytest

from rotortrack_cli.main import rotortrack

HEAVY = {
    "h5py",
    "matplotlib",
    "numba",
    "numpy",
    "pandas",
    "pyarrow",
    "pydantic",
    "rich",
    "scipy",
    "skimage",
    "tifffile",
    "trackpy",
}

CALL = """
import json, sys
from rotortrack_cli.main import main
code = main(sys.argv[1:])
print(json.dumps([code, sorted(sys.modules)]))
"""

# The flags of two sections on a command that is not part of the program.
CALL_GENERATED = """
import json, sys, types
import click
from rotortrack_cli import flags, main
from rotortrack_cli.stage_option import StageCommand

@click.command("try", cls=StageCommand)
@flags.stage_options("movie", "localise")
def command(given):
    pass

sys.modules["throwaway"] = types.SimpleNamespace(command=command)
main.rotortrack.lazy = {"try": ("throwaway", "")}
code = main.main(sys.argv[1:])
print(json.dumps([code, sorted(sys.modules)]))
"""


def run(code: str, *arguments: str) -> tuple[str, int, set[str]]:
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True
    )
    *shown, last = done.stdout.splitlines()
    exit_code, modules = json.loads(last)
    return "\n".join(shown), exit_code, set(modules)


def test_help_loads_no_scientific_package_and_no_command() -> None:
    shown, code, modules = run(CALL, "--help")
    assert code == 0
    assert "localise" in shown
    assert not modules & HEAVY
    assert not [name for name in modules if name.startswith("rotortrack_cli.commands")]


def test_help_of_a_command_with_generated_flags_loads_no_scientific_package() -> None:
    shown, code, modules = run(CALL_GENERATED, "try", "--help")
    assert code == 0
    assert "--wavelet-order" in shown
    assert not modules & HEAVY


def test_version_is_that_of_the_installed_distribution() -> None:
    from importlib.metadata import version

    shown, code, modules = run(CALL, "--version")
    assert (code, shown) == (0, f"rotortrack {version('rotortrack')}")
    assert not modules & HEAVY


@pytest.mark.parametrize("name", list(rotortrack.lazy))
def test_every_listed_command_exists_and_has_help(name: str) -> None:
    module, _ = rotortrack.lazy[name]
    assert importlib.import_module(module).command.help


@pytest.mark.parametrize("name", list(rotortrack.lazy))
def test_help_of_every_command_loads_no_scientific_package(name: str) -> None:
    _, code, modules = run(CALL, name, "--help")
    assert code == 0
    assert not modules & HEAVY


def test_help_of_the_group_needs_no_width_beyond_80() -> None:
    shown, _, _ = run(CALL, "--help")
    assert max(map(len, shown.splitlines())) <= 80
