"""The one screen that a run ends with."""

from __future__ import annotations

import textwrap
from collections import Counter
from typing import TYPE_CHECKING, Any

from rotortrack.errors import NothingFoundError
from rotortrack.units import TURN_RAD
from rotortrack_cli.console import Console

if TYPE_CHECKING:
    import pandas as pd

    from rotortrack.pipeline.run import Result

ROTORS_SHOWN = 30
WIDTH = 100


def conclude(console: Console, result: Result, *, seconds: float, strict: bool) -> None:
    """Print the summary or the JSON object of a run.

    Raises
    ------
    NothingFoundError
        No rotor was kept, and `strict` asks to be told so by exit code.
    """
    kept = int((result.rotors["verdict"] == "kept").sum())
    _show(console, result, seconds)
    console.json(
        {
            "rotors_found": len(result.rotors),
            "rotors_kept": kept,
            "rotors": result.rotors.to_dict("records"),
            "seconds": round(seconds, 3),
        }
    )
    if strict and not kept:
        raise NothingFoundError(
            f"no rotor was kept: see the reasons in {result.folder.path / 'rotors.csv'}"
        )


def _show(console: Console, result: Result, seconds: float) -> None:
    """Print counts, verdicts with reasons, and the table of speeds."""
    counts = result.record.content["counts"]
    rotors = result.rotors
    kept = rotors[rotors["verdict"] == "kept"]
    lines = [
        f"frames            {_frames(counts)}",
        f"spots             {_spots(counts)}",
    ]
    lines.append(f"rotors            {len(rotors)} found, {len(kept)} kept")
    if counts.get("small_clusters"):
        lines.append(f"  ignored         {counts['small_clusters']} clusters of too few spots")
    if counts.get("duplicates"):
        lines.append(f"  duplicates      {counts['duplicates']} spots of a rotor seen twice")
    reasons = Counter(rotors.loc[rotors["verdict"] != "kept", "reason"])
    lines += [f"  refused         {count} {reason}" for reason, count in reasons.most_common()]
    if counts.get("human_verdicts"):
        against = f"{counts.get('overruled', 0)} against the screening"
        lines.append(f"  by hand         {counts['human_verdicts']} decided, {against}")
    if "behaviour" in kept and len(kept):
        found = ", ".join(f"{n} {name}" for name, n in Counter(kept["behaviour"]).most_common())
        lines.append(f"  behaviour       {found}")
    driven = (result.record.content.get("population") or {}).get("driven", {}).get("at_least", {})
    if driven.get("value") is not None:
        share, low = 100 * driven["value"], 100 * driven["low"]
        lines.append(f"  driven          {share:.0f} % beyond chance, at least {low:.0f} %")
    for note in result.record.content["notes"]:
        lines += textwrap.wrap(
            note, WIDTH, initial_indent="note              ", subsequent_indent=" " * 18
        )
    console.text("\n".join(lines))
    if "omega_rad_s" in kept and len(kept):
        console.text("")
        console.table(*_speeds(kept))
        if len(kept) > ROTORS_SHOWN:
            console.text(f"... and {len(kept) - ROTORS_SHOWN} more in rotors.csv")
    if "end_to_end_rotors" in result.tables:
        show_ends(console, result)
    console.text(f"\n{seconds:.1f} s; results in {result.folder.path}")


def show_ends(console: Console, result: Result) -> None:
    """Print the end-to-end distances of a run."""
    rotors = result.tables["end_to_end_rotors"]
    field = result.record.content["end_to_end"]
    console.text("")
    if rotors.empty:
        console.text("no rotor shows both ends")
        return
    console.table(
        [
            "rotor",
            "end-to-end nm",
            "+-",
            "breathing nm",
            "noise nm",
            "R1 nm",
            "R2 nm",
            "arrangement",
        ],
        [
            [
                row["rotor"],
                row["end_to_end_nm"],
                row["end_to_end_sd_nm"],
                row["breathing_nm"],
                row["noise_nm"],
                row["first_radius_nm"],
                row["second_radius_nm"],
                row["arrangement"],
            ]
            for row in rotors.head(ROTORS_SHOWN).to_dict("records")
        ],
    )
    if len(rotors) > ROTORS_SHOWN:
        console.text(f"... and {len(rotors) - ROTORS_SHOWN} more in end_to_end_rotors.csv")
    console.text(f"registration checked by turning rotors: {field['correction']}")


def _frames(counts: dict[str, Any]) -> str:
    text = str(counts.get("frames", "unknown"))
    for name, word in (("missing_frames", "cut off"), ("dropped_frames", "dropped by the camera")):
        if counts.get(name):
            text += f"; {counts[name]} {word}"
    return text


def _spots(counts: dict[str, Any]) -> str:
    spots = str(counts.get("localisations", "unknown"))
    if "precise" in counts:
        spots += f" fitted, {counts['precise']} precise, {counts['dense']} with neighbours"
    if counts.get("saturated_spots"):
        spots += f"; {counts['saturated_spots']} with saturated pixels"
    if counts.get("masked_pixels"):
        spots += f"; {counts['masked_pixels']} pixels without a number were left out"
    return spots


def _speeds(kept: pd.DataFrame) -> tuple[list[str], list[list[object]]]:
    header = ["rotor", "x um", "y um", "R nm", "rev/s", "+-", "D rad2/s", "behaviour"]
    rows: list[list[object]] = [
        [
            row["rotor"],
            row["x_nm"] / 1000.0,
            row["y_nm"] / 1000.0,
            row["radius_nm"],
            row["rev_per_s"],
            row["omega_sd_rad_s"] / TURN_RAD,
            row["diffusion_rad2_s"],
            row["behaviour"],
        ]
        for row in kept.head(ROTORS_SHOWN).to_dict("records")
    ]
    return header, rows
