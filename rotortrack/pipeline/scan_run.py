"""A scan as a folder: runs.parquet, shapes.npz and scan.json, resumable run by run.

    scan.json        state, options with their origins, field, versions, ends counted, times
    runs.parquet     one row a run, units and options inside
    shapes.npz       run, shape_nm (final positions), time_us and turned_rad (angle over time)
    parts/scan-KEY/  runs of a scan that is not finished

A scan that was interrupted goes on where it was and ends with the same table and shapes to the last
byte: only scan.json tells of time.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import shutil
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotortrack import files
from rotortrack.errors import InputError, UsageError
from rotortrack.exchange import parquet
from rotortrack.parallel import default_workers, map_ordered
from rotortrack.pipeline.localise_run import Progress, silent
from rotortrack.pipeline.manifest import COMPLETE, UNFINISHED, read_json, write_out
from rotortrack.pipeline.provenance import Record
from rotortrack.pipeline.scan_parts import (
    DIMENSIONS,
    FOLDER,
    arrays_of,
    read_parts,
    write_part,
)
from rotortrack.simulate.archive import read_archive, write_archive
from rotortrack.simulate.rod.ends import RodEnd
from rotortrack.simulate.rod.parameters import rod_parameters
from rotortrack.simulate.scan import (
    FAILED,
    RunResult,
    ScanRun,
    planned_runs,
    runs_table,
    simulate_run,
)
from rotortrack.simulate.tables import RUNS

if TYPE_CHECKING:
    import pandas as pd

    from rotortrack.simulate.scene import Scene
    from rotortrack.simulate.scene_field import SceneField

SCAN, TABLE, SHAPES = "scan.json", "runs.parquet", "shapes.npz"

_KEPT_EVERY_S = 5.0
_MOST_IN_PART = 64
_AHEAD = 8


@dataclass(frozen=True)
class Scan:
    """A finished scan.

    Attributes
    ----------
    runs
        Table of schema `RUNS`.
    shape_nm
        Final positions of the vertices, shape (runs, vertices, 3).
    time_us, turned_rad
        Angle over time, shape (runs, points).
    facts
        scan.json.
    """

    runs: pd.DataFrame
    shape_nm: NDArray[np.float64]
    time_us: NDArray[np.float64]
    turned_rad: NDArray[np.float64]
    facts: Mapping[str, Any]


def run_scan(
    scene: Scene,
    field: SceneField | None,
    folder: Path,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Scan:
    """Simulate the runs of a scan that the folder does not hold yet.

    Parameters
    ----------
    scene
        With rod and scan.
    field
        Its field, None where the scene has none.
    folder
        Where the results go; made where it is missing.
    workers
        Processors to use; all when not given. The result does not depend on it.
    executor
        Any `concurrent.futures` executor with that many workers; threads when not given.
    overwrite
        Replace the results of another scan.
    progress
        Shows stages.

    Raises
    ------
    ConfigurationError
        The scene has no rod or no scan.
    RodError
        No rod can be made of its options.
    UsageError
        The folder holds a run of a movie or another scan.
    LockedError
        Another process works on the folder.
    ResourceError
        It cannot be written.
    """
    scene.require("rod", "scan")
    assert scene.rod is not None
    assert scene.scan is not None
    # What no rod of the scan could be made of is told before any is tried.
    rod_parameters(scene.rod, None if field is None else field.table)
    record = Record("simulate scan")
    record.options(scene.settings)
    key = _key(scene, field, record)
    files.make_folder(folder)
    with files.locked(folder, "simulate scan"):
        files.sweep(folder)
        earlier = _earlier(folder, key, overwrite=overwrite)
        if earlier is not None and earlier["state"] == COMPLETE:
            with contextlib.suppress(InputError):
                return read_scan(folder)
        parts = folder / "parts" / f"scan-{key}"
        _keep_only(folder / "parts", parts.name)
        planned = planned_runs(scene.scan)
        facts = _facts(record, field, key, len(planned))
        files.write_text(folder / SCAN, write_out({**facts, "state": UNFINISHED}))
        kept = read_parts(parts, len(planned), scene.rod.n_vertices)
        begun = time.perf_counter()
        missing = [run for run in planned if run.number not in kept]
        make = functools.partial(simulate_run, scene, None if field is None else field.table)
        progress("scan", 0, len(missing))
        made = _results(make, missing, workers, executor)
        with contextlib.closing(_keeping(made, parts)) as results:
            for result in results:
                kept[result.row["run"]] = result
                progress("scan", len(kept) - len(planned) + len(missing), len(missing))
        progress("write", 0, 0)
        whole = [kept[run.number] for run in planned]
        _write(folder, whole, record, facts, time.perf_counter() - begun)
        shutil.rmtree(parts, ignore_errors=True)
        with contextlib.suppress(OSError):
            parts.parent.rmdir()
        return read_scan(folder)


def read_scan(folder: Path) -> Scan:
    """Read the results of a finished scan.

    Raises
    ------
    InputError
        The folder holds no scan, or one that is not finished or not whole.
    """
    facts = _read_facts(folder)
    if facts is None:
        raise InputError(f"{folder} holds no scan: make one with `rotortrack simulate scan`")
    if facts["state"] != COMPLETE:
        raise InputError(
            f"{folder} holds a scan that is not finished: give the same command again to finish it"
        )
    runs = parquet.read_table(folder / TABLE, RUNS)
    arrays, _ = read_archive(folder / SHAPES, "the shapes of a scan", DIMENSIONS)
    if any(len(values) != len(runs) for values in arrays.values()):
        raise InputError(f"{folder / SHAPES} belongs to other runs: make the scan again")
    return Scan(runs=runs, facts=facts, **arrays)


def _results(
    make: Callable[[ScanRun], RunResult],
    missing: Sequence[ScanRun],
    workers: int | None,
    executor: Executor | None,
) -> Generator[RunResult, None, None]:
    """Simulate runs in their order; many are handed on ahead, as some take long."""
    workers = workers or default_workers()
    with contextlib.ExitStack() as stack:
        if executor is None and workers > 1:
            executor = stack.enter_context(ThreadPoolExecutor(workers))
        ahead = 1 if executor is None else _AHEAD * workers
        yield from map_ordered(make, missing, workers=ahead, executor=executor)


def _keeping(
    results: Generator[RunResult, None, None], parts: Path
) -> Generator[RunResult, None, None]:
    """Keep runs on the disk every few seconds, and what was made when the scan is stopped."""
    part: list[RunResult] = []
    begun = time.monotonic()
    try:
        with contextlib.closing(results):
            for result in results:
                follows = part and result.row["run"] == part[-1].row["run"] + 1
                late = time.monotonic() - begun > _KEPT_EVERY_S
                if part and (not follows or late or len(part) == _MOST_IN_PART):
                    whole, part, begun = part, [], time.monotonic()
                    write_part(parts, whole)
                part.append(result)
                yield result
    finally:
        if part:
            write_part(parts, part)


def _write(
    folder: Path,
    results: Sequence[RunResult],
    record: Record,
    facts: dict[str, Any],
    seconds: float,
) -> None:
    """Write table and shapes, and last what says that they are whole."""
    rows = [result.row for result in results]
    provenance = {**record.provenance, "key": facts["key"], "field": facts["field"]}
    parquet.write_table(folder / TABLE, runs_table(rows), RUNS, provenance)
    write_archive(folder / SHAPES, arrays_of(results), provenance)
    counted = Counter(row["end"] for row in rows)
    ends = {end: counted[end] for end in (*(end.value for end in RodEnd), FAILED)}
    run_seconds = [round(result.seconds, 4) for result in results]
    times = {"seconds": round(seconds, 3), "run_seconds": run_seconds}
    whole = {**facts, "state": COMPLETE, "ends": ends, **times}
    files.write_text(folder / SCAN, write_out(whole))


def _facts(record: Record, field: SceneField | None, key: str, runs: int) -> dict[str, Any]:
    """Give what scan.json says but for the results."""
    told = None
    if field is not None:
        table = field.table
        told = {
            "source": field.source,
            "origin": field.origin,
            "current_a": table.current_a,
            "flow_m3_s": table.flow_m3_s,
            "current_error_rel": table.current_error_rel,
            "flow_error_rel": table.flow_error_rel,
        }
    names = ("command", "versions", "machine", "options")
    return {
        **{name: record.content[name] for name in names},
        "key": key,
        "field": told,
        "runs": runs,
    }


def _key(scene: Scene, field: SceneField | None, record: Record) -> str:
    """Hash everything that decides the numbers: options, field, sources and libraries."""
    content = {"options": scene.as_dict(), "versions": record.content["versions"]}
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode())
    if field is not None:
        for values in (field.table.r_nm, field.table.z_nm, field.table.nodes):
            digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:16]


def _earlier(folder: Path, key: str, *, overwrite: bool) -> dict[str, Any] | None:
    """Read what the folder says of the same scan; None where it holds nothing of use.

    Raises
    ------
    UsageError
        It holds something else.
    """
    if (folder / "run.json").exists():
        raise UsageError(f"{folder} is the run folder of a movie: choose another folder with -o")
    there = _read_facts(folder)
    if there is None:
        made = [name for name in (TABLE, SHAPES) if (folder / name).exists()]
        if made and not overwrite:
            raise UsageError(
                f"{folder} holds {made[0]}, which no scan of its own made: choose another folder "
                "with -o, or replace it with --overwrite"
            )
        return None
    if there["key"] == key:
        return there
    held = there["state"] == COMPLETE or any(folder.glob("parts/scan-*/*.npz"))
    if held and not overwrite:
        raise UsageError(
            f"{folder} holds a scan with other options or of another version: choose another "
            "folder with -o, or replace it with --overwrite"
        )
    return None


def _read_facts(folder: Path) -> dict[str, Any] | None:
    """Read scan.json; None where it is missing or another program's."""
    try:
        content = read_json(folder / SCAN)
    except (OSError, ValueError, RecursionError):
        return None
    ours = isinstance(content, dict) and {"state", "key", "runs"} <= content.keys()
    return dict(content) if ours else None


def _keep_only(root: Path, name: str) -> None:
    """Remove the kept runs of other scans, and what a killed process left half-written."""
    if root.is_symlink():
        root.unlink()
    for place in root.iterdir() if root.is_dir() else ():
        if place.is_symlink() and FOLDER.fullmatch(place.name):
            place.unlink()
        elif FOLDER.fullmatch(place.name) and place.name != name:
            shutil.rmtree(place, ignore_errors=True)
    files.sweep(root / name)
