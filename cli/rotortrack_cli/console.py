"""The only place that prints: results to stdout; progress, warnings and errors to stderr."""

from __future__ import annotations

import contextlib
import json
import math
import re
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from numbers import Integral, Real
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TextIO

from rotortrack.errors import RotortrackWarning

if TYPE_CHECKING:
    from rich.progress import Progress

Advance = Callable[[int], None]
"""Tells a progress bar how many more units are done."""

# Escape sequences first as a whole, then the rest of C0 (line feed and tab apart), C1 and the
# marks that reorder text on the screen.
_CONTROL = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\)|"
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]"
)


def printable(text: str) -> str:
    """Remove terminal control codes, which file names and metadata may carry."""
    return _CONTROL.sub("", text)


def one_line(text: str) -> str:
    """Remove control codes and put everything on one line."""
    return " ".join(printable(text).split())


class Console:
    """What a command prints; one is made for each call and handed on as click's `obj`.

    Attributes
    ----------
    quiet
        No progress; results, warnings and errors are still shown.
    as_json
        One JSON object instead of text on stdout.
    warnings
        The sentences of all warnings so far, for the JSON object and the run's manifest.
    """

    def __init__(self) -> None:
        self.quiet = False
        self.as_json = False
        self.warnings: list[str] = []
        self._progress: Progress | None = None
        self._lock = threading.Lock()

    def text(self, text: str) -> None:
        """Print lines of a result, unless JSON was asked for."""
        if not self.as_json:
            _write(sys.stdout, printable(text))

    def table(self, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """Print an aligned table, unless JSON was asked for."""
        self.text(format_table(header, rows))

    def json(self, result: Mapping[str, object]) -> None:
        """Print the result and all warnings as one line of JSON, if that was asked for."""
        if self.as_json:
            earlier = result.get("warnings", ())
            known = [*earlier] if isinstance(earlier, Sequence) else []
            new = [sentence for sentence in self.warnings if sentence not in known]
            whole = {**result, "warnings": [*known, *new]}
            _write(sys.stdout, json.dumps(_plain(whole), allow_nan=False))

    def error(self, sentence: str) -> None:
        """Tell on stderr what went wrong."""
        self.error_text(f"rotortrack: {one_line(sentence)}")

    def error_text(self, text: str) -> None:
        """Print lines to stderr, above the progress bar if there is one."""
        if self._progress is not None:
            self._progress.console.print(
                printable(text), markup=False, highlight=False, soft_wrap=True
            )
        else:
            _write(sys.stderr, printable(text))

    @contextlib.contextmanager
    def showing_warnings(self) -> Iterator[None]:
        """Show our own warnings as one line each, the first time; hide those of other packages."""

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,  # noqa: ARG001
            lineno: int,  # noqa: ARG001
            file: TextIO | None = None,  # noqa: ARG001
            line: str | None = None,  # noqa: ARG001
        ) -> None:
            if issubclass(category, RotortrackWarning):
                self._warn(one_line(str(message)))

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", RotortrackWarning)
            warnings.showwarning = show
            yield

    def _warn(self, sentence: str) -> None:
        with self._lock:
            if sentence in self.warnings:
                return
            self.warnings.append(sentence)
        self.error(f"warning: {sentence}")

    @contextlib.contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[Advance]:
        """Show the progress of one stage: a bar on a terminal, else one line when it is done.

        Parameters
        ----------
        name
            What is being done.
        total
            How many units there are, None when unknown.
        unit
            What is counted, for example `frames`.
        """
        done = 0
        start = time.perf_counter()
        with self._bar(name, total) as show:

            def advance(count: int = 1) -> None:
                nonlocal done
                done += count
                show(count)

            yield advance
        if not self.quiet and not sys.stderr.isatty():
            counted = f"{done} {unit}, " if unit else ""
            self.error_text(f"{name}: {counted}{time.perf_counter() - start:.1f} s")

    @contextlib.contextmanager
    def _bar(self, name: str, total: int | None) -> Iterator[Advance]:
        """Show a bar of rich's, or nothing where there is no terminal."""
        if self.quiet or not sys.stderr.isatty():
            yield lambda _: None
            return
        from rich import console, progress

        columns = (
            progress.TextColumn("{task.description}", markup=False),
            progress.BarColumn(),
            progress.MofNCompleteColumn() if total else progress.TextColumn(""),
            progress.TimeElapsedColumn(),
            progress.TimeRemainingColumn(),
        )
        with progress.Progress(*columns, console=console.Console(stderr=True)) as bars:
            task = bars.add_task(one_line(name), total=total)
            self._progress = bars
            try:
                yield lambda count: bars.advance(task, count)
            finally:
                self._progress = None


def format_table(header: Sequence[str], rows: Sequence[Sequence[object]], width: int = 100) -> str:
    """Align cells in columns, numbers to the right; the last column is cut to fit the width.

    Numbers are shown with four significant digits, NaN and None as `-`.
    """
    cells = [[one_line(str(word)) for word in header]]
    cells += [[_cell(value) for value in row] for row in rows]
    numeric = [
        bool(rows) and all(row[i] is None or isinstance(row[i], Real) for row in rows)
        for i in range(len(header))
    ]
    widths = [max(len(line[i]) for line in cells) for i in range(len(header))]
    lines = []
    for line in cells:
        padded = [
            word.rjust(size) if right else word.ljust(size)
            for word, size, right in zip(line, widths, numeric, strict=True)
        ]
        text = "  ".join(padded).rstrip()
        lines.append(text if len(text) <= width else text[: width - 3].rstrip() + "...")
    return "\n".join(lines)


def _cell(value: object) -> str:
    if value is None:
        return "-"
    # Whole numbers may be too large for a float.
    if isinstance(value, Real) and not isinstance(value, Integral):
        return f"{float(value):.4g}" if math.isfinite(value) else "-"
    return one_line(str(value))


def _plain(value: Any) -> Any:
    """Reduce a value to what JSON knows; what is not a finite number becomes null."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, PurePath):
        return str(value)
    if hasattr(value, "tolist"):  # numpy's arrays and scalars, which are not imported here
        return _plain(value.tolist())
    if isinstance(value, Sequence):
        return [_plain(item) for item in value]
    raise TypeError(f"{type(value).__name__} has no form in JSON")


def _write(stream: TextIO, text: str) -> None:
    """Print text with what the stream's encoding lacks as escapes, never as a failure."""
    encoding = stream.encoding or "utf-8"
    print(text.encode(encoding, "backslashreplace").decode(encoding), file=stream, flush=True)
