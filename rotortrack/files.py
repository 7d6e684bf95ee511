"""Atomic writes: a result is either whole under its name or not there at all."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from rotortrack.errors import ResourceError

TEMPORARY_MARK = ".rotortrack-part-"


@contextlib.contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary name beside `path`; on success flush it and rename it to `path`.

    The temporary file is removed when the block raises, so an interrupted write leaves the old
    file, or none.

    Raises
    ------
    ResourceError
        The folder cannot be written, the disk is full, or permission is missing.
    """
    temporary = path.with_name(f"{path.stem}{TEMPORARY_MARK}{secrets.token_hex(4)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        _flush(temporary)
        temporary.replace(path)
        _flush_folder(path.parent)
    except OSError as error:
        if error.errno in _RESOURCE_ERRORS and _concerns(error, temporary):
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


def _flush_folder(path: Path) -> None:
    """Put the new name on the disk too, where the system can: some shares and Windows cannot."""
    with contextlib.suppress(OSError):
        _flush(path, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
