"""A finished run made again from its manifest, and compared with itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rotortrack.errors import InputError
from rotortrack.files import write_text
from rotortrack.pipeline.folder_runs import motion_of_run, rotors_from_table
from rotortrack.pipeline.identity import identify
from rotortrack.pipeline.localise_run import Progress, silent
from rotortrack.pipeline.provenance import versions
from rotortrack.pipeline.run import run_movie
from rotortrack.pipeline.store import REGISTRATION, RunFolder
from rotortrack.rotors.curation import FILE_NAME, read_curation
from rotortrack.settings import Layer, read_content

if TYPE_CHECKING:
    import pandas as pd

TOLERANCE = 1e-6
"""Relative difference that another machine or version may cause."""


@dataclass(frozen=True)
class Comparison:
    """How a table differs from its earlier self.

    Attributes
    ----------
    table
        Its name.
    rows, earlier_rows
        Rows now and then.
    worst_column, difference
        Where numbers differ most, and by how much relative to the largest of them; 0 where all are
        identical to the last bit, infinite where columns, rows or texts differ.
    """

    table: str
    rows: int
    earlier_rows: int
    worst_column: str
    difference: float

    @property
    def sentence(self) -> str:
        """Say it in words."""
        if self.difference == 0:
            return f"{self.table}: {self.rows} rows, identical"
        if self.rows != self.earlier_rows:
            return f"{self.table}: {self.rows} rows instead of {self.earlier_rows}"
        how_much = f"by {self.difference:.1g}" if np.isfinite(self.difference) else "altogether"
        return f"{self.table}: {self.rows} rows, {self.worst_column} differs {how_much}"


@dataclass(frozen=True)
class Reproduction:
    """The tables of both runs, compared, and the versions that changed."""

    comparisons: tuple[Comparison, ...]
    versions: dict[str, tuple[str, str]]

    @property
    def identical(self) -> bool:
        """Whether every number is the same to the last bit."""
        return all(comparison.difference == 0 for comparison in self.comparisons)

    @property
    def agrees(self) -> bool:
        """Whether no number differs by more than rounding."""
        return all(comparison.difference <= TOLERANCE for comparison in self.comparisons)


def reproduce(
    run: Path,
    target: Path,
    *,
    paths: Sequence[Path] = (),
    workers: int | None = None,
    progress: Progress = silent,
) -> Reproduction:
    """Repeat a run with its recorded options and compare all tables.

    Parameters
    ----------
    run
        The finished run.
    target
        Folder of the repetition.
    paths
        Where its inputs lie now, if not where they lay.
    workers, progress
        As everywhere.

    Raises
    ------
    InputError
        The run is not finished, or an input is not the file that it was made from.
    ConfigurationError
        It records options that this version does not have.
    """
    folder = RunFolder.open(run)
    manifest = folder.read_manifest()
    if target.resolve() == run.resolve():
        raise InputError(f"{run} cannot be repeated into itself: choose another folder with -o")
    inputs = _inputs(run, manifest, paths)
    said, saying = run / FILE_NAME, target / FILE_NAME
    if read_curation(said) and not saying.exists():
        write_text(saying, read_content(said).decode())
    layers = _layers(manifest)
    if "registration" in manifest:
        kept = {"channels": {"registration": str((run / REGISTRATION).absolute())}}
        layers.append(Layer("the run's own copy", kept))
    steps = manifest["steps"]
    recorded = manifest.get("trace")
    trace = (run / str(recorded.get("path", ""))).resolve() if isinstance(recorded, dict) else None
    if steps[:1] == ["run"]:
        result = run_movie(inputs, layers, target, workers=workers, progress=progress)
        if trace is not None:
            result = motion_of_run(target, [], trace=trace, progress=progress)
    else:
        result = rotors_from_table(inputs[0], layers, target, progress=progress)
        if "motion" in steps:
            result = motion_of_run(target, [], trace=trace, progress=progress)
    again = RunFolder(target)
    new = again.read_manifest()
    _require_same_hashes(run, _read_files(manifest), _read_files(result.record.content))
    names = [*sorted({*manifest["tables"], *new["tables"]} - {"drift"}), "drift"]
    return Reproduction(
        tuple(compare(name, folder.read(name), again.read(name)) for name in names),
        {
            name: (str(manifest["versions"].get(name)), version)
            for name, version in versions().items()
            if manifest["versions"].get(name) != version
        },
    )


def compare(name: str, earlier: pd.DataFrame, now: pd.DataFrame) -> Comparison:
    """Compare two tables column by column."""
    worst, difference = "", 0.0
    if len(earlier) != len(now) or set(earlier) != set(now):
        stray = sorted(map(str, set(earlier) ^ set(now)))
        return Comparison(name, len(now), len(earlier), (stray or ["rows"])[0], np.inf)
    for column in earlier:
        found = _difference(earlier[column], now[column])
        if found > difference:
            worst, difference = str(column), found
    return Comparison(name, len(now), len(earlier), worst, difference)


def _difference(earlier: pd.Series[Any], now: pd.Series[Any]) -> float:
    """Largest difference of two columns, relative to their largest number."""
    if earlier.equals(now):
        return 0.0
    first, second = earlier.to_numpy(), now.to_numpy()
    if first.dtype.kind not in "iuf" or second.dtype.kind not in "iuf":
        return np.inf
    first, second = first.astype(float), second.astype(float)
    if not np.array_equal(np.isfinite(first), np.isfinite(second)):
        return np.inf
    finite = np.isfinite(first)
    largest = np.abs(first[finite]).max(initial=np.finfo(float).tiny)
    return float(np.abs(first[finite] - second[finite]).max(initial=0.0) / largest)


def _inputs(run: Path, manifest: dict[str, Any], paths: Sequence[Path]) -> list[Path]:
    """Find the files of the run and check that they can be the same ones."""
    entries = manifest["inputs"]
    if not entries or not manifest["steps"]:
        raise InputError(f"{run} does not record what it was made from: make the run again")
    if paths and len(paths) != len(entries):
        raise InputError(f"{run} was made from {len(entries)} file(s), not from {len(paths)}")
    found = list(paths) or [(run / str(entry.get("path", ""))).resolve() for entry in entries]
    for path, entry in zip(found, entries, strict=True):
        if not path.is_file():
            raise InputError(
                f"{path}, which {run} was made from, is not there: say where it is, as in "
                "`rotortrack run MOVIE --reproduce RUN`"
            )
        if identify(path).size_bytes != entry.get("bytes"):
            raise InputError(f"{path} is not the file that {run} was made from: its size differs")
    return found


def _layers(manifest: dict[str, Any]) -> list[Layer]:
    """Give every recorded option, defaults too: they may be others in this version."""
    return [
        Layer(str(entry["origin"]), {section: {key: entry["value"]}})
        for section, entries in manifest["options"].items()
        for key, entry in entries.items()
    ]


def _read_files(content: dict[str, Any]) -> list[dict[str, Any]]:
    """List the entries of all files that a run was made from."""
    beside = (content.get(key) for key in ("camera_maps", "registration"))
    second = content.get("second_inputs")
    return [
        *content["inputs"],
        *(second if isinstance(second, list) else []),
        *(entry for entry in beside if isinstance(entry, dict)),
    ]


def _require_same_hashes(run: Path, earlier: list[Any], now: list[Any]) -> None:
    for before, after in zip(earlier, now, strict=False):
        if before.get("sha256") != after["sha256"]:
            raise InputError(
                f"{after['path']} is not the file that {run} was made from: its SHA-256 differs"
            )
