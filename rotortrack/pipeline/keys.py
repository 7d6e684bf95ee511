"""Which earlier results still hold: a key for each stage of the workflow.

The key of a stage hashes its input, its options, the code that makes it and the key of the stage
before it. A result under the same key is the result that would be computed again; a changed option
or a changed line of code gives another key to its stage and to all later ones, and to none before.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import json
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rotortrack.pipeline.identity import Identity, identify
from rotortrack.settings import Settings

_LIBRARIES = ("numpy", "scipy", "numba", "pandas", "pyarrow", "tifffile")
_NOUNS = ("flags.py", "tables.py", "units.py", "kernels.py", "parallel.py")


@dataclass(frozen=True)
class Stage:
    """What the result of a stage depends on besides its input.

    Attributes
    ----------
    name
        As it is shown to the user and written on disk.
    options
        Sections (`camera`) and single options (`movie.region`).
    code
        Folders and files of the package.
    """

    name: str
    options: tuple[str, ...]
    code: tuple[str, ...]


STAGES = (
    Stage(
        "check",
        (
            *("movie.region", "movie.frames", "movie.axes", "movie.channel", "movie.z_slice"),
            *("movie.salvage", "camera"),
            *("channels.split", "channels.swapped", "channels.first_region"),
        ),
        (*_NOUNS, "movies", "cameras", "pipeline/run.py", "pipeline/checkpoints.py"),
    ),
    Stage(
        "localise",
        ("movie.pixel_size_nm", "localise"),
        ("localise", "pipeline/localise_run.py", "pipeline/localise_parts.py"),
    ),
    Stage(
        "correct",
        ("quality", "drift", "density"),
        ("corrections", "rotors", "pipeline/stages.py"),
    ),
    Stage("rotors", ("cluster", "circle", "screen"), ("motion",)),
)
"""The stages whose results are kept, in order; motion and figures are made anew each time."""

SECOND = Stage(
    "second",
    (
        *("movie.region", "movie.frames", "movie.axes", "movie.channel", "movie.z_slice"),
        *("movie.salvage", "camera", "movie.pixel_size_nm", "localise", "channels.split"),
        *("channels.swapped", "channels.second_region", "channels.second_channel"),
        "channels.second_sigma_px",
    ),
    (*STAGES[0].code, *STAGES[1].code, "pipeline/colours.py", "pipeline/second_colour.py"),
)
"""The localisations of a second colour, which stand beside those of the first."""


def stage_keys(
    files: Sequence[Identity], settings: Settings, second: Sequence[Identity] = ()
) -> dict[str, str]:
    """Give the key of every stage of a run, by its name.

    Parameters
    ----------
    files
        The movie's files.
    settings
        Resolved options; camera maps count by their content, not by their name.
    second
        Files of the second colour; none where there is one colour.
    """
    maps = settings["camera"].camera_maps
    around: list[object] = [identify(Path(maps)).key if maps else None, _versions()]
    content: list[object] = [file.key for file in files] + around
    keys: dict[str, str] = {}
    key = ""
    for stage in STAGES:
        key = keys[stage.name] = _key(stage, [*content, key], settings)
        content = []
    if second:
        keys[SECOND.name] = _key(SECOND, [file.key for file in second] + around, settings)
    return keys


def _key(stage: Stage, content: list[object], settings: Settings) -> str:
    content = [*content, stage.name, _chosen(stage, settings), _code_version(stage.code)]
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.blake2b(text.encode("utf-8", "surrogatepass"), digest_size=8).hexdigest()


def _chosen(stage: Stage, settings: Settings) -> dict[str, Any]:
    values = settings.as_dict()
    chosen: dict[str, Any] = {}
    for word in stage.options:
        section, _, name = word.partition(".")
        chosen[word] = values[section].get(name) if name else values[section]
    if "camera" in chosen:
        chosen["camera"].pop("camera_maps", None)  # their content counts, not where they lie
    return chosen


@functools.cache
def _versions() -> tuple[str, ...]:
    codecs = ""
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        codecs = importlib.metadata.version("imagecodecs")
    libraries = map(importlib.metadata.version, _LIBRARIES)
    return (platform.python_version(), platform.machine(), *libraries, codecs)


@functools.cache
def _code_version(code: tuple[str, ...]) -> str:
    """Hash the sources of some folders and files of the package."""
    package = Path(__file__).parents[1]
    digest = hashlib.blake2b(digest_size=8)
    for part in code:
        place = package / part
        for source in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(source.relative_to(package).as_posix().encode())
            digest.update(source.read_bytes())
    return digest.hexdigest()
