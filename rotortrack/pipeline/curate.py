"""Human verdicts of a run folder: heeded by every stage that judges, recorded with its results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rotortrack.motion.verdicts import HUMAN, overrule
from rotortrack.pipeline.provenance import Record
from rotortrack.rotors.curation import FILE_NAME, match_verdicts, read_curation

if TYPE_CHECKING:
    import pandas as pd


def curate(
    folder: Path, rotors: pd.DataFrame, decisions: pd.DataFrame, record: Record
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Let the verdicts in a folder's curation.toml overrule those of the screening.

    Parameters
    ----------
    folder
        The run folder.
    rotors, decisions
        As screened, or as an earlier command left them there.
    record
        Gets the counts human_verdicts and overruled (those against the screening).

    Returns
    -------
    Both tables, the given ones where nobody decided anything.

    Raises
    ------
    ConfigurationError
        The file cannot be used, or speaks of a rotor that is not there any more.
    """
    told = read_curation(folder / FILE_NAME)
    if not told and not (decisions["feature"] == HUMAN).any():
        return rotors, decisions
    verdicts = match_verdicts(told, rotors)
    rotors, decisions = overrule(rotors, decisions, verdicts)
    rows = decisions[decisions["feature"] == HUMAN]
    before = rows["verdict_before"].str.partition(":")[0] if len(rows) else rows["rotor"]
    record.count(
        human_verdicts=len(rows),
        overruled=int((before != rows["verdict_after"]).sum()) if len(rows) else 0,
    )
    for number, said in verdicts.items():
        sentence = (
            f"the human verdict on rotor {said.rotor} at ({said.x_nm:.0f}, {said.y_nm:.0f}) nm "
            f"holds for rotor {number}, which lies there now"
        )
        if number != said.rotor and sentence not in record.content["notes"]:
            record.note(sentence)
    return rotors, decisions
