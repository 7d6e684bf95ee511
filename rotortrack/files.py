"""Writing to folders: a result is whole under its name or not there, and one process writes."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import itertools
import os
import re
import secrets
import time
from collections.abc import Iterator
from pathlib import Path

from rotortrack.errors import ResourceError
from rotortrack.locks import HOST, is_running, lock_owner, locked

__all__ = [
    "atomic_path",
    "flush_folder",
    "lock_owner",
    "locked",
    "make_folder",
    "sweep",
    "write_text",
]

TEMPORARY_MARK = ".rotortrack-part-"

_HOST_MARK = hashlib.sha256(HOST.encode("utf-8", "replace")).hexdigest()[:8]
_PROCESS_MARK = secrets.token_hex(4)
_NUMBER = itertools.count()
_OLD_S = 3 * 86400.0
_LEFTOVER = re.compile(
    rf"(?s:.*){re.escape(TEMPORARY_MARK)}"
    r"(?P<host>[0-9a-f]{8})-(?P<pid>[0-9]{1,10})-(?P<process>[0-9a-f]{8})-[0-9]+(\.[^.]*)?"
)


@contextlib.contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary name beside `path`; on success flush it and rename it to `path`.

    The temporary file is removed when the block raises, so an interrupted write leaves the old
    file, or none. A link under the name is replaced, not followed: a folder from elsewhere must
    not lead a write out of itself.

    Raises
    ------
    ResourceError
        The folder cannot be written, a folder has the name, the disk is full, or permission is
        missing.
    """
    temporary = _temporary(path)
    try:
        if path.is_dir() and not path.is_symlink():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(temporary))
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        _flush(temporary)
        temporary.replace(path)
        flush_folder(path.parent)
    except OSError as error:
        if _concerns(error, temporary) and (
            error.errno in _RESOURCE_ERRORS or not path.parent.is_dir()
        ):
            raise ResourceError(
                f"{path} cannot be written ({os.strerror(error.errno or 0)}): free space, or "
                "choose another folder with -o"
            ) from error
        raise
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, where it is not there yet.

    Raises
    ------
    ResourceError
        A file is in the way, or the place cannot be written.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResourceError(
            f"{path} cannot be made a folder ({error.strerror}): free space, move what is in its "
            "way, or choose another folder with -o"
        ) from error


def sweep(folder: Path) -> int:
    """Remove what interrupted writes left in a folder, and count it.

    A leftover's name tells the computer and the process that made it. Those of running processes
    and of other computers stay, until they are days old. Folders within are not looked into.
    """
    swept = 0
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            match = _LEFTOVER.fullmatch(entry.name)
            if match is None or not entry.is_file(follow_symlinks=False):
                continue
            with contextlib.suppress(OSError):
                if _is_abandoned(match, entry.stat(follow_symlinks=False).st_mtime):
                    Path(entry).unlink()
                    swept += 1
    return swept


def flush_folder(path: Path) -> None:
    """Put new names on the disk too, where the system can: some shares and Windows cannot."""
    with contextlib.suppress(OSError):
        _flush(path, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))


_RESOURCE_ERRORS = {
    errno.EACCES,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EIO,
    errno.EISDIR,
    errno.EEXIST,
    errno.ENAMETOOLONG,
    errno.ENOSPC,
    errno.ENOTDIR,
    errno.EPERM,
    errno.EROFS,
}


def _temporary(path: Path) -> Path:
    """Name a file that says who made it; a name that is long already stays within the limit."""
    mark = f"{_HOST_MARK}-{os.getpid()}-{_PROCESS_MARK}-{next(_NUMBER)}"
    return path.with_name(f"{path.stem[:40]}{TEMPORARY_MARK}{mark}{path.suffix}")


def _is_abandoned(leftover: re.Match[str], modified_s: float) -> bool:
    """Whether the process that made a leftover is gone."""
    pid, ours = int(leftover["pid"]), leftover["process"] == _PROCESS_MARK
    if ours and pid == os.getpid():
        return False
    if leftover["host"] == _HOST_MARK and (pid == os.getpid() or not is_running(pid)):
        return True
    return time.time() - modified_s > _OLD_S


def _concerns(error: OSError, temporary: Path) -> bool:
    """Whether the failure is about the file being written and not one that the block reads."""
    if not isinstance(error.filename, str | bytes):
        return True
    return Path(os.fsdecode(error.filename)) in (temporary, *temporary.parents)


def _flush(path: Path, flags: int = os.O_RDWR) -> None:
    """Ask the system to put a file's or folder's content on the disk."""
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
