"""The README's trade-off table is what the stored answers say."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from rotortrack.tradeoff.questions import QUESTIONS

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def load():
    spec = importlib.util.spec_from_file_location("table", BENCHMARKS / "tradeoff_table.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_readme_and_stored_answers_agree():
    made = load()
    _, _, rest = made.README.read_text(encoding="utf-8").partition(made.OPENING)
    told, _, _ = rest.partition(made.CLOSING)
    assert told == made.table()


def test_every_question_of_error_and_time_is_in_it():
    # What effects cost has no error, and a table of its own.
    assert set(load().ORDER) == set(QUESTIONS) - {"effects"}


def test_every_picture_of_the_readme_is_stored():
    assert (BENCHMARKS / "results" / "tradeoff" / "localiser.png").is_file()
