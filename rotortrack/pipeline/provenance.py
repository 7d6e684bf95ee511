"""What made a result: versions, inputs, options with their origins, timings, warnings."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import os
import platform
import time
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rotortrack import errors
from rotortrack.errors import RotortrackWarning
from rotortrack.kernels import source_hash
from rotortrack.localise.engine import Counts
from rotortrack.pipeline.identity import Identity, describe
from rotortrack.settings import Layer, Settings

_LIBRARIES = ("rotortrack", "numpy", "scipy", "numba", "pandas", "pyarrow", "tifffile")


FIRST_FRAME = "first_frame"
"""Key of a table's provenance: the first frame of the movie that was looked at."""

RECORDED_FRAMES = "recorded_frames"
"""Key of a table's provenance: how many frames were looked at; dropped ones were not."""


_FILES_NAMED = 20

_TAKEN_OVER = {"keys": dict, "camera_maps": dict, "registration": dict, "second_inputs": list}
"""Facts that a later command on the same folder leaves as they are."""


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python, rotortrack, its sources and the libraries that numbers depend on."""
    found = {name: _version(name) for name in _LIBRARIES}
    return {"python": platform.python_version(), **found, "sources": source_hash()}


def _version(name: str) -> str:
    """Find a version without parsing all the metadata, which takes longer than their reading."""
    text = importlib.metadata.distribution(name).read_text("METADATA") or ""
    key = "Version:"
    told = next((line for line in text.splitlines() if line.startswith(key)), None)
    return told.removeprefix(key).strip() if told else importlib.metadata.version(name)


@dataclass
class Noted:
    """What was noted while one stage was at work, in a form that JSON can keep."""

    notes: list[str] = field(default_factory=list)
    warnings: list[list[str]] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Noted:
        """Read what was kept.

        Raises
        ------
        KeyError, TypeError, ValueError
            It is something else.
        """
        notes, warned, counts = (content[name] for name in ("notes", "warnings", "counts"))
        return cls(
            [str(sentence) for sentence in notes],
            [[str(name), str(sentence)] for name, sentence in warned],
            {str(name): int(count) for name, count in dict(counts).items()},
        )


class Record:
    """Collects what a run's manifest will say."""

    def __init__(self, command: str) -> None:
        self._categories: dict[str, str] = {}
        self.content: dict[str, Any] = {
            "command": command,
            "steps": [command],
            "versions": dict(versions()),
            "machine": {"system": platform.platform(), "processors": os.cpu_count()},
            "inputs": [],
            "options": {},
            "seconds": {},
            "counts": {},
            "warnings": [],
            "notes": [],
        }

    def options(self, settings: Settings, uses: Collection[str] | None = None) -> None:
        """Record options with their origin.

        Parameters
        ----------
        settings
            All options.
        uses
            Sections (`motion`) and single options (`movie.exposure_s`) that the result depends on;
            all when not given.
        """
        self.content["options"] = {
            section: chosen
            for section, values in settings.as_dict().items()
            if (
                chosen := {
                    key: {"value": value, "origin": settings.origins[f"{section}.{key}"]}
                    for key, value in values.items()
                    if uses is None or section in uses or f"{section}.{key}" in uses
                }
            )
        }

    @property
    def option_values(self) -> dict[str, dict[str, Any]]:
        """The recorded options without their origins."""
        return {
            section: {key: entry["value"] for key, entry in values.items()}
            for section, values in self.content["options"].items()
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

    def inputs(
        self, files: Sequence[Identity], folder: Path, sha256: Sequence[str] | None = None
    ) -> None:
        """Record the input files, their paths as seen from the run folder.

        Their hashes are known once they were read whole.
        """
        hashes = [""] * len(files) if sha256 is None else sha256
        self.content["inputs"] = [
            describe(file, folder, word) for file, word in zip(files, hashes, strict=True)
        ]

    @property
    def provenance(self) -> dict[str, Any]:
        """What each table repeats: all that decides its numbers, and nothing that time changes."""
        keys = (
            *("command", "steps", "versions", "camera_maps", "trace", "registration"),
            *("second_inputs", "options", "counts"),
        )
        chosen = {key: self.content[key] for key in keys if key in self.content}
        return {**chosen, "inputs": _in_short(self.content["inputs"])}

    @contextmanager
    def noting(self) -> Iterator[Noted]:
        """Collect what is noted within the block, in addition to recording it."""
        noted = Noted()
        content = self.content
        notes, warned = len(content["notes"]), len(content["warnings"])
        counts = dict(content["counts"])
        yield noted
        noted.notes += content["notes"][notes:]
        noted.warnings += [
            [self._categories[sentence], sentence] for sentence in content["warnings"][warned:]
        ]
        noted.counts |= {
            name: count for name, count in content["counts"].items() if counts.get(name) != count
        }

    def repeat(self, noted: Noted) -> None:
        """Note and warn again what a kept stage had noted when it was made."""
        for sentence in noted.notes:
            self.note(sentence)
        self.count(**noted.counts)
        for name, sentence in noted.warnings:
            category = getattr(errors, name, None)
            if isinstance(category, type) and issubclass(category, RotortrackWarning):
                warnings.warn(sentence, category, stacklevel=2)

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
                self._categories.setdefault(sentence, category.__name__)
                if issubclass(category, RotortrackWarning) and sentence not in seen:
                    seen.append(sentence)
                show(message, category, *args, **kwargs)

            warnings.showwarning = record_and_show
            yield

    def continue_from(self, manifest: dict[str, Any]) -> list[Layer]:
        """Take over what an earlier command recorded; give its chosen options as layers."""
        for key in ("inputs", "notes", "warnings", "counts", "seconds"):
            self.content[key] = manifest[key]
        for key, kind in _TAKEN_OVER.items():
            if isinstance(manifest.get(key), kind):
                self.content[key] = manifest[key]
        earlier = [step for step in manifest["steps"] if step != self.content["command"]]
        self.content["steps"] = [*earlier, self.content["command"]]
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


def _in_short(inputs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Name of many files the first, the last, and a hash over the hashes of all."""
    if len(inputs) <= _FILES_NAMED:
        return inputs
    hashes = "".join(str(entry["sha256"]) for entry in inputs)
    whole = {"files": len(inputs), "sha256_of_hashes": hashlib.sha256(hashes.encode()).hexdigest()}
    return [inputs[0], inputs[-1], whole]


def following(earlier: Mapping[str, object], now: Mapping[str, object]) -> dict[str, object]:
    """Chain what made a table behind what had made its input, the latest step in front."""
    of_the_movie = {key: earlier[key] for key in (FIRST_FRAME, RECORDED_FRAMES) if key in earlier}
    before = {key: value for key, value in earlier.items() if key != "history"}
    history = earlier.get("history")
    steps = [*(history if isinstance(history, list) else []), *([before] if before else [])]
    return {**of_the_movie, **now, "history": steps}
