"""The one decorator for compiled loops, and the cache that it keeps.

numba notices a changed kernel but not a changed callee in another file, so the cache folder is
named by a hash of all sources of the package and of the numba version. Cached kernels are machine
code that is run without question, hence the folder belongs to the user alone (mode 0700). Folders
of other versions go when nobody has used them for 30 days.

A start costs no more than what is used: a kernel looks for its files when it is first called, and
numba's compiler, which loads scipy, stays away while all kernels are found.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
import shutil
import stat
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import config as numba_config
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys

from rotortrack.errors import KernelCacheWarning

_Function = TypeVar("_Function", bound=Callable[..., object])

_FOLDER_NAME = re.compile(r"kernels-[0-9a-f]{20}")
_UNUSED_S = 30 * 86_400.0


def kernel(function: _Function) -> _Function:
    """Compile a function of arrays and numbers: cached, without the GIL, numpy's division.

    Fused multiply-add is allowed (`contract`), nothing that changes how NaN behaves.
    """
    dispatcher: Any = numba.njit(nogil=True, error_model="numpy", fastmath={"contract"})(function)
    dispatcher._cache = _LateCache(dispatcher._cache, function)
    return cast(_Function, dispatcher)


class _LateCache:
    """Numba's cache of one kernel, opened when the kernel is first called or compiled.

    Most kernels are part of the machine code of others and are never asked for by themselves.
    """

    def __init__(self, none: Any, function: Callable[..., object]) -> None:
        self._none = none
        self._function = function

    @functools.cached_property
    def _cache(self) -> Any:
        folder = cache_folder()
        if folder is None:
            return self._none
        # numba reads the folder when a cache is made; other packages keep their own.
        config: Any = numba_config
        other_folder = config.CACHE_DIR
        config.CACHE_DIR = str(folder)
        try:
            return cast(Any, _LeanCache)(self._function)
        finally:
            config.CACHE_DIR = other_folder

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)


class _LeanCache(FunctionCache):
    """Numba's cache, without what a compiler needs and machine code does not."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a compiled kernel; None when there is none."""
        # numba would prepare the whole compiler here. Code that runs needs its memory manager
        # alone, and whoever compiles after all prepares the rest.
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return cast(Any, super())._load_overload(sig, target_context)


@functools.cache
def cache_folder() -> Path | None:
    """Return the folder of compiled kernels, or None when it cannot be kept.

    Warns
    -----
    KernelCacheWarning
        Once a process, when the folder cannot be made, written or trusted.
    """
    folder = cache_path()
    try:
        is_new = not folder.exists()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.name == "posix":
            _refuse_open_to_others(folder)
        with tempfile.TemporaryFile(dir=folder):
            pass
        # Its time of change tells the versions of other days that this one is in use.
        os.utime(folder)
    except OSError as error:
        warnings.warn(
            f"compiled kernels cannot be kept in {folder} ({error}), so every start takes some "
            "seconds longer: set ROTORTRACK_CACHE_DIR to a folder of your own",
            KernelCacheWarning,
            stacklevel=2,
        )
        return None
    if is_new:
        _sweep(folder)
    return folder


def cache_path() -> Path:
    """Return where the compiled kernels of this version belong, whether or not they can be kept."""
    return _user_cache() / f"kernels-{source_hash()}"


def count_compiled(folder: Path) -> int:
    """Count the kernels of which `folder` keeps a compiled form."""
    return sum(1 for _ in folder.rglob("*.nbi"))


def _sweep(folder: Path) -> None:
    """Remove the folders beside `folder` that kept kernels and that nobody used for 30 days.

    What has another name or is a link stays, and so does what cannot be removed.
    """
    oldest = time.time() - _UNUSED_S
    with contextlib.suppress(OSError):
        for other in folder.parent.iterdir():
            if other == folder or not _FOLDER_NAME.fullmatch(other.name):
                continue
            with contextlib.suppress(OSError):
                status = other.lstat()
                if stat.S_ISDIR(status.st_mode) and status.st_mtime < oldest:
                    shutil.rmtree(other, ignore_errors=True)


def _refuse_open_to_others(folder: Path) -> None:
    """Raise when somebody else could have put kernels into the folder or exchange it."""
    own = folder.stat()
    if own.st_uid != os.geteuid() or own.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise PermissionError("it is open to other users")
    above = folder.parent.stat()
    if above.st_mode & stat.S_IWOTH and not above.st_mode & stat.S_ISVTX:
        raise PermissionError(f"{folder.parent} is open to other users")


@functools.cache
def source_hash() -> str:
    """Hash the package's sources with the numba and Python versions."""
    package = Path(__file__).parent
    digest = hashlib.blake2b(digest_size=10)
    digest.update(f"{numba.__version__} {sys.version}".encode())
    for source in sorted(package.rglob("*.py")):
        digest.update(source.relative_to(package).as_posix().encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()


def _user_cache() -> Path:
    given = os.environ.get("ROTORTRACK_CACHE_DIR")
    if given:
        return Path(given)
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "rotortrack"
