"""Camera maps in an npz file, which may come from anybody: pickled objects are never loaded."""

from __future__ import annotations

import json
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import CameraError
from rotortrack.files import atomic_path

_LARGEST_MAP_BYTES = 64_000_000 * 8 + 10_000
"""64 megapixels of float64, the largest frame that movies have unless they are told otherwise."""

_LONGEST_TEXT_BYTES = 4_000_000

_ONE_ARRAY = b"\x93NUMPY"

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
"""What zipfile and numpy raise for bytes that are not a whole archive of arrays."""


def read_arrays(
    path: Path, names: Iterable[str], *, masks: Collection[str] = ()
) -> dict[str, NDArray[np.float64]]:
    """Load the arrays of some names that a file has.

    Parameters
    ----------
    path
        The npz file.
    names
        Arrays to look for; others are left alone.
    masks
        Those of them that may be saved as true and false.

    Raises
    ------
    CameraError
        The file cannot be read, is no npz file, or holds arrays that are not numbers or larger
        than a camera.
    """
    names = list(names)
    if path.exists() and not path.is_file():
        raise CameraError(f"{path} is not a file: give an npz file of camera maps")
    try:
        with path.open("rb") as stream:
            if stream.read(len(_ONE_ARRAY)) == _ONE_ARRAY:
                raise ValueError("it holds one array, not arrays by name")
        with zipfile.ZipFile(path) as archive:
            found = [name for name in names if f"{name}.npy" in archive.namelist()]
            maps = {name: _read(archive, name, path) for name in found}
    except _DAMAGE as error:
        cause = (str(error).splitlines() or [""])[0][:200] or type(error).__name__
        plain = "".join(letter if letter.isprintable() else "?" for letter in cause)
        raise CameraError(
            f"{path} cannot be read as camera maps ({plain}): give an npz file with the "
            f"arrays {', '.join(names)}"
        ) from error
    for name, values in maps.items():
        if values.dtype.kind not in ("biuf" if name in masks else "iuf"):
            raise CameraError(f"{path}: {name} is {values.dtype.name}: save it as numbers")
    return {name: values.astype(np.float64)[()] for name, values in maps.items()}


def read_provenance(path: Path) -> dict[str, Any]:
    """Tell how a file of maps was made, as far as it says; what cannot be read says nothing."""
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.getinfo("provenance.npy").file_size > _LONGEST_TEXT_BYTES:
                return {}
            found = json.loads(str(_read(archive, "provenance", path)))
    except _DAMAGE:
        return {}
    return found if isinstance(found, dict) else {}


def write_maps(
    path: Path, arrays: Mapping[str, NDArray[Any]], provenance: Mapping[str, Any]
) -> None:
    """Write maps and how they were made as an npz file, whole or not at all.

    Raises
    ------
    ResourceError
        The file cannot be written.
    """
    content: Any = {**arrays, "provenance": np.array(json.dumps(provenance, default=str))}
    # An open file, since numpy would add an ending to a name.
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **content)


def _read(archive: zipfile.ZipFile, name: str, path: Path) -> NDArray[Any]:
    size = archive.getinfo(f"{name}.npy").file_size
    if size > _LARGEST_MAP_BYTES:
        raise CameraError(
            f"{path}: {name} takes {size / 1e6:.0f} MB, more than a map of 64 megapixels: cut it "
            "to the region of the sensor that was recorded"
        )
    with archive.open(f"{name}.npy") as stream:
        values: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    return values
