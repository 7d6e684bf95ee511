"""What a question of `rotortrack tradeoff` answers: points of error and time."""

from __future__ import annotations

import datetime
import math
import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Effort:
    name: str


@dataclass(frozen=True)
class Point:
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
    question: str
    points: tuple[Point, ...]
    error_unit: str
    seconds_unit: str
    bounds: dict[str, float | None]
    advice: str
    effort: str
    machine: str = ""
    date: str = ""
    versions: dict[str, str] = field(default_factory=dict)


def stamped(*, effort: Effort, points: Sequence[Point], bounds, **kw) -> Answer:
    return Answer(points=tuple(points), bounds=bounds, effort=effort.name, **kw)


def interval_of_mean(values: Sequence[float]) -> tuple[float, float, float]:
    import numpy as np
    from scipy.stats import t

    mean = float(np.mean(values))
    if len(values) < 2:
        return mean, mean, mean
    half = (
        float(t.ppf(0.975, len(values) - 1))
        * float(np.std(values, ddof=1))
        / math.sqrt(len(values))
    )
    return mean, max(mean - half, 0.0), mean + half
