"""Timing of settings in turns, and intervals of root mean squares."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from rotortrack.tradeoff.point import Progress

if TYPE_CHECKING:
    from numpy.typing import NDArray

T = TypeVar("T")

_Z = 1.959963984540054


def in_turns(
    works: Mapping[str, Callable[[], T]], repeats: int, progress: Progress, title: str
) -> dict[str, tuple[T, float]]:
    """Do the works of all settings again and again, each in its turn.

    A machine that slows down for a while so slows all settings, and not one of them. Each work is
    done once before, so that no time holds compiling or loading.

    Parameters
    ----------
    works
        By setting, what is timed.
    repeats
        How often each is timed.
    progress, title
        Told after each turn.

    Returns
    -------
    By setting, what the work gave and the least processor time that it took (s).
    """
    results = {}
    for number, (name, work) in enumerate(works.items()):
        progress(title, number, len(works) * (repeats + 1))
        results[name] = work()
    seconds = dict.fromkeys(works, math.inf)
    for repeat in range(repeats):
        for number, (name, work) in enumerate(works.items()):
            progress(title, (repeat + 1) * len(works) + number, len(works) * (repeats + 1))
            begun = time.process_time()
            work()
            seconds[name] = min(seconds[name], time.process_time() - begun)
    return {name: (results[name], seconds[name]) for name in works}


def rms_interval(squares: NDArray[np.floating[Any]]) -> tuple[float, float, float]:
    """Give the root of the mean of squared errors with its 95 % interval.

    The mean of the squares is taken for normal, as that of many is.

    Parameters
    ----------
    squares
        Squared errors, independent, shape (n,), n >= 2.
    """
    mean = float(np.mean(squares))
    half = _Z * float(np.std(squares, ddof=1)) / math.sqrt(squares.size)
    return math.sqrt(mean), math.sqrt(max(mean - half, 0.0)), math.sqrt(mean + half)
