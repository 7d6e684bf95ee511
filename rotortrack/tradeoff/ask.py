"""Asking a question of `rotortrack tradeoff`, and writing its answer."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rotortrack.errors import ConfigurationError
from rotortrack.files import make_folder, write_text
from rotortrack.tradeoff.point import Answer, Effort, Progress
from rotortrack.tradeoff.questions import QUESTIONS


def ask(
    name: str,
    effort: Effort,
    progress: Progress,
    groups: Mapping[str, Any] | None = None,
) -> Answer:
    """Measure what a question asks on this machine.

    Parameters
    ----------
    name
        A key of QUESTIONS.
    effort, progress
        How long it may take, and who is told what goes on.
    groups
        Situations to ask about, where the question is one of ON_MOVIES; its own when not given.

    Raises
    ------
    ConfigurationError
        There is no such question.
    """
    if name not in QUESTIONS:
        raise ConfigurationError(f"{name} is not a question: known are {', '.join(QUESTIONS)}")
    question = importlib.import_module(QUESTIONS[name])
    own = () if groups is None else (groups,)
    answer: Answer = question.answer(effort, progress, *own)
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

    make_folder(folder)
    write_text(folder / f"{answer.question}.json", answer.to_json())
    write_text(folder / f"{answer.question}.csv", answer.to_csv())
    drawn = picture.figure(answer.plain(), title(answer.question))
    canvas.save_as(drawn, folder / f"{answer.question}.png")
