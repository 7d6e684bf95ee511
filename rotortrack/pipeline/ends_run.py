"""End-to-end distances measured again in a run folder."""

from __future__ import annotations

from pathlib import Path

from rotortrack.exchange.writer import TableInfo
from rotortrack.pipeline.folder_runs import only
from rotortrack.pipeline.localise_run import Progress, silent
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import Record
from rotortrack.pipeline.run import Draw, Result, stage
from rotortrack.pipeline.second_colour import ENDS, ends_of
from rotortrack.pipeline.store import RunFolder
from rotortrack.settings import Layer, resolve

_USES = ("ends", "channels.line_time_s")
_READ = ("localisations", "second_localisations", "rotors", "tracks", "drift")


def end_to_end_of_run(
    path: Path,
    layers: list[Layer],
    *,
    progress: Progress = silent,
    draw: Draw | None = None,
) -> Result:
    """Measure the end-to-end distances of a run of two colours.

    Parameters
    ----------
    path
        The run folder.
    layers
        What the user gives now, over the options of the run.
    progress, draw
        As everywhere.

    Raises
    ------
    InputError
        The folder is no finished run, or shows one colour.
    ConfigurationError
        Options are wrong, or belong to earlier stages.
    LockedError, ResourceError
        The folder is in use, or cannot be written.
    """
    RunFolder.find(path)
    record = Record("end-to-end")
    with record.warnings(), RunFolder.claim(path, "end-to-end") as folder:
        RunFolder.open(path)
        registration = folder.registration()
        manifest = folder.read_manifest()
        earlier = record.continue_from(manifest)
        for key in ("population", "trace"):
            if key in manifest:
                record.content[key] = manifest[key]
        settings = resolve(SECTIONS, [*earlier, *only(_USES, layers)])
        recorded = {
            f"{section}.{key}" for section, values in manifest["options"].items() for key in values
        }
        record.options(settings, recorded.union(_USES))
        with stage(folder, record, progress, "ends"):
            tables = {name: folder.read(name) for name in _READ}
            measured = ends_of(tables, registration, settings, record)
            tables.update(measured)
            kept = [name for name in manifest["tables"] if name not in ENDS]
            folder.commit(measured, TableInfo(provenance=record.provenance), record, keep=kept)
        result = Result(folder, settings, record, tables)
        if draw is not None:
            with stage(folder, record, progress, "figures"):
                draw(result)
        folder.note_finished(record)
    return result
