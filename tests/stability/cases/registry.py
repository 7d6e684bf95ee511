"""Hard cases of numerical routines: how they are run, and what may come of them.

An outcome is a number of digits kept against a reference, a refusal on purpose, an answer of a
kind ("finite", "nan", "nothing"), or a reason why the case does not apply.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import RotortrackError

Floats = NDArray[np.float64]
MOST_DIGITS = 15.0
COMMON = ("float32", "denormals", "duplicates", "nan", "inf", "empty", "single")


@dataclass(frozen=True)
class Case:
    """One hard case; `measure` gives the outcome as it stands in the report."""

    routine: str
    name: str
    measure: Callable[[], str]


CASES: dict[tuple[str, str], Case] = {}


def numbers(answer: Any) -> Floats:
    """All numbers of an answer in order, whatever it is made of."""
    if answer is None or isinstance(answer, str | Enum):
        return np.zeros(0)
    if dataclasses.is_dataclass(answer):
        parts = [getattr(answer, item.name) for item in dataclasses.fields(answer)]
        return numbers(parts)
    if isinstance(answer, Mapping):
        return numbers(list(answer.values()))
    if isinstance(answer, tuple | list):
        return np.concatenate([numbers(part) for part in answer]) if answer else np.zeros(0)
    values = np.asarray(answer)
    if values.dtype.kind not in "biufc":
        return np.zeros(0)
    if values.dtype.kind == "c":
        values = np.stack([values.real, values.imag])
    return values.ravel().astype(np.float64)


def digits(found: Any, reference: Any, *, size: float | None = None) -> str:
    """Fewest significant digits that any number shares with its reference.

    Parameters
    ----------
    found, reference
        Anything that `numbers` understands, of one shape.
    size
        Size against which errors count; the reference's own size, number by number, if not given.
    """
    a, b = numbers(found), numbers(reference)
    if a.shape != b.shape:
        return f"wrong: {a.size} numbers instead of {b.size}"
    if not np.array_equal(np.isfinite(a), np.isfinite(b)):
        return "wrong: finite in other places"
    finite = np.isfinite(a)
    if not np.array_equal(a[~finite], b[~finite], equal_nan=True):
        return "wrong: another infinity"
    error = np.abs(a[finite] - b[finite])
    if not error.any():
        return f"{MOST_DIGITS:.1f} digits"
    scale = np.abs(b[finite]) if size is None else np.full(error.shape, size)
    worst = max(
        float(e / s) if s > 0.0 else math.inf for e, s in zip(error, scale, strict=True) if e
    )
    return f"{max(0.0, min(MOST_DIGITS, -math.log10(worst))):.1f} digits"


def attempt(call: Callable[[], Any]) -> str:
    """Say what kind of answer a call gives, or with which sentence it refuses.

    Only the project's own errors, and a ValueError raised in its own code, are refusals.
    """
    try:
        found = numbers(call())
    except RotortrackError as error:
        return f"refuses: {type(error).__name__}: {_start(error)}"
    except ValueError as error:
        if not _raised_by_us(error):
            raise
        return f"refuses: ValueError: {_start(error)}"
    if found.size == 0:
        return "answers: nothing"
    if np.isfinite(found).all():
        return "answers: finite"
    return "answers: nan" if not np.isfinite(found).any() else "answers: in part nan or infinite"


def _start(error: Exception) -> str:
    return str(error).split("\n")[0].replace("|", "/")[:80]


def _raised_by_us(error: Exception) -> bool:
    last = traceback.extract_tb(error.__traceback__)[-1]
    return "rotortrack" in Path(last.filename).parts and (last.line or "").startswith("raise ")


@dataclass(frozen=True)
class Routine:
    """A routine on plain arrays, from which the common cases follow.

    Attributes
    ----------
    name
        Dotted name below `rotortrack`.
    call
        Takes the arrays alone.
    arrays
        Usable input; `varied` says which of them are floats that the hard cases spoil.
    leaves_out
        Common cases that do not apply, each with its reason.
    """

    name: str
    call: Callable[..., Any]
    arrays: tuple[NDArray[Any], ...]
    varied: tuple[int, ...]
    leaves_out: Mapping[str, str] = field(default_factory=dict)

    def changed(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> list[NDArray[Any]]:
        """Input with the varied arrays changed."""
        return [
            change(a.copy()) if i in self.varied else a.copy() for i, a in enumerate(self.arrays)
        ]

    def cut(self, rows: Any) -> list[NDArray[Any]]:
        """Input with some rows of every array."""
        return [a[rows].copy() for a in self.arrays]


def case(routine: str, name: str, measure: Callable[[], str]) -> None:
    """Register one case."""
    if (routine, name) in CASES:
        raise ValueError(f"{routine}: the case {name} is registered twice")
    CASES[routine, name] = Case(routine, name, measure)


def does_not_apply(routine: str, names: Sequence[str], reason: str) -> None:
    """Register cases that have no meaning for a routine."""
    for name in names:
        case(routine, name, lambda: f"does not apply: {reason}")


def on_arrays(
    function: Callable[..., Any],
    *arrays: NDArray[Any],
    call: Callable[..., Any] | None = None,
    varied: Sequence[int] | None = None,
    leaves_out: Mapping[str, str] | None = None,
) -> Routine:
    """Register the common cases of a routine of arrays, and return it for cases of its own."""
    chosen = (
        varied if varied is not None else [i for i, a in enumerate(arrays) if a.dtype.kind == "f"]
    )
    out = dict(leaves_out or {})
    routine = Routine(dotted(function), call or function, arrays, tuple(chosen), out)
    for name, reason in out.items():
        does_not_apply(routine.name, [name], reason)

    def given(name: str, measure: Callable[[], str]) -> None:
        if name not in out:
            case(routine.name, name, measure)

    def single() -> str:
        rounded = routine.changed(lambda a: a.astype(np.float32))
        same = [a.astype(np.float64) if i in routine.varied else a for i, a in enumerate(rounded)]
        return digits(routine.call(*rounded), routine.call(*same))

    def spoiled(value: float) -> str:
        def spoil(a: NDArray[Any]) -> NDArray[Any]:
            a.reshape(-1)[a.size // 2] = value
            return a

        return attempt(lambda: routine.call(*routine.changed(spoil)))

    given("float32", single)
    given(
        "denormals", lambda: attempt(lambda: routine.call(*routine.changed(lambda a: a * 5e-320)))
    )
    given(
        "duplicates",
        lambda: attempt(
            lambda: routine.call(*routine.changed(lambda a: np.full_like(a, a.flat[0])))
        ),
    )
    given("nan", lambda: spoiled(math.nan))
    given("inf", lambda: spoiled(math.inf))
    given("empty", lambda: attempt(lambda: routine.call(*routine.cut(slice(0, 0)))))
    given("single", lambda: attempt(lambda: routine.call(*routine.cut(slice(0, 1)))))
    return routine


def on_numbers(
    function: Callable[..., float],
    usual: Sequence[float],
    exact: Callable[..., float],
    hard: Mapping[str, Sequence[float]] | None = None,
) -> None:
    """Register the cases of a routine of plain numbers against a reference in closed form."""
    name = dotted(function)
    case(name, "usual", lambda: digits(function(*usual), exact(*usual)))
    for label, values in (hard or {}).items():
        case(name, label, lambda values=values: digits(function(*values), exact(*values)))  # type: ignore[misc]
    rounded = [float(np.float32(value)) for value in usual]
    case(
        name,
        "float32",
        lambda: digits(function(*(np.float32(v) for v in rounded)), function(*rounded)),
    )
    for label, value in (("nan", math.nan), ("inf", math.inf), ("denormals", 5e-320)):
        first = [value, *usual[1:]]
        case(name, label, lambda first=first: attempt(lambda: function(*first)))  # type: ignore[misc]
    does_not_apply(name, ["duplicates", "empty", "single"], "takes single numbers, no rows")


def dotted(function: Callable[..., Any]) -> str:
    """Name of a function below the package."""
    plain = inspect.unwrap(function)
    return f"{plain.__module__}.{plain.__name__}".removeprefix("rotortrack.")
