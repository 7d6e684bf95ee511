"""What the README shows is true: its Python runs, its commands and exit codes exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rotortrack_cli.exits import Exit
from rotortrack_cli.main import rotortrack

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_notebook_example_finds_the_rotors(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict[str, object] = {}
    exec(code, names)
    assert len(names["found"].rotors) == 8
    assert "radius_nm" in capsys.readouterr().out


COMMANDS = set(re.findall(r"(?:`|^|/|&& )rotortrack ([a-z]+)\b", README, re.MULTILINE))


@pytest.mark.parametrize("word", sorted(COMMANDS))
def test_every_command_that_is_named_exists(word):
    assert word in rotortrack.lazy


def test_exit_codes_are_the_ones_that_are_used():
    (listed,) = re.findall(r"## Exit codes\n\n(.*?)\n*\Z", README, re.DOTALL)
    numbers = {int(number) for number in re.findall(r"\b\d+\b", listed)}
    assert numbers == {int(code) for code in Exit} - {Exit.READER_GONE}


def test_files_of_the_run_folder_and_pictures_exist():
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / picture).is_file()
