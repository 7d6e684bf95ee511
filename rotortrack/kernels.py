"""The one decorator for compiled loops, and the cache that it keeps.

numba notices a changed kernel but not a changed callee in another file, so the cache folder is
named by a hash of all sources of the package and of the numba version. Cached kernels are machine
code that is run without question, hence the folder belongs to the user alone (mode 0700). Folders
of other versions go when nobody has used them for 30 days.
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

from rotortrack.errors import KernelCacheWarning

_Function = TypeVar("_Function", bound=Callable[..., object])

_FOLDER_NAME = re.compile(r"kernels-[0-9a-f]{20}")
_UNUSED_S = 30 * 86_400.0


def kernel(function: _Function) -> _Function:
    """Compile a function of arrays and numbers: cached, without the GIL, numpy's division.

    Fused multiply-add is allowed (`contract`), nothing that changes how NaN behaves.
    """
    folder = cache_folder()
    compile_ = numba.njit(
        nogil=True, error_model="numpy", fastmath={"contract"}, cache=folder is not None
    )
    # numba reads the folder when the function is decorated; other packages keep their own.
    config: Any = numba_config
    other_folder = config.CACHE_DIR
    if folder is not None:
        config.CACHE_DIR = str(folder)
    try:
        return cast(_Function, compile_(function))
    finally:
        config.CACHE_DIR = other_folder


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
