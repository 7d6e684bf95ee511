"""What several questions answered, as one table for people to read."""

from __future__ import annotations

from collections.abc import Sequence

from rotortrack.tradeoff.point import Answer


def as_markdown(answers: Sequence[Answer]) -> str:
    """Write what the defaults cost, and the advice, a question a row.

    Parameters
    ----------
    answers
        In the order of the rows.

    Returns
    -------
    str
        A table in Markdown, and a line that says when, where and by which programs each was
        measured.
    """
    lines = ["| question | error of the default | its time | advice |", "| --- | --- | --- | --- |"]
    lines += [
        f"| `{answer.question}` | {_errors(answer)} | {_times(answer)} | {answer.advice} |"
        for answer in answers
    ]
    return "\n".join([*lines, "", _origin(answers)])


def _errors(answer: Answer) -> str:
    """Give the default's errors over their bounds, where there are any, or as they are."""
    found = [point for point in answer.points if point.is_default and not point.failed]
    if not found:
        return "-"
    bounds = [answer.bounds.get(point.group) for point in found]
    ratios = [p.error / bound for p, bound in zip(found, bounds, strict=True) if bound]
    if len(ratios) == len(found):
        return f"{_range(ratios, '.2f')} times the bound"
    return f"{_range([point.error for point in found], '.2g')} ({answer.error_unit})"


def _times(answer: Answer) -> str:
    found = [point.seconds for point in answer.points if point.is_default and not point.failed]
    return f"{_range(found, '.2g')} {answer.seconds_unit}" if found else "-"


def _range(values: Sequence[float], form: str) -> str:
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low} to {high}"


def _origin(answers: Sequence[Answer]) -> str:
    """Say when and where, once for all that agree."""
    machines = sorted({_machine(answer) for answer in answers})
    dates = sorted({answer.date for answer in answers})
    versions = sorted({answer.versions.get("rotortrack", "unknown") for answer in answers})
    return (
        f"Measured by `rotortrack tradeoff` on {' and '.join(dates)}, {'; '.join(machines)}, "
        f"rotortrack {' and '.join(versions)}."
    )


def _machine(answer: Answer) -> str:
    units = {"cores": " cores"}
    return ", ".join(f"{value}{units.get(name, '')}" for name, value in answer.machine.items())
