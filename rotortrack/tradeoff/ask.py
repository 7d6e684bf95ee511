"""Asking a question of `rotortrack tradeoff`, and writing its answer."""

from __future__ import annotations

import importlib
from pathlib import Path

from rotortrack.errors import ConfigurationError
from rotortrack.files import write_text
from rotortrack.tradeoff.point import Answer, Effort, Progress
from rotortrack.tradeoff.questions import QUESTIONS


def ask(name: str, effort: Effort, progress: Progress) -> Answer:
    """Measure what a question asks on this machine.

    Raises
    ------
    ConfigurationError
        There is no such question.
    """
    if name not in QUESTIONS:
        raise ConfigurationError(f"{name} is not a question: known are {', '.join(QUESTIONS)}")
    answer: Answer = importlib.import_module(QUESTIONS[name]).answer(effort, progress)
    return answer


def title(name: str) -> str:
    """Say what a question is about."""
    return str(importlib.import_module(QUESTIONS[name]).TITLE)


def write_answer(answer: Answer, folder: Path) -> None:
    """Write QUESTION.json, QUESTION.csv and QUESTION.png into a folder.

    Raises
    ------
    ResourceError
        They cannot be written.
    """
    from rotortrack.report.figures import canvas
    from rotortrack.report.figures import tradeoff as picture

    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / f"{answer.question}.json", answer.to_json())
    write_text(folder / f"{answer.question}.csv", answer.to_csv())
    drawn = picture.figure(answer.plain(), title(answer.question))
    canvas.save_as(drawn, folder / f"{answer.question}.png")
