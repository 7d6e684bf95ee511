"""How far a run came: what is finished, what is kept, who is at work."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rotortrack import locks
from rotortrack.errors import InputError
from rotortrack.pipeline.keys import STAGES
from rotortrack.pipeline.manifest import COMPLETE, read_manifest
from rotortrack.pipeline.parts import Parts, frame_parts
from rotortrack.pipeline.store import MANIFEST

_KEY = re.compile(r"[0-9a-f]{16}")


@dataclass(frozen=True)
class RunState:
    """What is known of a run folder.

    Attributes
    ----------
    complete
        Whether its tables are those of one finished run.
    owner
        Who works on it now, or None.
    sentence
        What is unfinished and why, empty when nothing is.
    stages
        Of each stage whose work is kept for a later run: its name and how much.
    manifest
        The content of run.json.
    """

    complete: bool
    owner: str | None
    sentence: str
    stages: tuple[tuple[str, str], ...]
    manifest: dict[str, Any]


def run_state(path: Path) -> RunState:
    """Look into a run folder without disturbing whoever works on it.

    Raises
    ------
    InputError
        It is not a run folder.
    """
    if not (path / MANIFEST).is_file():
        raise InputError(
            f"{path} is not a run folder (it has no {MANIFEST}): make one with `rotortrack run` "
            "or `rotortrack rotors`"
        )
    manifest = read_manifest(path / MANIFEST)
    owner = locks.lock_owner(path)
    return RunState(
        complete=manifest["state"] == COMPLETE,
        owner=owner,
        sentence=_sentence(manifest.get("unfinished", {}), owner),
        stages=tuple(_kept(path, manifest)),
        manifest=manifest,
    )


def _sentence(unfinished: dict[str, Any], owner: str | None) -> str:
    if not unfinished:
        return ""
    command, stage = unfinished.get("command", "?"), unfinished.get("stage", "?")
    inputs = unfinished.get("inputs")
    of = f" (its input: {inputs[0]})" if isinstance(inputs, list) and inputs else ""
    if owner is not None:
        return f"{command} is at the stage {stage}{of}"
    reason = unfinished.get("reason", "begun")
    ended = "was killed" if reason == "begun" else f"ended early ({reason})"
    told = f"{command} {ended} in the stage {stage}: give the same command again to finish it"
    return told + of


def _kept(path: Path, manifest: dict[str, Any]) -> list[tuple[str, str]]:
    """Say how much of each stage a later run would find: of the work going on, if there is any."""
    latest = manifest.get("unfinished", {})
    keys = latest.get("keys") or manifest.get("keys")
    keys = keys if isinstance(keys, dict) else {}
    frames = latest.get("frames") or manifest["counts"].get("frames")
    if not all(_KEY.fullmatch(str(keys.get(stage.name, ""))) for stage in STAGES):
        return []
    parts = Parts(path, {stage.name: str(keys[stage.name]) for stage in STAGES})
    found = []
    for stage in STAGES:
        if parts.facts(stage.name) is not None:
            found.append((stage.name, "finished"))
            continue
        how_much = "not begun"
        if stage.name == "localise" and isinstance(frames, int):
            ranges = frame_parts(parts.folder(stage.name), frames)
            done = sum(part.stop - part.start for part in ranges)
            how_much = f"{done} of {frames} frames" if done else how_much
        found.append((stage.name, how_much))
    return found
