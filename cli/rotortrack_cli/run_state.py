"""What `rotortrack info` shows of a run folder."""

from __future__ import annotations

from pathlib import Path

from rotortrack_cli.console import Console

FILES_SHOWN = 5


def show_run(console: Console, path: Path) -> None:
    """Show how far a run came, what it found, and with which options."""
    from rotortrack.pipeline.state import run_state

    state = run_state(path)
    manifest = state.manifest
    steps = ", then ".join(manifest["steps"])
    kind = "complete" if state.complete else "unfinished"
    console.text(f"{path}: {kind} run ({steps})")
    if state.owner is not None:
        console.text(f"at work now: {state.owner}")
    if state.sentence:
        console.text(state.sentence)
    inputs = manifest["inputs"]
    for entry in inputs if len(inputs) <= FILES_SHOWN else (inputs[0], inputs[-1]):
        console.text(
            f"input: {entry.get('path')}, {entry.get('bytes')} bytes, SHA-256 "
            f"{entry.get('sha256') or 'not known yet'}"
        )
    if len(inputs) > FILES_SHOWN:
        console.text(f"input: the first and the last of {len(inputs)} files are shown")
    if state.stages:
        console.text("")
        console.table(["stage", "kept for the next run"], state.stages)
    for title in ("counts", "seconds"):
        if manifest[title]:
            console.text("")
            console.table([title, ""], list(manifest[title].items()))
    for title in ("notes", "warnings"):
        for sentence in manifest[title]:
            console.text(f"{title[:-1]}: {sentence}")
    rows = [
        [section, key, str(entry["value"]), entry["origin"]]
        for section, entries in manifest["options"].items()
        for key, entry in entries.items()
    ]
    console.text("")
    console.table(["section", "option", "value", "origin"], rows)
    console.json(
        {
            **manifest,
            "locked_by": state.owner,
            "stages": dict(state.stages),
        }
    )
