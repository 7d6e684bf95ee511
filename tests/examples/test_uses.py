"""The three uses of the library, as scripts that a notebook may copy; the README quotes them."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
USES = Path(__file__).with_name("uses")
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Make what the README's commands make, in a folder that looks like the repository."""
    from rotortrack_cli.main import main

    place = tmp_path_factory.mktemp("uses")
    (place / "sample_data").symlink_to(ROOT / "sample_data")
    colours, scenes = ROOT / "sample_data" / "two_colours", ROOT / "sample_data" / "scenes"
    split = ("--split", "left-right")
    for words in (
        ("register", ROOT / "sample_data" / "fiducials" / "movie.tif", *split,
         "--pixel-size-nm", 108.3, "-o", place / "channels.json"),
        ("run", colours / "movie.tif", "-c", colours / "config.toml", *split, "--no-figures",
         "--channels", place / "channels.json", "-o", place / "two-colours"),
        ("simulate", "scan", scenes / "small_scan.toml", "--no-figures",
         "-o", place / "small-scan"),
    ):  # fmt: skip
        assert main([str(word) for word in (*words, "-q")]) == 0
    return place


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("stack", r"driven_c"),
        ("two_colours", r"places, known to 0\.\d\d nm"),
        ("distances", r"rotor 3: 27\d nm, .*\nsimulated: \[\d+"),
    ],
)
def test_a_use_runs_as_it_stands(name, told, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    runpy.run_path(str(USES / f"{name}.py"))
    assert re.search(told, capsys.readouterr().out)


def test_the_readme_quotes_them():
    for path in USES.glob("*.py"):
        assert f"tests/examples/uses/{path.name}" in README
    stack = (USES / "stack.py").read_text(encoding="utf-8")
    assert stack.partition("import rotortrack as rt\n")[2].strip() in README
