"""Verdicts of people on single rotors: `curation.toml`, which is read, appended to, and matched.

An entry names a rotor by its number and its place. Numbers change when rotors are found anew, so
the place decides, and an entry that fits no rotor is refused rather than forgotten.
"""

from __future__ import annotations

import datetime
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rotortrack.errors import ConfigurationError
from rotortrack.files import write_text
from rotortrack.settings import parse_toml, read_content, shortened

if TYPE_CHECKING:
    import pandas as pd

FILE_NAME = "curation.toml"

MATCH_NM = 100.0
"""Distance within which a rotor is the one that was judged: other options move a centre by less,
and the next pore is farther."""

VERDICTS = ("kept", "refused")

_NEEDED = ("rotor", "x_nm", "y_nm", "verdict")
_TEXTS = ("reason", "by", "at")
_REMEDY = "correct or remove it"


@dataclass(frozen=True)
class HumanVerdict:
    """What a person decided about one rotor.

    Attributes
    ----------
    rotor, x_nm, y_nm
        Its number at that time, and the place of its circle's centre.
    verdict
        kept or refused.
    reason, by, at
        Why, who, and when (ISO 8601); free text.
    """

    rotor: int
    x_nm: float
    y_nm: float
    verdict: str
    reason: str = ""
    by: str = ""
    at: str = ""

    @property
    def remark(self) -> str:
        """Reason, person and time in one line."""
        signed = ", ".join(word for word in (self.by, self.at) if word)
        return f"{self.reason} ({signed})" if self.reason and signed else self.reason or signed


def read_curation(path: Path) -> list[HumanVerdict]:
    """Read the verdicts of a file in their order; none where there is no such file.

    Raises
    ------
    ConfigurationError
        It cannot be read, is not TOML, or an entry lacks or misspells something; all mistakes are
        listed.
    """
    if not path.exists() and not path.is_symlink():
        return []
    return _parse(read_content(path), path)


def append_verdicts(path: Path, verdicts: Iterable[HumanVerdict]) -> None:
    """Append verdicts to a file, atomically; every line that it has stays.

    Raises
    ------
    ConfigurationError
        What is there cannot be read, or be appended to.
    ResourceError
        It cannot be written.
    """
    earlier = read_curation(path)
    before = read_content(path).decode("utf-8-sig") if path.exists() else ""
    new = list(verdicts)
    blocks = [
        "\n".join(
            ["[[rotor]]", *(f"{name} = {_toml(value)}" for name, value in vars(one).items()), ""]
        )
        for one in new
    ]
    gap = "" if not before or before.endswith("\n\n") else "\n" if before.endswith("\n") else "\n\n"
    text = before + gap + "\n".join(blocks)
    try:
        readable = len(_parse(text.encode(), path)) == len(earlier) + len(new)
    except ConfigurationError:
        readable = False
    if not readable:
        raise ConfigurationError(
            f"{path} lists its rotors within one line, so nothing can be appended: write each of "
            "them under a [[rotor]] of its own"
        )
    write_text(path, text)


def match_verdicts(
    verdicts: Sequence[HumanVerdict], rotors: pd.DataFrame
) -> dict[int, HumanVerdict]:
    """Find the rotor that each verdict speaks of, by its place; of several on one the last counts.

    Parameters
    ----------
    verdicts
        In the order of the file.
    rotors
        With rotor, x_nm and y_nm.

    Returns
    -------
    dict
        Verdicts by the rotors' present numbers, ascending.

    Raises
    ------
    ConfigurationError
        No rotor lies within 100 nm of an entry's place, or several do and none of these has its
        number.
    """
    numbers = rotors["rotor"].to_numpy(dtype=np.int64)
    x, y = (rotors[name].to_numpy(dtype=np.float64) for name in ("x_nm", "y_nm"))
    found: dict[int, HumanVerdict] = {}
    mistakes: dict[str, None] = {}
    for said in verdicts:
        place = f"rotor {said.rotor} at ({said.x_nm:.0f}, {said.y_nm:.0f}) nm"
        distance = np.hypot(x - said.x_nm, y - said.y_nm)
        near = np.flatnonzero(distance <= MATCH_NM)
        # The number decides only between neighbours that both fit.
        same = near[numbers[near] == said.rotor]
        if near.size == 1 or same.size:
            found[int(numbers[same[0] if same.size else near[0]])] = said
        elif near.size:
            several = ", ".join(map(str, numbers[near]))
            mistakes[f"{place} may be any of the rotors {several}"] = None
        else:
            nearest = ""
            if np.isfinite(distance).any():
                closest = int(np.nanargmin(distance))
                nearest = f" (the nearest, {numbers[closest]}, is {distance[closest]:.0f} nm away)"
            mistakes[f"{place} is no rotor of this run any more{nearest}"] = None
    if mistakes:
        raise ConfigurationError(
            *(f"{FILE_NAME}: {what}: correct or remove its [[rotor]]" for what in mistakes)
        )
    return dict(sorted(found.items()))


def _parse(content: bytes, path: Path) -> list[HumanVerdict]:
    values = parse_toml(content, path, arrays=("rotor",))
    mistakes = [
        f"{path}: {shortened(key)} is not known: verdicts stand under [[rotor]]"
        for key in values
        if key != "rotor"
    ]
    entries = values.get("rotor", [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        mistakes.append(f"{path}: [rotor] must be written [[rotor]], once for each verdict")
        entries = []
    for number, entry in enumerate(entries, 1):
        mistakes += [f"{path}: [[rotor]] {number}: {what}" for what in _mistakes(entry)]
    if mistakes:
        raise ConfigurationError(*mistakes[:20])
    return [
        HumanVerdict(
            rotor=entry["rotor"],
            x_nm=float(entry["x_nm"]),
            y_nm=float(entry["y_nm"]),
            verdict=entry["verdict"],
            **{name: _text(entry[name]) for name in _TEXTS if name in entry},
        )
        for entry in entries
    ]


def _mistakes(entry: dict[str, Any]) -> list[str]:
    """Say what is wrong with an entry."""
    missing = [name for name in _NEEDED if name not in entry]
    found = [f"{', '.join(missing)} is missing: give it"] if missing else []
    found += [
        f"{shortened(name)} is not known: {_REMEDY}"
        for name in entry
        if name not in (*_NEEDED, *_TEXTS)
    ]
    rotor = entry.get("rotor", 0)
    if type(rotor) is not int or not 0 <= rotor < 2**53:
        found.append("rotor must be a number from 0")
    for name in ("x_nm", "y_nm"):
        value = entry.get(name, 0.0)
        if type(value) not in (int, float) or not abs(value) < 1e15 or not math.isfinite(value):
            found.append(f"{name} must be a number of nm, as in rotors.csv")
    if entry.get("verdict", "kept") not in VERDICTS:
        found.append(f"verdict must be kept or refused, not {shortened(repr(entry['verdict']))}")
    found += [
        f"{name} must be text in quotation marks"
        for name in _TEXTS
        if not isinstance(entry.get(name, ""), str | datetime.date)
    ]
    return found


def _text(value: str | datetime.date) -> str:
    return value if isinstance(value, str) else value.isoformat()


def _toml(value: float | str) -> str:
    """Write a value; JSON's spelling is TOML's but for odd characters."""
    text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return text.encode("utf-8", "replace").decode("utf-8")
