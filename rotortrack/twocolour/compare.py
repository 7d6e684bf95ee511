"""Measured groups of rotors against each other and against the simulated rods of a scan."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.tables import empty
from rotortrack.twocolour.compare_options import CompareOptions
from rotortrack.twocolour.compare_rows import hand_rows, measured_rows, simulated_rows
from rotortrack.twocolour.compare_tables import COMPARISON
from rotortrack.twocolour.correlation import Correlation, correlate, weighted_spearman
from rotortrack.twocolour.forward import RIGID_NOTE, Twins, draw_twins, rescaled_speeds_deg_s
from rotortrack.twocolour.measured import MeasuredGroup
from rotortrack.twocolour.population import RodPopulation

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

LARGEST_NM: Final = 2000.0
"""Longer distances count in the last bin: no rod of this work is half as long."""

_FINE_NM: Final = 1.0
_SPREAD_SD: Final = 6.0
_FEW: Final = 10


@dataclass(frozen=True)
class AgainstRods:
    """A measured group and a scan.

    Attributes
    ----------
    group, scan
        Their names.
    twins
        What would have been measured of the scan's rods.
    speed_deg_s
        Of each rod of the population, rescaled to the measured speeds.
    rho
        Spearman's correlation of simulated speed and distance, weighted.
    """

    group: str
    scan: str
    twins: Twins
    speed_deg_s: Floats
    rho: float


@dataclass(frozen=True)
class Comparison:
    """All that was compared.

    Attributes
    ----------
    groups, scans
        What was given, scans by name.
    rows
        Table of schema `COMPARISON`.
    against
        One for each measured group and scan.
    correlations
        Of each measured group, by name.
    edges_nm, per_bin
        Edges of the histograms; how many fine bins of `Twins.counts` are one bin.
    fine_nm
        Edges of those.
    notes
        What a reader has to know.
    """

    groups: tuple[MeasuredGroup, ...]
    scans: Mapping[str, RodPopulation]
    rows: pd.DataFrame
    against: tuple[AgainstRods, ...]
    correlations: Mapping[str, Correlation]
    edges_nm: Floats
    fine_nm: Floats
    per_bin: int
    notes: tuple[str, ...]


def compare_groups(
    groups: Sequence[MeasuredGroup], scans: Mapping[str, RodPopulation], options: CompareOptions
) -> Comparison:
    """Compare every measured group with every other one and with every scan.

    Parameters
    ----------
    groups
        One at least.
    scans
        Weighted rods of scans by name.
    options
        How.
    """
    rng = np.random.default_rng(options.seed)
    fine, per_bin = _bins(groups, scans, options.bin_nm)
    rows: list[dict[str, Any]] = []
    notes: list[str] = []
    for first, second in itertools.combinations(groups, 2):
        rows += measured_rows(first, second, fine, options, rng)
    against = []
    for group, (name, rods) in itertools.product(groups, scans.items()):
        twins = draw_twins(
            group,
            rods,
            fine,
            twins=options.twins,
            fitted_noise=options.noise == "fitted",
            rng=rng,
        )
        rows += simulated_rows(group, name, rods, twins, fine, options, rng)
        speeds = rescaled_speeds_deg_s(group, rods)
        known = bool(np.isfinite(speeds).all())
        rho = weighted_spearman(rods.distance_nm, np.abs(speeds), rods.weight) if known else np.nan
        against.append(AgainstRods(group.name, name, twins, speeds, float(rho)))
        if twins.unscreened:
            notes.append(
                f"at the noise of {twins.unscreened} rotors of {group.name} no rod of {name} "
                "would pass the screening: their twins were not screened"
            )
    rows += hand_rows(groups, scans, notes)
    correlations = {
        group.name: correlate(
            group.true_nm,
            group.speed_deg_s,
            group.true_sd_nm,
            group.speed_sd_deg_s,
            axes=options.axes,
            resamples=options.resamples,
            permutations=options.permutations,
            rng=rng,
        )
        for group in groups
    }
    return Comparison(
        groups=tuple(groups),
        scans=scans,
        rows=_table(rows),
        against=tuple(against),
        correlations=correlations,
        edges_nm=fine[::per_bin],
        fine_nm=fine,
        per_bin=per_bin,
        notes=(*_notes(groups, scans, rows), *notes),
    )


def _bins(
    groups: Sequence[MeasuredGroup], scans: Mapping[str, RodPopulation], bin_nm: float
) -> tuple[Floats, int]:
    """Choose the edges of fine bins, whole numbers of which make the bins of the histograms."""
    longest = max(float(group.distance_nm.max()) for group in groups)
    for group, rods in itertools.product(groups, scans.values()):
        noise = max(float(group.x_sd_nm.max()), float(group.y_sd_nm.max()))
        noise += float(group.registration_sd_nm.max())
        longest = max(longest, float(rods.distance_nm.max()) + _SPREAD_SD * noise)
    per_bin = math.ceil(bin_nm / _FINE_NM)
    bins = math.ceil(min(longest, LARGEST_NM) / bin_nm)
    edges: Floats = np.arange(bins * per_bin + 1, dtype=np.float64) * (bin_nm / per_bin)
    return edges, per_bin


def _table(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    import pandas as pd

    blank = {"str": "", "int64": 0, "float64": math.nan}
    columns = COMPARISON.columns
    if not rows:
        return empty(COMPARISON)
    return pd.DataFrame(
        {
            c.name: pd.Series([row.get(c.name, blank[c.dtype]) for row in rows], dtype=c.dtype)
            for c in columns
        }
    )


def _notes(
    groups: Sequence[MeasuredGroup],
    scans: Mapping[str, RodPopulation],
    rows: Sequence[Mapping[str, Any]],
) -> Iterator[str]:
    for group in groups:
        if group.n < _FEW:
            yield f"{group.name} has {group.n} rotors: intervals of so few are too narrow"
        if scans and not np.isfinite(group.film.exposure_s):
            yield f"the exposure of {group.name} is not known: its twins are not blurred"
        beyond = int(np.count_nonzero(group.distance_nm > LARGEST_NM))
        if beyond:
            yield (
                f"{beyond} frames of {group.name} have distances above {LARGEST_NM:g} nm, which "
                "count in the last bin"
            )
    if scans:
        yield RIGID_NOTE
    if any(math.isfinite(row["p"]) for row in rows):
        yield "p-values of one comparison are not corrected for each other"
