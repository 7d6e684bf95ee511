"""What a question of `rotortrack tradeoff` answers: errors and times of the settings of a dial."""

from __future__ import annotations

import csv
import dataclasses
import datetime
import io
import json
import math
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

Progress = Callable[[str, int, int], None]
"""Told what goes on, how much of it is done, and of how much (0: unknown)."""

EFFORTS: Final = ("quick", "usual", "thorough")


@dataclass(frozen=True)
class Effort:
    """How long a question may take: 15 s, two minutes, or as long as it wants."""

    name: Literal["quick", "usual", "thorough"] = "usual"


@dataclass(frozen=True)
class Point:
    """One setting of a dial in one situation.

    Attributes
    ----------
    setting, group
        The setting, and the situation in which it was tried.
    error, error_low, error_high
        Its error with a 95 % interval, in the answer's unit; nan where it failed.
    seconds
        Time of the answer's unit of work, the best of its repeats.
    is_default
        Whether it is what a user gets who chooses nothing.
    failed
        Why the setting is of no use here; empty where it is.
    """

    setting: str
    group: str
    error: float
    error_low: float
    error_high: float
    seconds: float
    is_default: bool
    failed: str = ""


@dataclass(frozen=True)
class Answer:
    """The points of a question, and all that is needed to read them.

    Attributes
    ----------
    question, points
        Its name; what was measured.
    error_unit, seconds_unit
        What errors and times are of.
    bounds
        By group, the least error that any method can have; None where there is no such bound.
    advice
        One sentence.
    effort, machine, date, versions
        How, where and when it was measured, and by which programs.
    """

    question: str
    points: tuple[Point, ...]
    error_unit: str
    seconds_unit: str
    bounds: Mapping[str, float | None]
    advice: str
    effort: str
    machine: Mapping[str, Any]
    date: str
    versions: Mapping[str, str]

    @property
    def groups(self) -> tuple[str, ...]:
        """Situations in the order of the points."""
        return tuple(dict.fromkeys(point.group for point in self.points))

    def plain(self) -> dict[str, Any]:
        """Give it as JSON has it; numbers that are none become None."""
        content = dataclasses.asdict(self)
        for point in content["points"]:
            for name, value in point.items():
                if isinstance(value, float) and not math.isfinite(value):
                    point[name] = None
        return content

    def to_json(self) -> str:
        """Write it as JSON."""
        return json.dumps(self.plain(), indent=1, allow_nan=False) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Answer:
        """Read what `to_json` wrote.

        Raises
        ------
        ValueError, KeyError, TypeError
            The text is something else.
        """
        content = json.loads(text)
        points = []
        for one in content.pop("points"):
            values: dict[str, Any] = {k: math.nan if v is None else v for k, v in one.items()}
            points.append(Point(**values))
        return cls(points=tuple(points), **content)

    def to_csv(self) -> str:
        """Give the points as a table."""
        front = pareto(self.points)
        rows = io.StringIO()
        writer = csv.writer(rows, lineterminator="\n")
        fields = [field.name for field in dataclasses.fields(Point)]
        writer.writerow([*fields, "pareto"])
        for point in self.points:
            writer.writerow([*dataclasses.astuple(point), point in front])
        return rows.getvalue()


def stamped(
    *,
    question: str,
    effort: Effort,
    points: Sequence[Point],
    error_unit: str,
    seconds_unit: str,
    bounds: Mapping[str, float | None],
    advice: str,
) -> Answer:
    """Make an answer of what was measured here and now."""
    from rotortrack.pipeline.provenance import versions

    return Answer(
        question=question,
        points=tuple(points),
        error_unit=error_unit,
        seconds_unit=seconds_unit,
        bounds=dict(bounds),
        advice=advice,
        effort=effort.name,
        machine=machine(),
        date=datetime.datetime.now(datetime.UTC).date().isoformat(),
        versions=versions(),
    )


def machine() -> dict[str, Any]:
    """Describe the processor and the system."""
    name = platform.processor() or platform.machine()
    described = Path("/proc/cpuinfo")
    if described.exists():
        lines = described.read_text(encoding="utf-8", errors="replace").splitlines()
        models = (line for line in lines if line.startswith("model name"))
        name = next(models, name).partition(":")[2].strip() or name
    return {"processor": name, "cores": os.cpu_count(), "system": platform.system()}


def interval_of_mean(values: Sequence[float]) -> tuple[float, float, float]:
    """Give the mean of a few errors with its 95 % interval by Student's t, never below 0.

    Of a single value nothing is known: the interval is the value.
    """
    n = len(values)
    mean = math.fsum(values) / n
    if n < 2:
        return mean, mean, mean
    from scipy.special import stdtrit

    variance = math.fsum((value - mean) ** 2 for value in values) / (n - 1)
    half = float(stdtrit(n - 1, 0.975)) * math.sqrt(variance / n)
    return mean, max(mean - half, 0.0), mean + half


def pareto(points: Sequence[Point]) -> list[Point]:
    """Give the points that no other of their group beats in error and time, cheapest first."""
    front: list[Point] = []
    for group in dict.fromkeys(point.group for point in points):
        own = [point for point in points if point.group == group and _is_good(point)]
        least = math.inf
        for point in sorted(own, key=lambda one: (one.seconds, one.error)):
            if point.error < least:
                front.append(point)
                least = point.error
    return front


def dominated(points: Sequence[Point], slack: float = 0.10) -> list[tuple[Point, Point]]:
    """Pair each default with a point that is surely better in both error and time.

    Surely: the end of its error's interval lies by more than `slack` below the default's error,
    and its time by more than `slack` below the default's.
    """
    return [
        (default, other)
        for default in points
        if default.is_default and _is_good(default)
        for other in points
        if other.group == default.group and _is_good(other)
        if other.error_high < (1.0 - slack) * default.error
        if other.seconds < (1.0 - slack) * default.seconds
    ]


def _is_good(point: Point) -> bool:
    return not point.failed and math.isfinite(point.error) and math.isfinite(point.seconds)
