"""The one decorator for compiled loops, and the cache that it keeps.

numba notices a changed kernel but not a changed callee in another file, so the cache folder is
named by a hash of all sources of the package and of the numba version. Cached kernels are machine
code that is run without question, hence the folder belongs to the user alone (mode 0700).
"""

from __future__ import annotations

import functools
import hashlib
import os
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numba
from numba.core import config as numba_config

from rotortrack.errors import KernelCacheWarning

_Function = TypeVar("_Function", bound=Callable[..., object])


def kernel(function: _Function) -> _Function:
    """Compile a function of arrays and numbers: cached, without the GIL, numpy's division.

    Fused multiply-add is allowed (`contract`), nothing that changes how NaN behaves.
    """
    folder = cache_folder()
    compile_ = functools.partial(
        numba.njit, nogil=True, error_model="numpy", fastmath={"contract"}
    )
    if folder is None:
        compiled: _Function = compile_()(function)
        return compiled
    # numba reads the folder when the function is decorated; other packages keep their own.
    other_folder, numba_config.CACHE_DIR = numba_config.CACHE_DIR, str(folder)
    try:
        cached: _Function = compile_(cache=True)(function)
    finally:
        numba_config.CACHE_DIR = other_folder
    return cached


@functools.cache
def cache_folder() -> Path | None:
    """Return the folder of compiled kernels, or None when it cannot be kept.

    Warns
    -----
    KernelCacheWarning
        Once a process, when the folder cannot be made, written or trusted.
    """
    folder = _user_cache() / f"kernels-{source_hash()}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
        if os.name == "posix" and (
            status.st_uid != os.geteuid() or stat.S_IMODE(status.st_mode) & 0o077
        ):
            raise PermissionError(f"{folder} is open to other users")
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        warnings.warn(
            f"compiled kernels cannot be kept in {folder} ({error}), so every start takes some "
            "seconds longer: set ROTORTRACK_CACHE_DIR to a folder of your own",
            KernelCacheWarning,
            stacklevel=2,
        )
        return None
    return folder


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
