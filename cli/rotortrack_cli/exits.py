"""The exit codes of the command line, each with the sentence of the documentation."""

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
    RESOURCES = 7
    INTERRUPTED = 130
    READER_GONE = 141
    TERMINATED = 143

    @property
    def sentence(self) -> str:
        """What the code tells the caller."""
        return _SENTENCES[self]


_SENTENCES = {
    Exit.DONE: "The work is done.",
    Exit.BUG: "A bug in rotortrack stopped the work; please report it.",
    Exit.USAGE: "The command, a flag or its value is not known: see --help.",
    Exit.INPUT: "An input file cannot be used.",
    Exit.CONFIGURATION: "One or more options are wrong or missing.",
    Exit.NOTHING_FOUND: "Nothing was found, and --strict asked to be told.",
    Exit.RESOURCES: "Disk, memory or permission did not allow the work to go on.",
    Exit.INTERRUPTED: "Stopped by the user (SIGINT).",
    Exit.READER_GONE: "The program that read the output closed it early (SIGPIPE).",
    Exit.TERMINATED: "Stopped by the system (SIGTERM).",
}
