"""How the results of single stages are kept in `parts/` and taken up again.

Only what a stage adds is kept, a few bytes a localisation; the localisations themselves lie in the
parts of the first stage.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rotortrack.corrections.drift.drift import Drift, apply_drift
from rotortrack.pipeline.parts import Checkpoint
from rotortrack.pipeline.stages import Corrected, Found
from rotortrack.tables import DECISIONS, DRIFT, ROTORS, Column, Schema

if TYPE_CHECKING:
    import pandas as pd

CORRECTED: Mapping[str, Schema] = {
    "trusted": Schema(
        "trusted", (Column("trusted", "bool", "", "precise and in company", required=True),)
    ),
    "drift": DRIFT,
}
FOUND: Mapping[str, Schema] = {
    "members": Schema(
        "members",
        (
            Column("rotor", "int64", "", "rotor number, -1 for none", required=True),
            Column("fit_flags", "int64", "", "bits of FitFlag", required=True),
        ),
    ),
    "rotors": ROTORS,
    "decisions": DECISIONS,
}
"""Tables that are kept of each stage."""

_BINS = {
    "bin_frames": float,
    "bin_dx_nm": float,
    "bin_dy_nm": float,
    "bin_sd_nm": float,
    "bin_localisations": np.int64,
    "bin_peak": float,
    "bin_used": bool,
}


def pack_corrected(corrected: Corrected) -> Checkpoint:
    """Reduce drift-corrected localisations to the drift and the mark of trust."""
    import pandas as pd

    drift = corrected.drift
    facts: dict[str, Any] = {
        "precise": corrected.precise,
        "dense": corrected.dense,
        "method": drift.method,
        "estimated": drift.estimated,
        **{name: getattr(drift, name).tolist() for name in _BINS},
    }
    trusted = pd.DataFrame({"trusted": corrected.trusted})
    return Checkpoint({"trusted": trusted, "drift": drift.table}, facts)


def unpack_corrected(kept: Checkpoint, localisations: pd.DataFrame) -> Corrected:
    """Correct localisations by a kept drift.

    Raises
    ------
    KeyError, TypeError, ValueError
        What was kept belongs to other localisations or is no drift at all.
    """
    facts = kept.facts
    trusted = kept.tables["trusted"]["trusted"].to_numpy()
    if len(trusted) != len(localisations):
        raise ValueError("kept of other localisations")
    drift = Drift(
        table=kept.tables["drift"],
        method=str(facts["method"]),
        estimated=bool(facts["estimated"]),
        **{name: np.array(facts[name], dtype) for name, dtype in _BINS.items()},
    )
    return Corrected(
        apply_drift(localisations, drift),
        trusted,
        drift,
        int(facts["precise"]),
        int(facts["dense"]),
    )


def pack_found(found: Found) -> Checkpoint:
    """Reduce rotors and their localisations to the rotors and each localisation's number."""
    members = found.localisations[["rotor", "fit_flags"]]
    facts = {
        "distance_reason": found.distance_reason,
        "duplicates": found.duplicates,
        "small_clusters": found.small_clusters,
    }
    tables = {"members": members, "rotors": found.rotors, "decisions": found.decisions}
    return Checkpoint(tables, facts)


def unpack_found(kept: Checkpoint, localisations: pd.DataFrame) -> Found:
    """Give localisations the rotors that were found in them.

    Raises
    ------
    KeyError, TypeError, ValueError
        What was kept belongs to other localisations.
    """
    members = kept.tables["members"]
    return Found(
        localisations.assign(
            rotor=members["rotor"].to_numpy(), fit_flags=members["fit_flags"].to_numpy()
        ),
        kept.tables["rotors"],
        kept.tables["decisions"],
        str(kept.facts["distance_reason"]),
        int(kept.facts["duplicates"]),
        int(kept.facts["small_clusters"]),
    )
