"""The run folder: where each result lies, how it is read, and how it changes hands.

Several results change together, so they are written into `parts/commit` first, the manifest last;
then the old manifest gives way to one that says "unfinished", the files are renamed into place, and
the new manifest comes last. A process killed in between leaves either the old run whole or a commit
that the next command carries out.
"""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import re
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rotortrack import files, locks
from rotortrack.errors import InputError, ResourceError
from rotortrack.exchange import csv, parquet
from rotortrack.exchange.writer import TableInfo
from rotortrack.pipeline.folder_tables import SCHEMAS, files_of, write
from rotortrack.pipeline.guard import refuse_other_results
from rotortrack.pipeline.identity import Identity
from rotortrack.pipeline.manifest import COMPLETE, UNFINISHED, read_manifest, write_out
from rotortrack.pipeline.parts import remove_work, sweep_work
from rotortrack.pipeline.provenance import Record
from rotortrack.tables import DRIFT, empty
from rotortrack.toml import to_toml
from rotortrack.twocolour.registration import Registration, read_registration

if TYPE_CHECKING:
    import pandas as pd


FIGURE_NAME = re.compile(
    r"(field|positions|examples|frames|speeds|population|energetics|scatter|cumulative_angles|msds"
    r"|drift|end_to_end|both_ends|end_to_end_traces|end_to_end_axes|voltage|voltage_angles|voltage_examples|rotor-\d{3,})\.(png|svg|pdf)"
)
"""Names of the figures that a run draws; other files beside them are the user's."""

MANIFEST, CONFIG, LOG = "run.json", "config.resolved.toml", "log.jsonl"
REGISTRATION = "registration.json"
BUDGET = "error_budget.json"

# Neither follow a link out of the folder nor wait for the other end of a pipe.
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


