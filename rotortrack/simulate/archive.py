"""Results of simulations as npz files, which may come from anybody: objects are never loaded."""

from __future__ import annotations

import json
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ArchiveError
from rotortrack.files import atomic_path

LARGEST_BYTES = 4_000_000_000
"""Largest array that is read, unpacked."""

_LARGEST_TEXT_BYTES = 4_000_000

_DAMAGE = (
    OSError,
    ValueError,
    EOFError,
    LookupError,
    TypeError,
    ArithmeticError,
    SyntaxError,
    RuntimeError,
    MemoryError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What zipfile, numpy and json raise for bytes that are not what they should be."""


def write_archive(
    path: Path, arrays: Mapping[str, NDArray[np.float64]], about: Mapping[str, Any]
) -> None:
    """Write arrays, and what they are as JSON, to an npz file, whole or not at all.

    Raises
    ------
    ResourceError
        The file cannot be written.
    """
    content: Any = {**arrays, "about": np.array(json.dumps(about))}
    # An open file, since numpy would add an ending to a name.
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **content)


def read_archive(
    path: Path, kind: str, dimensions: Mapping[str, int]
) -> tuple[dict[str, NDArray[np.float64]], dict[str, Any]]:
    """Read what `write_archive` wrote.

    Parameters
    ----------
    path, kind
        The npz file; what it should be, for the sentences ("a rod's run").
    dimensions
        Names of the arrays that it must hold, each with its number of dimensions.

    Returns
    -------
    arrays, about
        float64 arrays, C-contiguous; the JSON object.

    Raises
    ------
    ArchiveError
        The file is missing, is no such archive, or holds other arrays than numbers.
    """
    if path.exists() and not path.is_file():
        raise ArchiveError(f"{path} is not a file: give {kind}, an npz file")
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = {name: _read(archive, name, LARGEST_BYTES) for name in dimensions}
            about = json.loads(str(_read(archive, "about", _LARGEST_TEXT_BYTES)))
        for name, count in dimensions.items():
            if arrays[name].dtype.kind not in "iuf" or arrays[name].ndim != count:
                raise ValueError(f"{name} is not an array of numbers with {count} dimensions")
        if not isinstance(about, dict):
            raise ValueError("about is no object")
    except _DAMAGE as error:
        cause = (str(error).splitlines() or [""])[0][:200] or type(error).__name__
        plain = "".join(letter if letter.isprintable() else "?" for letter in cause)
        raise ArchiveError(f"{path} cannot be read as {kind} ({plain})") from error
    return {name: np.ascontiguousarray(a, dtype=np.float64) for name, a in arrays.items()}, about


def _read(archive: zipfile.ZipFile, name: str, largest: int) -> NDArray[Any]:
    size = archive.getinfo(f"{name}.npy").file_size
    if size > largest:
        raise ValueError(f"{name} takes {size / 1e9:.1f} GB")
    with archive.open(f"{name}.npy") as stream:
        values: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    return values
