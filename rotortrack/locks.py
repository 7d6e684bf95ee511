"""One writer for each folder.

The system's own lock (`flock`) decides who works in a folder: it ends with the process that holds
it, however that ends, so neither clocks nor reused process numbers keep a dead lock alive. What
the lock file says is for people, and for computers that share the folder but not their locks.
"""

from __future__ import annotations

import contextlib
import datetime
import errno
import json
import os
import platform
import re
import secrets
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rotortrack.errors import LockedError, ResourceError

LOCK_NAME = "lock"

HOST = platform.node() or "this computer"
"""Name of this computer."""

_PATIENCE_S = 0.2
_MOST_BYTES = 4096
_MOST_LETTERS = 80
_FAR = 2**30
_UNSUPPORTED = {errno.EINVAL, errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP}
_BUSY = {errno.EACCES, errno.EAGAIN, errno.EWOULDBLOCK}

# Neither follow a link out of the folder nor wait for the other end of a pipe.
_FLAGS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


@dataclass(frozen=True)
class _Owner:
    """What a lock file says; the token tells any two locks apart.

    `by_name` where the system gave no lock, so that the process number decides.
    """

    host: str
    pid: int
    task: str
    started: str
    token: str
    by_name: bool = False

    def __str__(self) -> str:
        since = ""
        with contextlib.suppress(ValueError, OverflowError, OSError):
            when = datetime.datetime.fromisoformat(self.started).astimezone()
            since = f" since {when:%Y-%m-%d %H:%M}"
        return f"process {self.pid} on {self.host} ({self.task}{since})"


@contextlib.contextmanager
def locked(folder: Path, task: str) -> Iterator[None]:
    """Be the only writer of a folder; readers are never kept waiting.

    The file `lock` in the folder is held meanwhile and removed afterwards. One that a killed
    process of this computer left is taken over. Where the file system knows no locks, the process
    number in the file decides.

    Parameters
    ----------
    folder
        An existing folder.
    task
        What is done, such as the name of the command.

    Raises
    ------
    LockedError
        Another process or thread works in the folder, or one on another computer did not remove
        its lock.
    ResourceError
        The lock cannot be made: no such folder, no permission, no space.
    """
    started = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
    own = _Owner(HOST, os.getpid(), task[:_MOST_LETTERS], started, secrets.token_hex(8))
    path = folder / LOCK_NAME
    try:
        descriptor = _acquire(path, own)
    except OSError as error:
        raise ResourceError(
            f"{path} cannot be written ({os.strerror(error.errno or 0)}): free space, see that "
            "the folder is there and may be written and that nothing else has this name, or choose "
            "another folder with -o"
        ) from error
    try:
        yield
    finally:
        _release(descriptor, path, own)


