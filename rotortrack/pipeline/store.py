"""The run folder: where each result lies, and its reading and writing."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Collection, Iterator, Mapping
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


FIGURE_NAME = re.compile(r"(field|speeds|cumulative_angles|msds|drift|rotor-\d{3,})\.(png|svg|pdf)")
"""Names of the figures that a run draws; other files beside them are the user's."""


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
    @contextlib.contextmanager
    def claim(cls, path: Path) -> Iterator[RunFolder]:
        """Make or take the folder; one made for work that then fails is removed again."""
        existed = path.exists()
        folder = cls.create(path)
        try:
            yield folder
        except BaseException:
            if not existed:
                with contextlib.suppress(OSError):
                    path.rmdir()
            raise

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """Take a folder that a run made.

        Raises
        ------
        InputError
            It is not a run folder.
        """
        run = cls(path)
        if path.is_file():
            raise InputError(f"{path} is a file, not a run folder: give the folder")
        if not run.manifest_path.is_file():
            raise InputError(
                f"{path} is not a run folder (it has no run.json): make one with `rotortrack run` "
                "or `rotortrack rotors`"
            )
        return run

    @property
    def manifest_path(self) -> Path:
        """The manifest; a folder that has one is whole."""
        return self.path / "run.json"

    @contextlib.contextmanager
    def scratch(self, name: str) -> Iterator[Path]:
        """Give a path for an unfinished stage, gone again afterwards.

        Raises
        ------
        ResourceError
            A file stands where the folder of unfinished parts should be.
        """
        parts = self.path / "parts"
        try:
            parts.mkdir(exist_ok=True)
        except OSError as error:
            raise ResourceError(f"{parts} cannot be made a folder: move it away") from error
        path = parts / name
        try:
            yield path
        finally:
            path.unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                parts.rmdir()

    def read_manifest(self) -> dict[str, Any]:
        """Read run.json.

        Raises
        ------
        InputError
            It is not the manifest of a run.
        """
        try:
            content = json.loads(self.manifest_path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"{self.manifest_path} cannot be read ({error})") from error
        if not _is_manifest(content):
            raise InputError(
                f"{self.manifest_path} is not a manifest of this program: make the run again"
            )
        return dict(content)

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

    def replace(
        self,
        tables: Mapping[str, pd.DataFrame],
        info: TableInfo,
        record: Record,
        settings: Settings,
        *,
        keep: Collection[str] = (),
    ) -> None:
        """Write tables and the manifest in place of what an earlier command left.

        The old manifest goes first and the new one comes last, so that a folder with a manifest
        never mixes two runs; tables and figures of the earlier command go too.

        Parameters
        ----------
        tables
            By the name of their schema.
        info
            What the localisations record beside their rows.
        record, settings
            For the manifest.
        keep
            Names of tables that the earlier command wrote and that still hold.
        """
        self.manifest_path.unlink(missing_ok=True)
        for name in _SCHEMAS.keys() - tables.keys() - set(keep):
            for path in self._files(_SCHEMAS[name]):
                path.unlink(missing_ok=True)
        for figure in self.figures_path.glob("*.*"):
            if FIGURE_NAME.fullmatch(figure.name):
                figure.unlink()
        for name, table in tables.items():
            self._write(_SCHEMAS[name], table, info)
        files.write_text(self.path / "config.resolved.toml", to_toml(settings.as_dict()))
        files.write_text(self.manifest_path, record.json())

    @property
    def figures_path(self) -> Path:
        """Folder of the figures."""
        return self.path / "figures"

    def _files(self, schema: Schema) -> list[Path]:
        """Name a table's files: Parquet, drift as CSV, and rotors as both for spreadsheets."""
        endings = {DRIFT.name: ("csv",), ROTORS.name: ("parquet", "csv")}
        return [
            self.path / f"{schema.name}.{ending}"
            for ending in endings.get(schema.name, ("parquet",))
        ]

    def _write(self, schema: Schema, table: pd.DataFrame, info: TableInfo) -> None:
        for path in self._files(schema):
            if path.suffix == ".csv":
                csv.write_csv(path, table)
            elif schema is LOCALISATIONS:
                write_localisations(path, table, info)
            else:
                parquet.write_table(path, table, schema, dict(info.provenance))


def _is_manifest(content: object) -> bool:
    """Whether a manifest has the shape that commands rely on; its values are checked later."""
    if not isinstance(content, dict):
        return False
    lists = (content.get(key) for key in ("inputs", "notes", "warnings"))
    tables = (content.get(key) for key in ("options", "counts", "seconds"))
    return (
        all(isinstance(value, list) for value in lists)
        and all(isinstance(value, dict) for value in tables)
        and all(
            isinstance(section, dict)
            and all(
                isinstance(entry, dict) and {"value", "origin"} <= entry.keys()
                for entry in section.values()
            )
            for section in content["options"].values()
        )
    )


_SCHEMAS: dict[str, Schema] = {
    schema.name: schema for schema in (LOCALISATIONS, ROTORS, TRACKS, DRIFT, DECISIONS)
}
