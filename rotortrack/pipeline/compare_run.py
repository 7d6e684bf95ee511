"""From run folders and scans to a comparison: table, facts and pictures in a folder."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rotortrack.errors import InputError, UsageError
from rotortrack.exchange import csv, parquet
from rotortrack.files import atomic_path, make_folder
from rotortrack.pipeline.folder_runs import only
from rotortrack.pipeline.identity import Identity, identify, refuse_changed, sha256_of
from rotortrack.pipeline.localise_run import Progress, silent
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import Record
from rotortrack.pipeline.scan_run import SCAN, SHAPES, TABLE, read_scan
from rotortrack.pipeline.store import MANIFEST, RunFolder
from rotortrack.settings import Layer, resolve
from rotortrack.tables import ROTORS, Schema
from rotortrack.twocolour.compare import Comparison, compare_groups
from rotortrack.twocolour.compare_facts import facts
from rotortrack.twocolour.compare_options import CompareOptions
from rotortrack.twocolour.measured import Film, MeasuredGroup, measured_group
from rotortrack.twocolour.population import PRIOR, RodPopulation, rod_population
from rotortrack.twocolour.tables import END_TO_END, END_TO_END_ROTORS

if TYPE_CHECKING:
    import pandas as pd

UNIFORM = "uniform"
"""The prior that gives every cell of a scan the same probability."""

_USES = ("movie.mirrored", "compare")
_OF_RUN = ("movie", "screen")
_FOLDER = "comparison"


@dataclass(frozen=True)
class Compared:
    """What was compared, what JSON says of it, and the files written."""

    comparison: Comparison
    facts: dict[str, Any]
    files: list[Path]


def compare_folders(
    paths: Sequence[Path],
    target: Path | None,
    layers: list[Layer],
    *,
    pictures: Mapping[str, Callable[[Path, Comparison], None]],
    progress: Progress = silent,
) -> Compared:
    """Compare runs with each other and with scans.

    Parameters
    ----------
    paths
        A run folder, and any run folders and folders of scans.
    target
        Where the comparison goes; `comparison` in the first run when not given.
    layers
        What the user gave, above what the runs recorded.
    pictures
        Names of the figures, and what draws each into a file.
    progress
        Shows stages.

    Raises
    ------
    UsageError
        The first is a scan, one is given twice, or the target is a run or a scan.
    InputError
        A run lacks tables or rotors, or a scan rotating rods.
    ConfigurationError
        An option is wrong.
    """
    given = only(_USES, layers)
    settings = resolve(SECTIONS, given)
    options: CompareOptions = settings["compare"]
    runs, scans = _sorted(paths)
    folder = runs[0] / _FOLDER if target is None else target
    for name in (MANIFEST, SCAN):
        if (folder / name).is_file():
            raise UsageError(
                f"{folder} holds the results of a run or scan: choose another folder with -o"
            )
    if options.prior is not None and not scans:
        raise UsageError("--prior is of the cells of a scan: name the folder of a scan, too")
    record = Record("compare")
    names = _names(paths)
    progress("read", 0, len(paths))
    read = [path / file for path in runs for file in _files_of(path)]
    read += [path / file for path in scans for file in (TABLE, SHAPES)]
    if options.prior not in (None, UNIFORM):
        read.append(Path(str(options.prior)))
    groups = []
    for path in runs:
        groups.append(_read_group(names[path], path, given, options))
        progress("read", len(groups), len(paths))
    rods = {names[path]: _read_rods(path, options) for path in scans}
    inputs: list[Identity] = [identify(path) for path in read]
    hashes = [sha256_of(file) for file in inputs]
    progress("compare", 0, 0)
    with record.warnings():
        comparison = compare_groups(groups, rods, options)
    refuse_changed(inputs)
    record.options(settings, _USES)
    record.inputs(inputs, folder, hashes)
    told = {**facts(comparison), "provenance": record.provenance}
    progress("write", 0, 0)
    return Compared(comparison, told, _write(folder, comparison, told, pictures))


def _sorted(paths: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Tell runs from scans."""
    seen = [path.resolve() for path in paths]
    for number, path in enumerate(paths):
        if seen[number] in seen[:number]:
            raise UsageError(f"{path} is given twice: give each run and scan once")
    scans = [path for path in paths if (path / SCAN).is_file()]
    if paths[0] in scans:
        raise UsageError(f"{paths[0]} is a scan: name first the run that is compared with it")
    return [path for path in paths if path not in scans], scans