@dataclass(frozen=True)
class RunFolder:
    """A folder with the results of one movie or one table of localisations."""

    path: Path

    @classmethod
    @contextlib.contextmanager
    def claim(
        cls,
        path: Path,
        task: str,
        inputs: Sequence[Identity] = (),
        *,
        overwrite: bool = False,
    ) -> Iterator[RunFolder]:
        """Make or take the folder as its only writer.

        What a killed process left half-written is swept, and a commit that it had begun is carried
        out. A folder made for work that then fails before anything was kept is removed again.

        Parameters
        ----------
        path, task
            The folder, and the command that works on it, for the lock.
        inputs
            The files that will be analysed; none where the folder's own results are.
        overwrite
            Take the folder even if it holds results of other files.

        Raises
        ------
        ResourceError
            The folder cannot be made or written.
        LockedError
            Another process works on it.
        UsageError
            It holds results of other files, or an input is one of its results.
        """
        made = not path.exists()
        files.make_folder(path)
        folder = cls(path)
        try:
            with locks.locked(path, task):
                try:
                    folder._remove_links()
                    for place in (path, folder.figures_path):
                        files.sweep(place)
                    sweep_work(path / "parts")
                    folder._carry_out_commit()
                    if inputs:
                        results = [result for name in SCHEMAS for result in folder._files(name)]
                        results.append(path / REGISTRATION)
                        refuse_other_results(
                            folder.manifest_path, results, inputs, overwrite=overwrite
                        )
                    yield folder
                except BaseException:
                    if made and not folder._holds_work():
                        folder._remove_what_is_ours()
                    raise
        except BaseException:
            if made:
                with contextlib.suppress(OSError):
                    path.rmdir()
            raise

    @classmethod
    def find(cls, path: Path) -> RunFolder:
        """Take a folder that a run made, finished or not.

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
                f"{path} is not a run folder (it has no {MANIFEST}): make one with "
                "`rotortrack run` or `rotortrack rotors`"
            )
        return run

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """Take a folder that a run made, to read its results.

        Raises
        ------
        InputError
            It is not a run folder, or its run is not finished.
        """
        run = cls.find(path)
        manifest = run.read_manifest()
        if manifest["state"] != COMPLETE:
            command = manifest.get("unfinished", {}).get("command", "run")
            raise InputError(
                f"{path} holds a run that is not finished: give the same `rotortrack {command}` "
                "command again to finish it"
            )
        return run

    @property
    def manifest_path(self) -> Path:
        """The manifest; where it says "complete", the folder is whole."""
        return self.path / MANIFEST

    @property
    def figures_path(self) -> Path:
        """Folder of the figures."""
        return self.path / "figures"

    def read_manifest(self) -> dict[str, Any]:
        """Read run.json.

        Raises
        ------
        InputError
            It is not the manifest of a run.
        """
        return read_manifest(self.manifest_path)

    def read(self, name: str) -> pd.DataFrame:
        """Read a table by the name of its schema; drift is empty where none was estimated.

        Raises
        ------
        InputError
            The run has no such table yet.
        """
        schema = SCHEMAS[name]
        if schema is DRIFT:
            path = self.path / "drift.csv"
            return csv.read_csv(path, schema) if path.is_file() else empty(schema)
        path = self.path / f"{name}.parquet"
        if not path.is_file():
            raise InputError(
                f"{self.path} has no {name}.parquet: run the stage that makes it first"
            )
        return parquet.read_table(path, schema)

    def registration(self) -> Registration:
        """Read the registration by which the run mapped its second colour.

        Raises
        ------
        InputError
            The run has none.
        """
        path = self.path / REGISTRATION
        if "registration" not in self.read_manifest() or not path.is_file():
            raise InputError(
                f"{self.path} shows one colour: make it with `rotortrack run --channels "
                "CHANNELS.json` to have both ends"
            )
        return read_registration(path)

    def note_unfinished(self, record: Record, stage: str, reason: str) -> None:
        """Say in the manifest what is being done, or why it ended early.

        Results of an earlier run stay what they are, and their manifest with them.
        """
        content = self._complete_manifest()
        if content is None:
            content = {**record.content, "state": UNFINISHED, "tables": []}
        command = str(record.content["command"])
        content["unfinished"] = {
            "command": command,
            "stage": stage,
            "reason": reason,
            "keys": record.content.get("keys", {}),
            "frames": record.content["counts"].get("frames"),
            "inputs": [entry["path"] for entry in record.content["inputs"][:1]],
        }
        files.write_text(self.manifest_path, write_out(content))
        self.log(reason, command=command, stage=stage)

    def note_finished(self, record: Record) -> None:
        """Say in the manifest that nothing is left to do."""
        content = {**self.read_manifest(), "seconds": record.content["seconds"]}
        content.pop("unfinished", None)
        files.write_text(self.manifest_path, write_out(content))
        self.log("finished", command=record.content["command"], seconds=content["seconds"])

    def log(self, event: str, **facts: object) -> None:
        """Append one whole line to the log; a log that cannot be written stops nothing."""
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds")
        text = json.dumps({"time": now, "pid": os.getpid(), "event": event, **facts}, default=str)
        line = text.encode("utf-8", "backslashreplace") + b"\n"
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | _NO_LINK
        with contextlib.suppress(OSError):
            descriptor = os.open(self.path / LOG, flags, 0o666)
            try:
                size = os.fstat(descriptor).st_size
                if os.write(descriptor, line) < len(line):
                    os.ftruncate(descriptor, size)
            finally:
                os.close(descriptor)

    def commit(
        self,
        tables: Mapping[str, pd.DataFrame],
        info: TableInfo,
        record: Record,
        *,
        keep: Collection[str] = (),
        registration: str | None = None,
        unfinished: str | None = None,
    ) -> None:
        """Put tables and the manifest in place of what an earlier command left, all or none.

        Parameters
        ----------
        tables
            By the name of their schema.
        info
            What the localisations record beside their rows.
        record
            For the manifest and the configuration.
        keep
            Names of tables that the earlier command wrote and that still hold.
        registration
            Text of the registration by which the second colour was mapped, where it is new.
        unfinished
            A stage that is still to come, such as the figures.
        """
        staged = self._commit_path
        kept = [name for name in keep if all(path.is_file() for path in self._files(name))]
        content = {**record.content, "state": COMPLETE, "tables": sorted({*tables, *kept})}
        if unfinished is not None:
            command = str(record.content["command"])
            content["unfinished"] = {"command": command, "stage": unfinished, "reason": "begun"}
        shutil.rmtree(staged, ignore_errors=True)
        files.make_folder(staged)
        try:
            for name, table in tables.items():
                for path in files_of(staged, SCHEMAS[name]):
                    write(path, SCHEMAS[name], table, info)
            if registration is not None:
                files.write_text(staged / REGISTRATION, registration)
            files.write_text(staged / CONFIG, to_toml(record.option_values))
            files.write_text(staged / MANIFEST, write_out(content))
        except BaseException:
            # Nobody can use it, and on a full disk it takes the space.
            shutil.rmtree(staged, ignore_errors=True)
            raise
        self._carry_out_commit()

    @property
    def _commit_path(self) -> Path:
        return self.path / "parts" / "commit"

    def _carry_out_commit(self) -> None:
        """Rename what a commit prepared into place; one that was not prepared whole is removed."""
        staged = self._commit_path
        with contextlib.suppress(InputError):
            manifest = read_manifest(staged / MANIFEST)
            with _as_resource_error(self.path):
                self._move_into_place(staged, manifest)
        shutil.rmtree(staged, ignore_errors=True)
        with contextlib.suppress(OSError):
            staged.parent.rmdir()

    def _move_into_place(self, staged: Path, manifest: dict[str, Any]) -> None:
        tables, command = manifest["tables"], str(manifest.get("command", "run"))
        earlier = self._complete_manifest() or {}
        begun = {"command": command, "stage": "tables", "reason": "begun"}
        unfinished = {**manifest, "state": UNFINISHED, "tables": [], "unfinished": begun}
        files.write_text(self.manifest_path, write_out(unfinished))
        for name in SCHEMAS.keys() - set(tables):
            for path in self._files(name):
                path.unlink(missing_ok=True)
        if "registration" in earlier and "registration" not in manifest:
            (self.path / REGISTRATION).unlink(missing_ok=True)
        if any(path.exists() for path in files_of(staged, SCHEMAS["rotors"])):
            # It is that of other rotors.
            (self.path / BUDGET).unlink(missing_ok=True)
        for figure in self.figures_path.glob("*.*"):
            if FIGURE_NAME.fullmatch(figure.name):
                figure.unlink()
        # Only names that a commit writes are moved: the folder may come from elsewhere.
        names = [path.name for name in tables for path in self._files(name)]
        for file in (*names, REGISTRATION, CONFIG, MANIFEST):
            with contextlib.suppress(FileNotFoundError):
                (staged / file).replace(self.path / file)
        files.flush_folder(self.path)

    def _remove_links(self) -> None:
        """Remove links in place of folders: what is written or removed would lie elsewhere."""
        parts = self.path / "parts"
        with _as_resource_error(self.path):
            for place in (self.figures_path, parts):
                if place.is_symlink():
                    place.unlink()
            for place in parts.iterdir() if parts.is_dir() else ():
                if place.is_symlink():
                    place.unlink()

    def _holds_work(self) -> bool:
        """Whether anything lies in the folder that took time to make, which checks do not."""
        return any(
            place.is_file()
            and place.name not in (MANIFEST, LOG, locks.LOCK_NAME)
            and not place.parent.name.startswith("check-")
            for place in self.path.rglob("*")
        )

    def remove_kept_work(self) -> None:
        """Remove the parts of an earlier run, which a later one could no longer use."""
        remove_work(self.path / "parts")
        with contextlib.suppress(OSError):
            (self.path / "parts").rmdir()

    def _remove_what_is_ours(self) -> None:
        self.remove_kept_work()
        with contextlib.suppress(OSError):
            for name in (MANIFEST, LOG):
                (self.path / name).unlink(missing_ok=True)

    def _files(self, name: str) -> list[Path]:
        schema = SCHEMAS.get(name)
        return files_of(self.path, schema) if schema else []

    def _complete_manifest(self) -> dict[str, Any] | None:
        """Read the manifest of finished results; None where there are none."""
        with contextlib.suppress(InputError):
            content = self.read_manifest()
            if content["state"] == COMPLETE:
                return content
        return None


@contextlib.contextmanager
def _as_resource_error(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ResourceError(
            f"{path} cannot be written ({error.strerror}): free space, or choose another folder "
            "with -o"
        ) from error
