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

            def record_and_show(
                message: Warning | str, category: type[Warning], *args: Any, **kwargs: Any
            ) -> None:
                if issubclass(category, RotortrackWarning):
                    self.content["warnings"].append(str(message))
                show(message, category, *args, **kwargs)

            warnings.showwarning = record_and_show
            yield

    def continue_from(self, manifest: dict[str, Any], origin: str) -> list[Layer]:
        """Take over what an earlier command recorded; give its chosen options as layers.

        Raises
        ------
        InputError
            The manifest is not one of ours.
        """
        try:
            for key in ("inputs", "notes", "warnings"):
                self.content[key] = list(manifest[key])
            for key in ("counts", "seconds"):
                self.content[key] = dict(manifest[key])
            return [
                Layer(f"{origin} ({entry['origin']})", {section: {key: entry["value"]}})
                for section, entries in manifest["options"].items()
                for key, entry in entries.items()
                if entry["origin"] != "default"
            ]
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise InputError(
                f"{origin} is not a manifest of this program ({error!r}): make the run again"
            ) from error

    def note(self, sentence: str) -> None:
        """Record a choice that was made for the user."""
        self.content["notes"].append(sentence)

    def json(self) -> str:
        """Give the manifest's text."""
        return json.dumps(self.content, indent=2, ensure_ascii=False) + "\n"


def to_toml(values: dict[str, dict[str, Any]]) -> str:
    """Write sections of plain values as TOML."""
    lines = []
    for section, content in values.items():
        lines.append(f"[{section}]")
        # JSON's spelling of strings, numbers, booleans and lists is valid TOML.
        lines.extend(f"{key} = {json.dumps(value)}" for key, value in content.items())
        lines.append("")
    return "\n".join(lines)
