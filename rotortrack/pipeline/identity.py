"""Which files a run works on, known before and after they are read.

A movie of 20 GB is recognised in a millisecond by its size, its time and its first and last
megabyte; its SHA-256, which proves that no byte changed, is taken while the frames are read, when
its bytes lie in memory anyway.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rotortrack.errors import InputError

HEAD = 16
"""Letters of `Identity.edges` that tell of the beginning of a file."""

_EDGE_BYTES = 2**20
_CHUNK_BYTES = 4 * 2**20


@dataclass(frozen=True)
class Identity:
    """What tells one file from another without reading it.

    Attributes
    ----------
    path
        The file.
    size_bytes, modified_ns
        Its size and the time of its last change.
    edges
        Hash of its first megabyte, `HEAD` letters long, and of its last one.
    """

    path: Path
    size_bytes: int
    modified_ns: int
    edges: str

    @property
    def key(self) -> list[object]:
        """What makes results of another file, or of another state of this one, unusable."""
        return [self.size_bytes, self.modified_ns, self.edges]


def identify(path: Path) -> Identity:
    """Look at the edges of a file.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    try:
        # A pipe would keep whoever opens it waiting.
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is not a file: give the path of one file")
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            head = hashlib.blake2b(file.read(_EDGE_BYTES), digest_size=HEAD // 2)
            file.seek(max(0, status.st_size - _EDGE_BYTES))
            tail = hashlib.blake2b(file.read(_EDGE_BYTES), digest_size=HEAD // 2)
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}): check that it is there and readable"
        ) from error
    return Identity(path, status.st_size, status.st_mtime_ns, head.hexdigest() + tail.hexdigest())


def refuse_changed(identities: Iterable[Identity]) -> None:
    """Refuse files that are no longer what they were.

    Raises
    ------
    InputError
        A file was written to, exchanged or removed since it was identified.
    """
    for before in identities:
        if identify(before.path).key != before.key:
            raise InputError(
                f"{before.path} changed while it was read: wait until its recording or copying has "
                "ended, then start again"
            )


def shown_from(path: Path, folder: Path) -> str:
    """Give the way from a folder to a file, or the whole path where there is none."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        # On Windows there is no way from one drive to another.
        return path.as_posix()


def describe(identity: Identity, folder: Path, sha256: str) -> dict[str, Any]:
    """Build a manifest's entry of an input file."""
    return {
        "path": shown_from(identity.path, folder),
        "bytes": identity.size_bytes,
        "modified_ns": identity.modified_ns,
        "edges": identity.edges,
        "sha256": sha256,
    }


class RunningHash:
    """SHA-256 of files, taken piece by piece beside other work on them.

    Parameters
    ----------
    files
        In the order in which they are read.
    """

    def __init__(self, files: Sequence[Identity]) -> None:
        self._files = files
        self._digests = [hashlib.sha256() for _ in files]
        self._total = sum(file.size_bytes for file in files)
        self._done = 0

    def advance(self, share: float) -> None:
        """Hash on until a share of all bytes (0 to 1) is done.

        Raises
        ------
        InputError
            A file can no longer be read.
        """
        goal = min(self._total, int(share * self._total))
        before = 0
        for file, digest in zip(self._files, self._digests, strict=True):
            self._hash(file, digest, self._done - before, min(goal - before, file.size_bytes))
            before += file.size_bytes

    def finish(self) -> list[str]:
        """Hash the rest and give the hash of each file."""
        self.advance(1.0)
        return [digest.hexdigest() for digest in self._digests]

    def _hash(self, file: Identity, digest: Any, start: int, stop: int) -> None:
        if start < 0 or start >= stop:
            return
        try:
            with file.path.open("rb", buffering=0) as stream:
                stream.seek(start)
                while start < stop:
                    data = stream.read(min(_CHUNK_BYTES, stop - start))
                    if not data:
                        raise InputError(f"{file.path} became shorter while it was read")
                    digest.update(data)
                    start += len(data)
                    self._done += len(data)
        except OSError as error:
            raise InputError(f"{file.path} cannot be read ({error.strerror})") from error


def sha256_of(identity: Identity) -> str:
    """Hash one file as a whole."""
    return RunningHash([identity]).finish()[0]
