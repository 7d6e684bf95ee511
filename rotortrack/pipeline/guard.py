"""What keeps results from being replaced by mistake."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from rotortrack.errors import InputError, UsageError
from rotortrack.pipeline.identity import HEAD, Identity, shown_from
from rotortrack.pipeline.manifest import COMPLETE, read_manifest

_REMEDY = "choose another folder with -o, or replace them with --overwrite"


def refuse_other_results(
    manifest_path: Path, results: Collection[Path], inputs: Sequence[Identity], *, overwrite: bool
) -> None:
    """Keep the results of one movie from being replaced by those of another by mistake.

    Parameters
    ----------
    manifest_path
        Where the folder's manifest lies, if it has one.
    results
        Files that the folder's results would be written to.
    inputs
        The files that will be analysed.
    overwrite
        The user wants to replace what is there.

    Raises
    ------
    UsageError
        An input is one of the results, or the results that are there are of other files, of another
        version of the program, or of nobody knows what.
    """
    folder = manifest_path.parent
    own = {path.resolve() for path in results}
    for file in inputs:
        if file.path.resolve() in own:
            raise UsageError(
                f"{file.path} would be replaced by what is made from it: choose another folder "
                "with -o"
            )
    if overwrite:
        return
    if not manifest_path.exists():
        there = sorted(path.name for path in results if path.exists())
        if there:
            raise UsageError(f"{folder} holds {there[0]}, which no run of its own made: {_REMEDY}")
        return
    try:
        earlier = read_manifest(manifest_path)
    except InputError as error:
        if any(path.exists() for path in results):
            raise UsageError(
                f"{folder} holds results of another version, or damaged ones: {_REMEDY}"
            ) from error
        return
    if earlier["inputs"] and not _is_same(earlier, inputs, folder):
        raise UsageError(
            f"{folder} holds results of {earlier['inputs'][0].get('path')}, not of "
            f"{inputs[0].path} as it is now: {_REMEDY}"
        )


def _is_same(earlier: dict[str, Any], inputs: Sequence[Identity], folder: Path) -> bool:
    """Whether a manifest speaks of these files, or of earlier states of them."""
    entries = earlier["inputs"]
    if len(entries) != len(inputs):
        return False
    pairs = list(zip(entries, inputs, strict=True))
    if all((old.get("bytes"), old.get("edges")) == (f.size_bytes, f.edges) for old, f in pairs):
        return True
    if any(old.get("path") != shown_from(file.path, folder) for old, file in pairs):
        return False
    # Under its name a file may have grown since, as it was still being recorded or copied; and
    # where nothing was finished nothing is lost.
    return earlier["state"] != COMPLETE or all(
        str(old.get("edges"))[:HEAD] == file.edges[:HEAD] for old, file in pairs
    )
