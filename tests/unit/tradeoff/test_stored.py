"""The stored tables: all are there, no default is dominated, and what quotes them agrees."""

from __future__ import annotations

import importlib.util
import json
import math
from pathlib import Path

import pytest

from rotortrack.pipeline.accuracy import COSTS
from rotortrack.tradeoff.point import Answer, dominated
from rotortrack.tradeoff.questions import QUESTIONS

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
STORED = BENCHMARKS / "results" / "tradeoff"


def stored(name: str) -> Answer:
    return Answer.from_json((STORED / f"{name}.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", QUESTIONS)
def test_every_question_has_a_stored_answer(name: str) -> None:
    answer = stored(name)
    assert answer.question == name
    assert answer.effort in ("usual", "thorough")
    for group in answer.groups:
        own = [point for point in answer.points if point.group == group]
        assert sum(point.is_default for point in own) == 1
        assert all(math.isfinite(point.seconds) for point in own)


@pytest.mark.parametrize("name", QUESTIONS)
def test_no_stored_default_is_dominated(name: str) -> None:
    pairs = dominated(stored(name).points)
    assert not pairs, [f"{one.group}: {one.setting} by {other.setting}" for one, other in pairs]


def test_effects_have_a_stored_answer() -> None:
    told = json.loads((STORED / "effects.json").read_text(encoding="utf-8"))
    names = [row["effect"] for row in told["effects"]]
    assert names[0] == "everything"
    assert {"psf", "timestamps", "rotors", "camera"} <= set(names)


def test_the_shipped_costs_of_accuracy_are_those_of_the_stored_table() -> None:
    place = BENCHMARKS / "accuracy_costs.py"
    spec = importlib.util.spec_from_file_location("accuracy_costs", place)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    assert COSTS.read_text(encoding="utf-8") == made.text(stored("run"))