def _names(paths: Sequence[Path]) -> dict[Path, str]:
    """Name folders by their last part, or whole where that is shared."""
    last = [path.resolve().name for path in paths]
    return {
        path: name if last.count(name) == 1 else str(path)
        for path, name in zip(paths, last, strict=True)
    }


def _files_of(path: Path) -> list[str]:
    """Name the tables that are read of a run.

    Raises
    ------
    InputError
        It lacks one.
    """
    RunFolder.open(path)
    for schema in (END_TO_END, END_TO_END_ROTORS):
        if not (path / f"{schema.name}.parquet").is_file():
            raise InputError(
                f"{path} has no {schema.name}.parquet: film two colours and measure them with "
                "`rotortrack run --channels` or `rotortrack end-to-end`"
            )
    return [f"{schema.name}.parquet" for schema in (END_TO_END, END_TO_END_ROTORS, ROTORS)]


def _read_group(
    name: str, path: Path, given: list[Layer], options: CompareOptions
) -> MeasuredGroup:
    recorded = Record("compare").continue_from(RunFolder(path).read_manifest())
    own = [layer for layer in recorded if set(layer.values) <= set(_OF_RUN)]
    settings = resolve(SECTIONS, [*own, *given])
    movie, screen = settings["movie"], settings["screen"]
    # A movie without a recorded exposure was taken to be exposed all the time.
    exposure_s = movie.exposure_s or movie.frame_interval_s
    film = Film(
        exposure_s=math.nan if exposure_s is None else exposure_s,
        min_spread=screen.min_spread,
        mirrored={"true": True, "false": False}.get(movie.mirrored),
    )

    def table(schema: Schema) -> pd.DataFrame:
        return parquet.read_table(path / f"{schema.name}.parquet", schema)

    return measured_group(
        name,
        table(END_TO_END),
        table(END_TO_END_ROTORS),
        RunFolder(path).read(ROTORS.name),
        film,
        min_frames=options.min_frames,
    )


def _read_rods(path: Path, options: CompareOptions) -> RodPopulation:
    scan = read_scan(path)
    declared = options.prior is not None
    by_file = declared and options.prior != UNIFORM
    return rod_population(
        scan.runs,
        scan.shape_nm,
        length_nm=_length_nm(path, scan.facts),
        weights=options.weights,
        prior=csv.read_csv(Path(str(options.prior)), PRIOR) if by_file else None,
        declared=declared,
        same_nm=options.same_shape_nm,
        source=str(path),
    )


def _length_nm(path: Path, told: Any) -> float:
    try:
        length_nm = float(told["options"]["rod"]["length_nm"]["value"])
    except (KeyError, TypeError, ValueError):
        length_nm = math.nan
    if not (math.isfinite(length_nm) and length_nm > 0):
        raise InputError(f"{path / SCAN} does not tell the length of its rods: make the scan again")
    return length_nm


def _write(
    folder: Path,
    comparison: Comparison,
    told: dict[str, Any],
    pictures: Mapping[str, Callable[[Path, Comparison], None]],
) -> list[Path]:
    """Write table, facts and pictures, all or none."""
    make_folder(folder)
    files = [folder / name for name in (f"{_FOLDER}.csv", f"{_FOLDER}.json", *pictures)]
    table, text, *drawn = files
    with ExitStack() as stack:
        whole = stack.enter_context(atomic_path(text))
        temporaries = [stack.enter_context(atomic_path(path)) for path in drawn]
        for temporary, draw in zip(temporaries, pictures.values(), strict=True):
            draw(temporary, comparison)
        whole.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        csv.write_csv(table, comparison.rows)
    return files
