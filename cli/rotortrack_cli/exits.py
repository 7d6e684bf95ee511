"""The exit codes of the command line; the README says what each tells."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    """How a command ended."""

    DONE = 0
    BUG = 1
    USAGE = 2
    INPUT = 3
    CONFIGURATION = 4
    NOTHING_FOUND = 5
    LOCKED = 6
    RESOURCES = 7
    INTERRUPTED = 130
    READER_GONE = 141
    TERMINATED = 143