def lock_owner(folder: Path) -> str | None:
    """Tell in one phrase who writes to a folder now; None when nobody does. Never raises."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder / LOCK_NAME, os.O_RDONLY | _FLAGS)
        try:
            free = _try_lock(descriptor, shared=True)
            owner = _read(descriptor)
        finally:
            os.close(descriptor)
        if free is False or _is_respected(owner, free):
            return str(owner or "another process")
    return None


def is_running(pid: int) -> bool:
    """Whether this computer has such a process; True where the system does not tell."""
    if sys.platform == "win32":
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def _acquire(path: Path, own: _Owner) -> int | None:
    """Hold the lock; give the open file that holds it, None where the name alone does."""
    deadline = time.monotonic() + _PATIENCE_S
    while True:
        descriptor, created, writable = _open(path)
        held = False
        try:
            free = _try_lock(descriptor)
            if free is None:
                _acquire_by_name(path, descriptor, replace(own, by_name=True), created=created)
                return None
            if not free:
                # Somebody may only be asking who the owner is, or be about to remove the lock.
                if time.monotonic() > deadline:
                    raise _refusal(path, _read(descriptor), free)
                time.sleep(_PATIENCE_S / 20)
            elif _is_at(descriptor, path):
                found = _read(descriptor)
                if _is_respected(found, free):
                    raise _refusal(path, found, free)
                if writable:
                    _write(path, descriptor, own)
                    held = True
                    return descriptor
                path.unlink()  # left by a dead process of another user
        finally:
            if not held:
                os.close(descriptor)


def _acquire_by_name(path: Path, descriptor: int, own: _Owner, *, created: bool) -> None:
    """Hold the lock by having made its file, or by succeeding a process that is gone.

    The file that a successor makes is named after the lock it replaces, so that of several
    would-be successors one alone replaces it, and never the lock of another successor.
    """
    if created:
        _write(path, descriptor, own)
        return
    found = _read(descriptor)
    if found is None or _is_respected(found, None):
        raise _refusal(path, found, None)
    heir = path.with_name(f"{path.name}-{found.token}")
    try:
        mine = os.open(heir, os.O_RDWR | os.O_CREAT | os.O_EXCL | _FLAGS, 0o666)
    except FileExistsError:
        raise _refusal(path, None, None) from None
    try:
        _write(heir, mine, own)
    finally:
        os.close(mine)
    if _read_at(path) != found:
        heir.unlink()
        raise _refusal(path, None, None)
    heir.replace(path)


def _release(descriptor: int | None, path: Path, own: _Owner) -> None:
    """Remove the lock file, then the lock; Windows removes no file that is open."""
    if sys.platform == "win32" and descriptor is not None:
        os.close(descriptor)
        descriptor = None
    with contextlib.suppress(OSError):
        found = _read_at(path)
        if found is not None and found.token == own.token:
            path.unlink()
    if descriptor is not None:
        os.close(descriptor)


def _open(path: Path) -> tuple[int, bool, bool]:
    """Open the lock file: its descriptor, whether it is new, and whether it can be written."""
    while True:
        with contextlib.suppress(FileExistsError):
            return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | _FLAGS, 0o666), True, True
        with contextlib.suppress(FileNotFoundError):  # removed by its owner in between
            try:
                descriptor, writable = os.open(path, os.O_RDWR | _FLAGS), True
            except PermissionError:
                descriptor, writable = os.open(path, os.O_RDONLY | _FLAGS), False
            return descriptor, False, writable


def _try_lock(descriptor: int, *, shared: bool = False) -> bool | None:
    """Ask for the system's lock: True is had, False another has it, None there is no such thing."""
    if sys.platform == "win32":
        import msvcrt

        # Locked bytes cannot be read by others, so they lie far behind the text.
        os.lseek(descriptor, _FAR, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
    import fcntl

    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _UNSUPPORTED:
            return None
        if error.errno in _BUSY:
            return False
        raise
    return True


def _is_at(descriptor: int, path: Path) -> bool:
    """Whether an open file still has its name; its owner may have removed it."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    except FileNotFoundError:
        return False


def _is_respected(owner: _Owner | None, free: bool | None) -> bool:
    """Whether a lock that is not held may still be somebody's."""
    if owner is None:
        return free is None
    by_name = owner.by_name or free is None
    return owner.host != HOST or (by_name and is_running(owner.pid))


def _refusal(path: Path, owner: _Owner | None, free: bool | None) -> LockedError:
    doubt = "" if free is False else f"; if nothing is at work there any more, delete {path}"
    return LockedError(
        f"{path.parent} is being written by {owner or 'another process'}: wait until that ends, or "
        f"choose another folder with -o{doubt}"
    )


def _write(path: Path, descriptor: int, owner: _Owner) -> None:
    """Put the owner into a lock file, or remove it when that fails."""
    try:
        os.lseek(descriptor, 0, os.SEEK_SET)
        text = json.dumps(asdict(owner)).encode() + b"\n"
        os.ftruncate(descriptor, 0)
        if os.write(descriptor, text) != len(text):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except OSError:
        with contextlib.suppress(OSError):
            path.unlink()
        raise


def _read_at(path: Path) -> _Owner | None:
    try:
        descriptor = os.open(path, os.O_RDONLY | _FLAGS)
    except FileNotFoundError:
        return None
    try:
        return _read(descriptor)
    finally:
        os.close(descriptor)


def _read(descriptor: int) -> _Owner | None:
    """Read who the owner is; None for any text but that of `_write`. A pipe is an OSError."""
    os.lseek(descriptor, 0, os.SEEK_SET)
    with contextlib.suppress(ValueError, RecursionError, TypeError):
        said: dict[str, Any] = json.loads(os.read(descriptor, _MOST_BYTES))
        owner = _Owner(**said)
        words = [said[name] for name in ("host", "task", "started", "token")]
        if (
            all(isinstance(word, str) and len(word) <= 4 * _MOST_LETTERS for word in words)
            and type(said["pid"]) is int
            and isinstance(said.get("by_name", False), bool)
            and 0 < owner.pid < 2**31
            and re.fullmatch("[0-9a-f]{16}", owner.token)
        ):
            return owner
    return None
