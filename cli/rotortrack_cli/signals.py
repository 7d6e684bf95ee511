"""What the system's and the user's wish to stop does to a command."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from types import FrameType

from rotortrack_cli.exits import Exit

# Of these a system has some: closing the terminal is SIGHUP, on Windows SIGBREAK.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")

# A wrapper that hands signals on, or a terminal and its shell, tell one wish twice.
_ONE_WISH_S = 0.1


class Terminated(KeyboardInterrupt):
    """Stopped by the system; a KeyboardInterrupt so that one handler tidies up after both."""


@contextlib.contextmanager
def stoppable() -> Iterator[None]:
    """Make the first signal to stop an exception, so that work is wound down; obey the second.

    The second ends the process at once, without a word: every write is atomic, and what runs on
    holds nothing up. Signals that the caller ignores, as `nohup` does, stay ignored. Outside the
    main thread nothing is changed: the host program handles its signals.
    """
    since_s: float | None = None

    def stop(number: int, _frame: FrameType | None) -> None:
        nonlocal since_s
        by_user = number == signal.SIGINT
        if since_s is None:
            since_s = time.monotonic()
            raise KeyboardInterrupt if by_user else Terminated
        if time.monotonic() - since_s > _ONE_WISH_S:
            os._exit(Exit.INTERRUPTED if by_user else Exit.TERMINATED)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {}
    try:
        for name in _NAMES:
            number = getattr(signal, name, None)
            # None is a handler that was not made in Python and could not be put back.
            if number is not None and signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, stop)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
