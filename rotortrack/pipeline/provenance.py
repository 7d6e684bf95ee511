"""What made a result: versions, inputs, options with their origins, timings, warnings."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import platform
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rotortrack.errors import InputError, RotortrackWarning
from rotortrack.localise.engine import Counts
from rotortrack.settings import Layer, Settings

_LIBRARIES = ("rotortrack", "numpy", "scipy", "numba", "pandas", "pyarrow", "tifffile")


def versions() -> dict[str, str]:
    """Versions of Python, rotortrack and the libraries that numbers depend on."""
    found = {name: importlib.metadata.version(name) for name in _LIBRARIES}
    return {"python": platform.python_version(), **found}


def describe_input(path: Path, folder: Path) -> dict[str, Any]:
    """Identify an input file: path relative to the run folder, size and SHA-256.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        size = path.stat().st_size
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror})") from error
    try:
        shown = Path(os.path.relpath(path, folder))
    except ValueError:
        # On Windows there is no way from one drive to another.
        shown = path
    return {"path": shown.as_posix(), "bytes": size, "sha256": digest}


class Record:
    """Collects what a run's manifest will say."""

    def __init__(self, command: str) -> None:
        self.content: dict[str, Any] = {
            "command": command,
            "versions": versions(),
            "inputs": [],
            "options": {},
            "seconds": {},
            "counts": {},
            "warnings": [],
            "notes": [],
        }

    def options(self, settings: Settings) -> None:
        """Record every option with its origin."""
        self.content["options"] = {
            section: {
                key: {"value": value, "origin": settings.origins[f"{section}.{key}"]}
                for key, value in values.items()
            }
            for section, values in settings.as_dict().items()
        }

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Record how long a stage took."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.content["seconds"][stage] = round(time.perf_counter() - start, 4)

    def count(self, **counts: int) -> None:
        """Record how many there were of something."""
        self.content["counts"].update(counts)

    def input(self, path: Path, folder: Path) -> None:
        """Record an input file, its path as seen from the run folder."""
        self.content["inputs"].append(describe_input(path, folder))

    @contextmanager
    def warnings(self) -> Iterator[None]:
        """Record rotortrack's warnings, and let them go on to whoever shows them."""
        with warnings.catch_warnings():
            warnings.simplefilter("always", RotortrackWarning)
            show = warnings.showwarning
            seen = self.content["warnings"]

            def record_and_show(
                message: Warning | str, category: type[Warning], *args: Any, **kwargs: Any
            ) -> None:
                sentence = str(message)
                if issubclass(category, RotortrackWarning) and sentence not in seen:
                    seen.append(sentence)
                show(message, category, *args, **kwargs)

            warnings.showwarning = record_and_show
            yield

    def continue_from(self, manifest: dict[str, Any]) -> list[Layer]:
        """Take over what an earlier command recorded; give its chosen options as layers."""
        for key in ("inputs", "notes", "warnings", "counts", "seconds"):
            self.content[key] = manifest[key]
        return [
            Layer(str(entry["origin"]), {section: {key: entry["value"]}})
            for section, entries in manifest["options"].items()
            for key, entry in entries.items()
            if entry["origin"] != "default"
        ]

    def count_spots(self, frames: int, counts: Counts) -> None:
        """Record what became of a movie's candidates."""
        self.count(
            frames=frames,
            candidates=counts.candidates,
            localisations=counts.localisations,
            masked_pixels=counts.masked_pixels,
            **{
                f"{str(flag.name).lower()}_spots": count
                for flag, count in counts.flags.items()
                if count
            },
        )

    def note(self, sentence: str) -> None:
        """Record a choice that was made for the user."""
        self.content["notes"].append(sentence)

    def json(self) -> str:
        """Give the manifest's text."""
        return json.dumps(self.content, indent=2) + "\n"


def to_toml(values: dict[str, dict[str, Any]]) -> str:
    """Write sections of plain values as TOML."""
    lines = []
    for section, content in values.items():
        lines.append(f"[{section}]")
        lines.extend(f"{key} = {_toml_value(value)}" for key, value in content.items())
        lines.append("")
    return "\n".join(lines)


def _toml_value(value: Any) -> str:
    """Write a string, number, boolean or list; JSON's spelling is TOML's but for odd characters."""
    text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return text.encode("utf-8", "replace").decode("utf-8")
