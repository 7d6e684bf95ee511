"""The README's table of performance is the one that was measured."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
_path = ROOT / "tests" / "benchmarks" / "report.py"
_spec = importlib.util.spec_from_file_location("benchmark_report", _path)
report = sys.modules[_spec.name] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(report)


@pytest.fixture
def stored():
    path = ROOT / "tests" / "benchmarks" / "results" / "engine.json"
    return json.loads(path.read_text(encoding="utf-8"))


def test_readme_shows_the_stored_results(stored):
    readme = ROOT / "README.md"
    if not readme.is_file():
        pytest.skip("the tests do not run from a source tree")
    assert report.readme_table(stored) in readme.read_text(encoding="utf-8")


def test_stored_results_hold_every_quantity_that_has_a_bar(stored):
    for quantity in report.QUANTITIES:
        if quantity.bar:
            assert quantity.read(stored, "rotortrack") is not None, quantity.words


def test_the_table_names_date_machine_and_versions(stored):
    table = report.readme_table(stored)
    for said in (stored["date"], stored["machine"]["processor"], *stored["versions"].values()):
        assert said in table


def test_a_program_that_is_not_installed_is_left_out_and_named(stored):
    for part in (*stored["rates"].values(), *stored["accuracy"].values(), stored["processes"]):
        part.pop("smappy", None)
    stored["left_out"] = {"SMAPpy": "smappy-smlm is not installed"}
    table = report.readme_table(stored)
    assert "| SMAPpy |" not in table
    assert "Left out: SMAPpy" in table
    assert any(line.startswith("left out: SMAPpy") for line in report.lines(stored))


@pytest.mark.parametrize(
    ("value", "better", "words"),
    [(2.6, "max", "stretch"), (1.5, "max", "bar"), (1.3, "max", "MISSED"), (1.0, "min", "MISSED")],
)
def test_a_verdict_compares_with_bar_and_stretch(value, better, words):
    bar, stretch = ((1.4,), (2.5,)) if better == "max" else ((0.9,), (0.8,))
    quantity = report.Quantity("", None, str, better, bar, stretch)
    assert report.verdict(quantity, value) == words


def test_only_the_part_between_the_markers_is_replaced():
    text = f"before\n{report.OPENING}\nold\n{report.CLOSING}\nafter\n"
    table = f"{report.OPENING}\nnew\n{report.CLOSING}"
    assert report.replace_table(text, table) == f"before\n{table}\nafter\n"
    with pytest.raises(ValueError, match="performance"):
        report.replace_table("no markers", table)
