"""The pipeline's progress, shown as one stage of the console after the other."""

from __future__ import annotations

import contextlib
from types import TracebackType
from typing import Self

from rotortrack_cli.console import Advance, Console


class Stages:
    """A progress callback; each new stage name ends the stage before.

    Use it as a context manager, so that the last stage ends too.
    """

    def __init__(self, console: Console, unit: str = "frames") -> None:
        self._console = console
        self._unit = unit
        self._open = contextlib.ExitStack()
        self._name: str | None = None
        self._done = 0
        self._advance: Advance | None = None

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Show that `done` of `total` units (0: unknown) of a stage are done."""
        if stage != self._name:
            self._open.close()
            shown = self._console.stage(stage, total or None, self._unit if total else "")
            self._advance = self._open.enter_context(shown)
            self._name, self._done = stage, 0
        if self._advance is not None and done > self._done:
            self._advance(done - self._done)
            self._done = done

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.__exit__(kind, error, trace)
