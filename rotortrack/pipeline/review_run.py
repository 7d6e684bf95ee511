"""Human verdicts on the rotors of a run: listed, and added to its curation.toml."""

from __future__ import annotations

import datetime
import getpass
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rotortrack.errors import InputError, UsageError
from rotortrack.motion.verdicts import KEPT
from rotortrack.pipeline.store import RunFolder
from rotortrack.rotors.curation import (
    FILE_NAME,
    HumanVerdict,
    append_verdicts,
    match_verdicts,
    read_curation,
)

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Review:
    """The verdicts of a run.

    Attributes
    ----------
    rotors
        rotor, x_nm, y_nm, radius_nm, verdict and reason as in the run's tables; by_hand is the
        verdict of a person and remark what was said, both empty where there is none.
    pending
        Numbers of the rotors whose human verdict the tables do not hold yet.
    """

    rotors: pd.DataFrame
    pending: list[int]


def review_run(path: Path) -> Review:
    """List the rotors of a run with the verdicts of the screening and of people.

    Raises
    ------
    InputError
        It is no finished run.
    ConfigurationError
        Its curation.toml cannot be used.
    """
    rotors = _rotors_of(RunFolder.open(path))
    verdicts = match_verdicts(read_curation(path / FILE_NAME), rotors)
    columns = ["rotor", "x_nm", "y_nm", "radius_nm", "verdict", "reason"]
    said = [verdicts.get(number) for number in rotors["rotor"]]
    listed = rotors[columns].assign(
        by_hand=["" if one is None else one.verdict for one in said],
        remark=["" if one is None else one.remark for one in said],
    )
    differs = (listed["by_hand"] != "") & (listed["by_hand"] != listed["verdict"])
    return Review(listed, listed.loc[differs, "rotor"].tolist())


def add_verdicts(
    path: Path, numbers: Sequence[int], verdict: str, *, reason: str = "", by: str | None = None
) -> list[HumanVerdict]:
    """Record that a person wants rotors of a run kept or refused; its tables stay as they are.

    Parameters
    ----------
    path
        The run folder.
    numbers, verdict
        Rotors, and kept or refused.
    reason, by
        Why, and who says so (default: the user's name on this computer).

    Raises
    ------
    InputError
        It is no finished run, or has no such rotor.
    UsageError
        A rotor without a circle is to be kept.
    ConfigurationError
        Its curation.toml cannot be used.
    LockedError
        Another process works on it.
    """
    RunFolder.open(path)
    with RunFolder.claim(path, "review") as folder:
        rotors = _rotors_of(folder).set_index("rotor")
        for number in numbers:
            if number not in rotors.index:
                last = f"0 to {rotors.index.max()}" if len(rotors) else "none"
                raise InputError(f"{path} has no rotor {number}: its rotors are {last}")
            if verdict == KEPT and rotors["radius_nm"].isna()[number]:
                raise UsageError(
                    f"rotor {number} has no circle ({rotors['reason'][number]}), so that nothing "
                    "can be measured and it cannot be kept: leave it refused"
                )
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        added = [
            HumanVerdict(
                rotor=number,
                x_nm=round(float(rotors["x_nm"][number]), 3),
                y_nm=round(float(rotors["y_nm"][number]), 3),
                verdict=verdict,
                reason=reason,
                by=_user() if by is None else by,
                at=now,
            )
            for number in dict.fromkeys(numbers)
        ]
        append_verdicts(path / FILE_NAME, added)
        folder.log("verdict", command="review", rotors=list(numbers), verdict=verdict)
    return added


def _rotors_of(folder: RunFolder) -> pd.DataFrame:
    rotors = folder.read("rotors")
    missing = [n for n in ("radius_nm", "verdict", "reason") if n not in rotors]
    if missing:
        raise InputError(
            f"{folder.path / 'rotors.parquet'} has no {missing[0]}: screen the rotors again"
        )
    return rotors


def _user() -> str:
    """Name of the user; a container may know none."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return ""
