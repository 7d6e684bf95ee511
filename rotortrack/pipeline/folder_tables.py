"""Which tables a run folder holds, and in which files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rotortrack.exchange import csv, parquet
from rotortrack.exchange.tables import write_localisations
from rotortrack.exchange.writer import TableInfo
from rotortrack.motion.tables import MSDS, POSTERIOR, PROFILES, SWITCHES, VOLTAGE_SPEEDS, VOLTAGES
from rotortrack.tables import DECISIONS, DRIFT, LOCALISATIONS, ROTORS, TRACKS, Schema
from rotortrack.twocolour.tables import END_TO_END, END_TO_END_ROTORS, SECOND_LOCALISATIONS

if TYPE_CHECKING:
    import pandas as pd

SCHEMAS: dict[str, Schema] = {
    schema.name: schema
    for schema in (
        *(LOCALISATIONS, ROTORS, TRACKS, DRIFT, DECISIONS),
        *(MSDS, POSTERIOR, PROFILES, SWITCHES, VOLTAGES, VOLTAGE_SPEEDS),
        *(SECOND_LOCALISATIONS, END_TO_END, END_TO_END_ROTORS),
    )
}
"""Schemas of all tables that a run folder may hold, by name."""

_SHORT = (ROTORS.name, SWITCHES.name, VOLTAGE_SPEEDS.name, END_TO_END_ROTORS.name)


def files_of(folder: Path, schema: Schema) -> list[Path]:
    """Name a table's files: Parquet, drift as CSV, and short ones as both for spreadsheets."""
    endings = {DRIFT.name: ("csv",), **dict.fromkeys(_SHORT, ("parquet", "csv"))}
    return [folder / f"{schema.name}.{ending}" for ending in endings.get(schema.name, ("parquet",))]


def write(path: Path, schema: Schema, table: pd.DataFrame, info: TableInfo) -> None:
    """Write a table in the format of its ending."""
    if path.suffix == ".csv":
        csv.write_csv(path, table)
    elif schema is LOCALISATIONS:
        write_localisations(path, table, info)
    else:
        parquet.write_table(path, table, schema, dict(info.provenance))
