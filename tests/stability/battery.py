"""Hard cases that every numerical routine meets, made from one good input of it.

A subject is a routine with a good input. From that input the battery makes the common cases: single
precision, denormals, duplicates, nan, inf, nothing, a single row, and, where the routine has the
invariance, another order of rows, other units, another origin, another direction. What comes of a
case is a word or a number of correct digits, and stands in REPORT.md.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rotortrack.errors import RotortrackError, RotortrackWarning

MOST_DIGITS = 15.0
LOST = 1.0
"""Digits that a case may lose from one report to the next, by other libraries and machines."""

FLOATING = "raises FloatingPointError"


@dataclass(frozen=True)
class Digits:
    """A case whose answer is known: how many digits of it are right."""

    value: float

    def __str__(self) -> str:
        return f"{self.value:.1f} digits"


@dataclass(frozen=True)
class Word:
    """A case that has an answer of a kind, or is refused, or does not apply."""

    text: str

    def __str__(self) -> str:
        return self.text


Outcome = Digits | Word


@dataclass(frozen=True)
class Subject:
    """A routine and one good input.

    Attributes
    ----------
    routine
        Its dotted name below `rotortrack`.
    call
        Takes the arrays and gives an array of numbers.
    arrays
        Good input; row i of all belongs together.
    reasons
        Common cases that do not apply, and why.
    ordered
        Whether the order of rows matters.
    places
        Which of the arrays are the x and y of places that may be moved, turned and scaled; none
        where the routine knows no geometry.
    lengths
        Which further arrays are lengths, and scale with the places.
    degrees
        Power of the unit of length in each number of the answer; one for all, or one each.
    moves
        Tells what a moved, turned or scaled origin does to the answer: takes the answer, the scale,
        the shift and the angle. Without it the answer must not depend on shift and angle.
    own
        Hard cases of the routine's own: each gives an outcome.
    """

    routine: str
    call: Callable[..., Any]
    arrays: Sequence[np.ndarray] = ()
    reasons: Mapping[str, str] = field(default_factory=dict)
    ordered: bool = False
    places: tuple[int, int] | None = None
    lengths: tuple[int, ...] = ()
    degrees: float | Sequence[float] = 0.0
    moves: Callable[[np.ndarray, float, tuple[float, float], float], np.ndarray] | None = None
    own: Mapping[str, Callable[[], Outcome]] = field(default_factory=dict)

    def cases(self) -> Iterator[tuple[str, Callable[[], Outcome]]]:
        """Give every case by name."""
        for name, make in COMMON.items():
            if name in self.reasons:
                yield name, lambda name=name: Word(f"does not apply: {self.reasons[name]}")
            elif not self.arrays:
                yield name, lambda: Word("does not apply: it takes no arrays")
            else:
                yield name, lambda make=make: make(self)
        yield from self.own.items()


def digits(found: Any, expected: Any, scale: float | None = None) -> Digits:
    """Count the digits that agree, against the largest expected number or a given scale."""
    found, expected = (
        np.atleast_1d(np.asarray(found, float)),
        np.atleast_1d(np.asarray(expected, float)),
    )
    if found.shape != expected.shape or (np.isnan(found) != np.isnan(expected)).any():
        return Digits(0.0)
    known = ~np.isnan(expected)
    same = found[known] == expected[known]
    off = np.abs(found[known][~same] - expected[known][~same])
    if not off.size:
        return Digits(MOST_DIGITS)
    finite = np.abs(expected[known][np.isfinite(expected[known])])
    size = scale if scale is not None else float(finite.max(initial=0.0))
    worst = float(off.max())
    if not (math.isfinite(worst) and size > 0.0):
        return Digits(0.0)
    return Digits(float(np.clip(-math.log10(worst / size), 0.0, MOST_DIGITS)))


def attempt(call: Callable[[], Any]) -> tuple[np.ndarray | None, str]:
    """Call a routine under strict rules; give its numbers, or how it refused."""
    with np.errstate(divide="raise", invalid="raise"), warnings.catch_warnings():
        warnings.simplefilter("error")
        # What the library tells its user is no fault; anything else that escapes is.
        warnings.simplefilter("ignore", RotortrackWarning)
        try:
            return np.atleast_1d(np.asarray(call(), float)).ravel(), ""
        except RotortrackError as error:
            return None, f"refuses: {type(error).__name__}"
        except FloatingPointError:
            return None, FLOATING
        except (ValueError, TypeError) as error:
            return None, f"refuses: {type(error).__name__}"


def word_for(call: Callable[[], Any]) -> Word:
    """Say what kind of answer comes."""
    found, refused = attempt(call)
    if found is None:
        return Word(refused)
    if not found.size:
        return Word("answers nothing")
    if np.isfinite(found).all():
        return Word("answers")
    return Word("answers nan" if np.isnan(found).any() else "answers inf")


def answer(subject: Subject) -> np.ndarray:
    """Give the answer to the good input; that it has none is a mistake of the subject."""
    found, refused = attempt(lambda: subject.call(*(part.copy() for part in subject.arrays)))
    assert found is not None, f"{subject.routine}: {refused}"
    assert np.isfinite(found).any(), f"{subject.routine} answers nothing to a good input"
    return found


def _floats(subject: Subject) -> list[np.ndarray]:
    return [part.astype(float) if part.dtype.kind == "f" else part for part in subject.arrays]


def _single_precision(subject: Subject) -> Outcome:
    narrow = [
        part.astype(np.float32) if part.dtype.kind == "f" else part for part in subject.arrays
    ]
    wide = [part.astype(float) if part.dtype.kind == "f" else part for part in narrow]
    found, refused = attempt(lambda: subject.call(*narrow))
    expected, _ = attempt(lambda: subject.call(*wide))
    assert expected is not None
    return Word(refused) if found is None else digits(found, expected)


def _denormals(subject: Subject) -> Outcome:
    made = [part * 5e-324 if part.dtype.kind == "f" else part for part in subject.arrays]
    return word_for(lambda: subject.call(*made))


def _duplicates(subject: Subject) -> Outcome:
    twice = [np.repeat(part, 2, axis=0) for part in subject.arrays]
    return word_for(lambda: subject.call(*twice))


def _with(subject: Subject, value: float) -> Outcome:
    """Put a value that is no number into every row 3; compare with that row left out."""
    spoiled, without = _floats(subject), [np.delete(part, 3, axis=0) for part in subject.arrays]
    for part in spoiled:
        if part.dtype.kind == "f":
            part[3] = value
    found, refused = attempt(lambda: subject.call(*spoiled))
    if found is None:
        return Word(refused)
    expected, _ = attempt(lambda: subject.call(*without))
    if expected is not None and found.shape == expected.shape:
        if digits(found, expected).value > 9.0:
            return Word("answers as without it")
    elif expected is not None and found.size % len(subject.arrays[0]) == 0:
        rows = np.isnan(found.reshape(-1, len(subject.arrays[0])))
        if rows[:, 3].all() and not np.delete(rows, 3, axis=1).any():
            return Word("answers nan for it alone")
    return Word("answers nan" if np.isnan(found).all() else "answers otherwise")


def _nothing(subject: Subject) -> Outcome:
    return word_for(lambda: subject.call(*(part[:0] for part in subject.arrays)))


def _single_row(subject: Subject) -> Outcome:
    return word_for(lambda: subject.call(*(part[:1] for part in subject.arrays)))


def _another_order(subject: Subject) -> Outcome:
    if subject.ordered:
        return Word("does not apply: rows are a series in time")
    order = np.random.default_rng(1).permutation(len(subject.arrays[0]))
    found, refused = attempt(lambda: subject.call(*(part[order] for part in subject.arrays)))
    if found is None:
        return Word(refused)
    expected = answer(subject)
    if found.size % len(order) == 0:
        expected = expected.reshape(-1, len(order))[:, order].ravel()
    return digits(found, expected)


def moved(
    subject: Subject,
    changes: Sequence[tuple[float, tuple[float, float], float]],
    scale: float | None = None,
) -> Outcome:
    """Scale, shift and turn the places; give the worst digits."""
    if subject.places is None:
        return Word("does not apply: it knows no places")
    plain = answer(subject)
    worst = Digits(MOST_DIGITS)
    for factor, shift, angle in changes:
        made = _floats(subject)
        x, y = (factor * made[i] for i in subject.places)
        cosine, sine = math.cos(angle), math.sin(angle)
        made[subject.places[0]] = cosine * x - sine * y + shift[0]
        made[subject.places[1]] = sine * x + cosine * y + shift[1]
        for i in subject.lengths:
            made[i] = factor * made[i]
        found, refused = attempt(lambda made=made: subject.call(*made))
        if found is None:
            return Word(refused)
        expected = plain * factor ** np.asarray(subject.degrees, float)
        if subject.moves is not None:
            expected = subject.moves(expected, factor, shift, angle)
        kept = digits(found, expected, scale)
        worst = min(worst, kept, key=lambda one: one.value)
    return worst


COMMON: dict[str, Callable[[Subject], Outcome]] = {
    "single precision": _single_precision,
    "denormals": _denormals,
    "duplicates": _duplicates,
    "nan": lambda subject: _with(subject, math.nan),
    "inf": lambda subject: _with(subject, math.inf),
    "nothing": _nothing,
    "a single row": _single_row,
    "another order": _another_order,
    "scale 1e-9 and 1e9": lambda s: moved(s, [(1e-9, (0.0, 0.0), 0.0), (1e9, (0.0, 0.0), 0.0)]),
    "translation 1e8": lambda s: moved(s, [(1.0, (1e8, -1e8), 0.0)]),
    "rotation": lambda s: moved(s, [(1.0, (0.0, 0.0), 1.0), (1.0, (0.0, 0.0), -2.5)]),
}
"""Every case that is asked of every routine, by name."""
