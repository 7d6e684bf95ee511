"""Single stages from a table of localisations to another one."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from rotortrack.corrections.density import dense_enough
from rotortrack.corrections.drift.cross_correlation import estimate_drift
from rotortrack.corrections.drift.drift import Drift, apply_drift
from rotortrack.corrections.quality import passes_quality
from rotortrack.errors import TableWarning, UsageError
from rotortrack.exchange import csv
from rotortrack.exchange.tables import TableInfo, read_info, read_localisations, write_localisations
from rotortrack.files import atomic_path
from rotortrack.pipeline.identity import identify, sha256_of
from rotortrack.pipeline.presets import SECTIONS, WORKFLOW
from rotortrack.pipeline.provenance import Record, following
from rotortrack.settings import Layer, Settings, resolve

if TYPE_CHECKING:
    import pandas as pd


def settings_for_table(path: Path, layers: list[Layer]) -> tuple[Settings, TableInfo]:
    """Resolve all options, what the table file records below everything that the user gave."""
    info = read_info(path)
    known = {
        "pixel_size_nm": info.pixel_size_nm,
        "frame_interval_s": info.frame_interval_s,
    }
    recorded = {key: value for key, value in known.items() if value is not None}
    settings = resolve(SECTIONS, [Layer(f"file {path.name}", {"movie": recorded}), *layers])
    return settings, info


def read_for(settings: Settings, path: Path) -> pd.DataFrame:
    """Read a table, with the user's pixel size for formats that count in pixels."""
    return read_localisations(path, pixel_size_nm=settings["movie"].pixel_size_nm)


def correct_drift(path: Path, target: Path, layers: list[Layer]) -> tuple[Drift, Path]:
    """Subtract the drift of a table; rows and their order stay.

    Returns
    -------
    Drift, Path
        The estimate, and the ``drift.csv`` written beside the target.
    """
    beside = target.with_name("drift.csv")
    if target == beside or (target.parent / "run.json").is_file():
        raise UsageError(
            f"{beside} is where the drift itself is written, and must not replace {target.name} or "
            "the drift of a run: choose another name or folder with -o"
        )
    settings, info = settings_for_table(path, layers)
    table = read_for(settings, path)
    drift = estimate_drift(
        table,
        settings["drift"],
        pixel_size_nm=settings["movie"].pixel_size_nm,
    )
    with atomic_path(beside) as temporary:
        # Both or none: what comes last needs no more space.
        csv.write_csv(temporary, drift.table)
        _write(path, target, apply_drift(table, drift), info, settings, "drift")
    return drift, beside


def filter_table(path: Path, target: Path, layers: list[Layer]) -> tuple[int, int, int]:
    """Keep the localisations that are precise and have neighbours.

    Returns
    -------
    int, int, int
        Rows read, precise ones, and those written.

    Warns
    -----
    TableWarning
        The table tells no uncertainties, so that neighbours alone decide.
    """
    settings, info = settings_for_table(path, layers)
    table = read_for(settings, path)
    precise = table
    if "uncertainty_nm" in table:
        precise = table[passes_quality(table, settings["quality"])]
    else:
        warnings.warn(
            f"{path} has no uncertainties, so only neighbours were counted: localise again to "
            "have both filters",
            TableWarning,
            stacklevel=2,
        )
    kept = precise[dense_enough(precise, settings["density"])]
    _write(path, target, kept, info, settings, "filter")
    return len(table), len(precise), len(kept)


def _write(
    path: Path, target: Path, table: pd.DataFrame, info: TableInfo, settings: Settings, step: str
) -> None:
    record = Record(step)
    file = identify(path)
    record.options(settings, WORKFLOW)
    record.inputs([file], target.parent, [sha256_of(file)])
    record.count(localisations=len(table))
    info = dataclasses.replace(
        info,
        pixel_size_nm=settings["movie"].pixel_size_nm,
        provenance=following(info.provenance, record.provenance),
    )
    write_localisations(target, table, info)
