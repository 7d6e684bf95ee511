"""A comparison as histograms and as plain values that JSON knows."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from rotortrack.twocolour.compare import Comparison
from rotortrack.twocolour.measured import histograms
from rotortrack.twocolour.population import RodPopulation

Floats = NDArray[np.float64]

CLOSED: Final = "[low, high), the last bin closed"
"""Which edges belong to a bin."""


@dataclass(frozen=True)
class Histogram:
    """Distances of one group, per frame and per rotor, in the bins of a comparison.

    Attributes
    ----------
    name
        Of the run or scan.
    kind
        `measured`; `twins`: rods with the noise of a measured group, counts are means over the
        sets of twins; `rods`: without noise, counts are weights that add up to 1.
    of
        The measured group whose noise twins have, empty for others.
    frames, rotors
        Counts in the bins; they add up to the next two.
    n_frames, n_rotors
        Frames and rotors; for `rods` 1 each.
    """

    name: str
    kind: Literal["measured", "twins", "rods"]
    of: str
    frames: Floats
    rotors: Floats
    n_frames: float
    n_rotors: float


def comparison_histograms(comparison: Comparison) -> list[Histogram]:
    """Count distances per frame and per rotor, measured groups first (Fig. 3e, Fig. 3j)."""
    edges, per_bin = comparison.edges_nm, comparison.per_bin
    found = []
    for group in comparison.groups:
        frames = group.counts(edges).sum(axis=0).astype(np.float64)
        rotors = _of_all(group.mean_nm, edges)
        total = float(group.n_frames.sum())
        found.append(Histogram(group.name, "measured", "", frames, rotors, total, float(group.n)))
    for pair in comparison.against:
        sets, n = pair.twins.mean_nm.shape
        fine = pair.twins.counts.sum(axis=(0, 1))
        frames = fine.reshape(-1, per_bin).sum(axis=1).astype(np.float64) / sets
        rotors = _of_all(pair.twins.mean_nm.ravel(), edges) / sets
        total = float(frames.sum())
        found.append(Histogram(pair.scan, "twins", pair.group, frames, rotors, total, float(n)))
    for name, rods in comparison.scans.items():
        at = np.minimum(np.searchsorted(edges, rods.distance_nm, side="right") - 1, len(edges) - 2)
        shares: Floats = np.bincount(at, rods.weight, len(edges) - 1).astype(np.float64)
        found.append(Histogram(name, "rods", "", shares, shares, 1.0, 1.0))
    return found


def _of_all(values: Floats, edges: Floats) -> Floats:
    counts: Floats = histograms(values, np.array([len(values)]), edges)[0].astype(np.float64)
    return counts


def facts(comparison: Comparison) -> dict[str, Any]:
    """Give what comparison.json says of the results; what is not known is None."""
    told: dict[str, Any] = _plain(
        {
            "groups": [
                {
                    "name": group.name,
                    "rotors": group.n,
                    "frames": int(group.n_frames.sum()),
                    "left_out": group.left_out,
                    "mirrored": group.film.mirrored,
                    "exposure_s": group.film.exposure_s,
                    "correlation": dataclasses.asdict(comparison.correlations[group.name]),
                }
                for group in comparison.groups
            ],
            "scans": [
                {"name": name, **_rods_facts(rods)} for name, rods in comparison.scans.items()
            ],
            "comparisons": comparison.rows.to_dict("records"),
            "against": [
                {
                    "group": pair.group,
                    "scan": pair.scan,
                    "twins": len(pair.twins.mean_nm),
                    "accepted": pair.twins.accepted,
                    "unscreened": pair.twins.unscreened,
                    "rho": pair.rho,
                }
                for pair in comparison.against
            ],
            "histograms": {
                "edges_nm": comparison.edges_nm.tolist(),
                "closed": CLOSED,
                "of": [_histogram_facts(one) for one in comparison_histograms(comparison)],
            },
            "notes": list(comparison.notes),
        }
    )
    return told


def _rods_facts(rods: RodPopulation) -> dict[str, Any]:
    return {
        "rods": len(rods.weight),
        "cells": rods.cells,
        "shapes": rods.attractors,
        "declared": rods.declared,
        "mirrored_starts": rods.mirrored_starts,
        "mean_nm": float(rods.weight @ rods.distance_nm),
        "runs": rods.run.tolist(),
        "weights": rods.weight.tolist(),
        "shape_of_run": rods.attractor.tolist(),
    }


def _histogram_facts(one: Histogram) -> dict[str, Any]:
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in vars(one).items()
    }


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
