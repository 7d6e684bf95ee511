"""The run folder: where each result lies, and its reading and writing."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rotortrack import files
from rotortrack.errors import InputError, ResourceError
from rotortrack.exchange import csv, parquet
from rotortrack.exchange.tables import write_localisations
from rotortrack.exchange.writer import TableInfo
from rotortrack.pipeline.provenance import Record, to_toml
from rotortrack.settings import Settings
from rotortrack.tables import DECISIONS, DRIFT, LOCALISATIONS, ROTORS, TRACKS, Schema, empty

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class RunFolder:
    """A folder with the results of one movie or one table of localisations."""

    path: Path

    @classmethod
    def create(cls, path: Path) -> RunFolder:
        """Make the folder, or take it when it exists.

        Raises
        ------
        ResourceError
            The folder cannot be made.
        """
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ResourceError(
                f"{path} cannot be made a folder ({error.strerror}): choose another with -o"
            ) from error
        return cls(path)

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """Take a folder that a run made.

        Raises
        ------
        InputError
            It is not a run folder.
        """
        run = cls(path)
        if not run.manifest_path.is_file():
            raise InputError(
                f"{path} is not a run folder (it has no run.json): make one with `rotortrack run` "
                "or `rotortrack rotors`"
            )
        return run

    @property
    def manifest_path(self) -> Path:
        """The manifest."""
        return self.path / "run.json"

    @contextlib.contextmanager
    def scratch(self, name: str) -> Iterator[Path]:
        """Give a path for an unfinished stage; the folder is left as it was found afterwards."""
        parts = self.path / "parts"
        parts.mkdir(exist_ok=True)
        path = parts / name
        try:
            yield path
        finally:
            path.unlink(missing_ok=True)
            # Removed where nothing else lies in them: a failed run leaves no empty folder.
            with contextlib.suppress(OSError):
                parts.rmdir()
                self.path.rmdir()

    def read_manifest(self) -> dict[str, Any]:
        """Read run.json.

        Raises
        ------
        InputError
            It is not JSON of a run.
        """
        try:
            content = json.loads(self.manifest_path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(f"{self.manifest_path} cannot be read ({error})") from error
        if not isinstance(content, dict):
            raise InputError(f"{self.manifest_path} is not a run's manifest")
        return content

    def write_record(self, record: Record, settings: Settings) -> None:
        """Write run.json and config.resolved.toml."""
        files.write_text(self.path / "config.resolved.toml", to_toml(settings.as_dict()))
        files.write_text(self.manifest_path, record.json())

    def read(self, name: str) -> pd.DataFrame:
        """Read a table by the name of its schema; drift is empty where none was estimated.

        Raises
        ------
        InputError
            The run has no such table yet.
        """
        schema = _SCHEMAS[name]
        if schema is DRIFT:
            path = self.path / "drift.csv"
            return csv.read_csv(path, schema) if path.is_file() else empty(schema)
        path = self.path / f"{name}.parquet"
        if not path.is_file():
            raise InputError(
                f"{self.path} has no {name}.parquet: run the stage that makes it first"
            )
        return parquet.read_table(path, schema)

    def write(self, name: str, table: pd.DataFrame, info: TableInfo) -> None:
        """Write a table as Parquet, drift as CSV, and rotors as both for spreadsheets."""
        schema = _SCHEMAS[name]
        provenance = dict(info.provenance)
        if schema is LOCALISATIONS:
            write_localisations(self.path / f"{name}.parquet", table, info)
        elif schema is not DRIFT:
            parquet.write_table(self.path / f"{name}.parquet", table, schema, provenance)
        if schema in (ROTORS, DRIFT):
            csv.write_csv(self.path / f"{name}.csv", table)


_SCHEMAS: dict[str, Schema] = {
    schema.name: schema for schema in (LOCALISATIONS, ROTORS, TRACKS, DRIFT, DECISIONS)
}
