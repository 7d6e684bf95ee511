"""Which files belong to one recording, by its descriptions and by their names."""

from __future__ import annotations

import hashlib
import itertools
import os
import re
from collections.abc import Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath

from rotortrack.errors import MovieError
from rotortrack.movies.metadata import clean

_NUMBERED = r"(?:_(?P<number>[1-9]\d*))?"
_STACKS = (
    re.compile(rf"(?P<stem>.*_MMStack(?:_.*?)??){_NUMBERED}(?P<end>\.ome\.tiff?)"),
    re.compile(rf"(?P<stem>(?:.*_)?NDTiffStack){_NUMBERED}(?P<end>\.tif)"),
)
_NUMBER = re.compile(r"\d+")
_COMPARED_BYTES = 2**20


def members_by_name(path: Path) -> tuple[str, ...]:
    """Find a Micro-Manager set by its names, `X_MMStack.ome.tif`, `X_MMStack_1.ome.tif` and so on.

    Its newer sets are called `X_NDTiffStack.tif`, `X_NDTiffStack_1.tif` and so on.

    Returns
    -------
    tuple
        Names of all files from the first to the last that is there, missing ones between them
        included; none where the file stands alone.
    """
    found = next((match for stack in _STACKS if (match := stack.fullmatch(path.name))), None)
    if found is None:
        return ()
    stem, end = found["stem"], found["end"]
    if found["number"] is not None and not path.with_name(stem + end).exists():
        # A position may itself be called by a number.
        stem = f"{stem}_{found['number']}"
    pattern = re.compile(re.escape(stem) + r"_([1-9]\d{0,5})" + re.escape(end))
    numbers = [int(match[1]) for name in _names(path.parent) if (match := pattern.fullmatch(name))]
    if not numbers:
        return ()
    return (stem + end, *(f"{stem}_{number}{end}" for number in range(1, max(numbers) + 1)))


def beside(path: Path, name: str) -> Path:
    """Give the file `name` in the folder of `path`.

    Raises
    ------
    MovieError
        The name leads out of the folder.
    """
    if name == path.name:
        return path
    other = path.parent / name if _is_plain(name) else None
    if other is None or _real(other).parent != _real(path.parent):
        raise MovieError(
            f"{path} belongs to a recording whose file {clean(name)!r} is not in its own folder: "
            "name all files of the recording, in their order"
        )
    return other


def check_distinct(paths: Sequence[Path]) -> None:
    """Refuse a file that is given twice, also by a link."""
    seen: dict[tuple[int, int], Path] = {}
    for path in paths:
        try:
            found = path.stat()
        except OSError:
            continue  # said when it is opened
        earlier = seen.setdefault((found.st_dev, found.st_ino), path)
        if earlier is not path:
            what = "is given twice" if path == earlier else f"is the same file as {earlier}"
            raise MovieError(f"{path} {what}: name each file of the recording once")


def check_copies(paths: Sequence[Path]) -> None:
    """Refuse files of the same size that begin and end with the same bytes.

    Made for files of several frames: single frames without light may well be equal.
    """
    alike: dict[int, list[Path]] = {}
    for path in paths:
        alike.setdefault(path.stat().st_size, []).append(path)
    for group in alike.values():
        if len(group) < 2:
            continue
        seen: dict[bytes, Path] = {}
        for path in group:
            earlier = seen.setdefault(_ends(path), path)
            if earlier is not path:
                raise MovieError(
                    f"{path} is a copy of {earlier}: name each file of the recording once"
                )


def check_order(paths: Sequence[Path]) -> None:
    """Refuse files whose names differ in one number alone where it does not rise."""
    texts = [str(path) for path in paths]
    parts = {tuple(_NUMBER.split(text)) for text in texts}
    numbers = [_NUMBER.findall(text) for text in texts]
    if len(parts) > 1:
        return
    differing = [
        place for place, values in enumerate(zip(*numbers, strict=True)) if len({*values}) > 1
    ]
    if len(differing) != 1:
        return
    (place,) = differing
    for before, after in itertools.pairwise(range(len(paths))):
        if int(numbers[after][place]) < int(numbers[before][place]):
            number = list(_NUMBER.finditer(texts[0]))[place]
            pattern = f"{texts[0][: number.start()]}*{texts[0][number.end() :]}"
            raise MovieError(
                f"{paths[after]} is given behind {paths[before]}, against the number in its name: "
                f"give the files in their order, such as $(ls -v {pattern})"
            )


def check_given(given: Sequence[Path], wanted: Sequence[str]) -> None:
    """Hold the files that the user gave against the set to which the first one belongs.

    Raises
    ------
    MovieError
        A file is missing, belongs to another recording, or the order is not that of the set.
    """
    names, known = {path.name for path in given}, set(wanted)
    for path in given:
        if path.name not in known:
            raise MovieError(
                f"{path} is not one of the {len(wanted)} files of the recording that {given[0]} "
                "belongs to: analyse each recording on its own"
            )
    for name in wanted:
        if name not in names:
            raise MovieError(
                f"{given[0]} belongs to a recording of {len(wanted)} files, of which "
                f"{clean(name)} is not given: name one file to have all, or all in their order"
            )
    for path, name in zip(given, wanted, strict=True):
        if path.name != name:
            raise MovieError(
                f"{path} is given where {clean(name)} follows by the order of the recording: name "
                "one file to have all of them in their order"
            )


def _names(folder: Path) -> list[str]:
    try:
        return [entry.name for entry in os.scandir(folder)]
    except OSError:
        return []


def _real(path: Path) -> Path:
    """Follow links; one that leads to itself is left, while `Path.resolve` raises."""
    return Path(os.path.realpath(path))


def _is_plain(name: str) -> bool:
    return (
        name not in ("", ".", "..")
        and "\0" not in name
        and PurePosixPath(name).name == name
        and PureWindowsPath(name).name == name
    )


def _ends(path: Path) -> bytes:
    """Digest the first and the last megabyte."""
    with path.open("rb") as file:
        start = file.read(_COMPARED_BYTES)
        file.seek(max(0, file.seek(0, os.SEEK_END) - _COMPARED_BYTES))
        return hashlib.sha256(start + file.read(_COMPARED_BYTES)).digest()
