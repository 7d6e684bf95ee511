"""Scans: one rod for each start, charge and flow, run one by one and independent of each other."""

from __future__ import annotations

import dataclasses
import itertools
import math
import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import RodError
from rotortrack.simulate.single import simulate_rod
from rotortrack.simulate.tables import RUNS

if TYPE_CHECKING:
    import pandas as pd

    from rotortrack.simulate.field.table import FieldTable
    from rotortrack.simulate.options import ScanOptions
    from rotortrack.simulate.rod.options import RodOptions, ThermalOptions
    from rotortrack.simulate.scene import Scene

ANGLES = 101
"""Kept points of each run's angle over time, the first and the last included."""

KINDS = {"str": str, "bool": bool, "int64": int, "float64": float}
"""Python's type for each dtype of the table of runs."""

FAILED = "failed"
"""End of a run that could not be simulated; its row says why."""

LETTERS = {
    "not_docked": "N",
    "docked_still": "D",
    "rotating_steadily": "R",
    "translocated": "T",
    "time_reached": "u",
    "in_membrane": "m",
    "step_limit": "u",
    FAILED: "x",
}
"""What stands for an end in a written phase diagram; u: neither steady nor at an end; m: pressed
into the membrane."""


@dataclass(frozen=True)
class ScanRun:
    """One point of the grid and one start."""

    number: int
    placement: int
    mirrored: bool
    lambda_eff: float
    flow_ratio: float


@dataclass(frozen=True)
class RunResult:
    """What is kept of a run.

    Attributes
    ----------
    row
        Values of the columns of `RUNS`.
    shape_nm
        Final positions of the vertices, shape (n, 3); NaN where the run failed.
    time_us, turned_rad
        Angle over time, shape (ANGLES,).
    seconds
        How long the run took.
    """

    row: dict[str, Any]
    shape_nm: NDArray[np.float64]
    time_us: NDArray[np.float64]
    turned_rad: NDArray[np.float64]
    seconds: float


def planned_runs(options: ScanOptions) -> list[ScanRun]:
    """List the runs of a scan: those of one charge and flow stand together."""
    starts = itertools.product(
        options.flow_ratio,
        options.lambda_eff,
        range(len(options.offset_x_nm)),
        (False, True) if options.mirrored else (False,),
    )
    return [
        ScanRun(number, placement, mirrored, lambda_eff, ratio)
        for number, (ratio, lambda_eff, placement, mirrored) in enumerate(starts)
    ]


def simulate_run(scene: Scene, field: FieldTable | None, run: ScanRun) -> RunResult:
    """Simulate one run of a scan.

    It depends on nothing but the scene's options and its own point of the grid: thermal noise has
    a stream of random numbers for each run.

    Parameters
    ----------
    scene
        With rod and scan.
    field
        The field of the scene, None where it has none.
    run
        Which run.

    Returns
    -------
    RunResult
        A rod that cannot be integrated gives a row that says so.
    """
    rod, scan = scene.rod, scene.scan
    assert rod is not None
    assert scan is not None
    rod = dataclasses.replace(rod, lambda_eff=run.lambda_eff, flow_ratio=run.flow_ratio)
    start = dataclasses.replace(
        scene.start,
        offset_x_nm=scan.offset_x_nm[run.placement],
        offset_y_nm=scan.offset_y_nm[run.placement],
        mirrored=scene.start.mirrored != run.mirrored,
    )
    begun = time.perf_counter()
    try:
        simulated = simulate_rod(rod, start, scene.stepping, field, _own_stream(scene.thermal, run))
    except RodError as error:
        return _failed(run, rod, str(error), time.perf_counter() - begun)
    done = simulated.run
    kept = np.linspace(0, len(done.time_us) - 1, ANGLES).round().astype(int)
    values = {
        **dataclasses.asdict(simulated.seen),
        **_point(run),
        "end": done.end.value,
        "deepest_nm": done.numbers.deepest_nm,
        "simulated_us": done.simulated_us,
        "n_steps": done.n_steps,
        "problem": "",
    }
    return RunResult(
        row={column.name: KINDS[column.dtype](values[column.name]) for column in RUNS.columns},
        shape_nm=done.positions_nm[-1],
        time_us=done.time_us[kept],
        turned_rad=done.turned_rad[kept],
        seconds=time.perf_counter() - begun,
    )


def runs_table(rows: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """Make the table of runs."""
    import pandas as pd

    columns = {
        c.name: pd.Series([row[c.name] for row in rows], dtype=c.dtype) for c in RUNS.columns
    }
    return pd.DataFrame(columns)


def phase_diagram(runs: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Write ends as letters: a row for each ratio, the highest first, a column for each charge.

    Within a cell the letters follow the placements.

    Returns
    -------
    tuple[list[str], list[list[str]]]
        Header and rows.
    """
    charges = sorted(set(runs["lambda_eff"]))
    rows = []
    for ratio in sorted(set(runs["flow_ratio"]), reverse=True):
        line = runs[runs["flow_ratio"] == ratio]
        cells = [line[line["lambda_eff"] == charge] for charge in charges]
        letters = ["".join(map(LETTERS.__getitem__, cell["end"])) for cell in cells]
        rows.append([f"{ratio:g}", *letters])
    return ["ratio", *(f"{charge:g}" for charge in charges)], rows


def _point(run: ScanRun) -> dict[str, Any]:
    point = dataclasses.asdict(run)
    return {"run": point.pop("number"), **point}


def _own_stream(thermal: ThermalOptions | None, run: ScanRun) -> ThermalOptions | None:
    """Seed the noise by the run's values, so that a wider grid leaves a run as it is."""
    if thermal is None:
        return None
    point = struct.pack("<?qdd", run.mirrored, run.placement, run.lambda_eff, run.flow_ratio)
    seeds = np.random.SeedSequence([thermal.seed, int.from_bytes(point, "little")])
    return dataclasses.replace(thermal, seed=int(seeds.generate_state(1)[0]))


def _failed(run: ScanRun, rod: RodOptions, problem: str, seconds: float) -> RunResult:
    nothing = {**{dtype: kind() for dtype, kind in KINDS.items()}, "float64": math.nan}
    empty = {column.name: nothing[column.dtype] for column in RUNS.columns}
    return RunResult(
        row={**empty, **_point(run), "end": FAILED, "problem": problem},
        shape_nm=np.full((rod.n_vertices, 3), np.nan),
        time_us=np.full(ANGLES, np.nan),
        turned_rad=np.full(ANGLES, np.nan),
        seconds=seconds,
    )
