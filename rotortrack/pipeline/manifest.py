"""run.json: what a run folder says of itself.

A folder whose manifest says "complete" holds the tables of exactly one run. Work that is going on
or was stopped stands under `unfinished`; where nothing was ever completed, `state` says so too.
"""

from __future__ import annotations

import errno
import json
import stat
from pathlib import Path
from typing import Any

from rotortrack.errors import InputError

COMPLETE, UNFINISHED = "complete", "unfinished"
_LARGEST_BYTES = 64 * 2**20


def read_manifest(path: Path) -> dict[str, Any]:
    """Read a manifest, also one of an unfinished run.

    Raises
    ------
    InputError
        It is not the manifest of a run.
    """
    try:
        content = read_json(path)
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or "it is not JSON"
        raise InputError(
            f"{path} cannot be read ({reason}): make the run again, or choose another folder"
        ) from error
    if not _is_manifest(content):
        raise InputError(f"{path} is not a manifest of this program: make the run again")
    return dict(content)


def read_json(path: Path) -> Any:
    """Read a JSON file that may come from elsewhere: neither wait on a pipe nor fill the memory.

    Raises
    ------
    OSError, ValueError, RecursionError
        It is no plain file, too large, or not JSON.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is no plain file")
    if status.st_size > _LARGEST_BYTES:
        raise OSError(errno.EFBIG, "it is too large")
    return json.loads(path.read_text(encoding="utf-8"))


def write_out(content: dict[str, Any]) -> str:
    """Give a manifest's text."""
    return json.dumps(content, indent=2) + "\n"


def _is_manifest(content: object) -> bool:
    """Whether a manifest has the shape that commands rely on; its values are checked later."""
    if not isinstance(content, dict):
        return False
    lists = (content.get(key) for key in ("inputs", "notes", "warnings", "steps", "tables"))
    tables = (content.get(key) for key in ("options", "counts", "seconds", "versions"))
    unfinished = content.get("unfinished", {})
    return (
        content.get("state") in (COMPLETE, UNFINISHED)
        and all(isinstance(value, list) for value in lists)
        and all(isinstance(value, dict) for value in tables)
        and all(isinstance(entry, dict) for entry in content["inputs"])
        and all(
            isinstance(word, str)
            for key in ("notes", "warnings", "steps", "tables")
            for word in content[key]
        )
        and isinstance(unfinished, dict)
        and all(isinstance(unfinished.get(key, ""), str) for key in ("command", "stage", "reason"))
        and all(
            isinstance(section, dict)
            and all(
                isinstance(entry, dict) and {"value", "origin"} <= entry.keys()
                for entry in section.values()
            )
            for section in content["options"].values()
        )
    )
