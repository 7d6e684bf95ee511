"""The published analysis, stage by stage, from top to bottom.

    movie -> localisations -> precise, drift-corrected, dense ones -> rotors -> tracks -> speeds

Each function is one paragraph of the paper's Methods ("Single-particle localization and rotor data
analysis"); what it calls is the sentence.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotortrack import parallel
from rotortrack.corrections.density import dense_enough
from rotortrack.corrections.drift.cross_correlation import estimate_drift
from rotortrack.corrections.drift.drift import Drift, apply_drift
from rotortrack.corrections.quality import passes_quality
from rotortrack.motion.angles import build_tracks
from rotortrack.motion.measure import measure_motion
from rotortrack.motion.screen import screen
from rotortrack.rotors.find import find_rotors
from rotortrack.settings import Settings

if TYPE_CHECKING:
    import pandas as pd


_PLACES = ("frame", "x_nm", "y_nm")
_LOOKED_AT = (*_PLACES, "photons", "sigma_nm", "uncertainty_nm", "fit_flags")
"""Columns that the stages look at; taking no others keeps a night's localisations in memory."""


@dataclass(frozen=True)
class Corrected:
    """Drift-corrected localisations, and which of them are trusted."""

    localisations: pd.DataFrame
    trusted: NDArray[np.bool_]
    drift: Drift
    precise: int
    dense: int

    @property
    def drift_sd_nm(self) -> float:
        """Error per axis that the correction added; 0 where nothing was subtracted."""
        known = self.drift.table["sd_nm"].dropna()
        return float(np.sqrt((known**2).mean())) if self.drift.estimated and len(known) else 0.0


@dataclass(frozen=True)
class Found:
    """Rotors with a verdict, and the localisations with their rotor."""

    localisations: pd.DataFrame
    rotors: pd.DataFrame
    decisions: pd.DataFrame
    distance_reason: str
    duplicates: int
    small_clusters: int


@dataclass(frozen=True)
class Moved:
    """Tracks of the rotors, and the tables of `measure.Measured`."""

    tracks: pd.DataFrame
    rotors: pd.DataFrame
    switches: pd.DataFrame
    posterior: pd.DataFrame
    profiles: pd.DataFrame
    msd: pd.DataFrame

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """All of them, by name."""
        return dict(vars(self))


def correct(localisations: pd.DataFrame, settings: Settings, *, pixel_size_nm: float) -> Corrected:
    """Keep precise spots, subtract the drift that they show, then keep spots in company.

    All rows come back, drift-corrected; `trusted` marks those that passed both filters.
    """
    precise = passes_quality(localisations, settings["quality"])
    drift = estimate_drift(
        localisations.loc[precise, list(_PLACES)], settings["drift"], pixel_size_nm=pixel_size_nm
    )
    corrected = apply_drift(localisations, drift)
    trusted = precise.copy()
    trusted[precise] = dense_enough(corrected.loc[precise, list(_PLACES)], settings["density"])
    return Corrected(corrected, trusted, drift, int(precise.sum()), int(trusted.sum()))


def find(
    localisations: pd.DataFrame,
    trusted: NDArray[np.bool_],
    settings: Settings,
    *,
    n_frames: int,
    drift_sd_nm: float = 0.0,
) -> Found:
    """Group trusted spots into rotors, fit a circle to each, refuse what is not one good rotor.

    All rows come back; those that are not trusted belong to no rotor.
    """
    seen = [name for name in _LOOKED_AT if name in localisations]
    found = find_rotors(localisations.loc[trusted, seen], settings["cluster"], settings["circle"])
    screening = screen(
        found.localisations,
        found.rotors,
        settings["screen"],
        n_frames=n_frames,
        drift_sd_nm=drift_sd_nm,
    )
    everything = localisations.assign(rotor=np.int64(-1))
    for column in ("rotor", "fit_flags"):
        values = np.zeros(len(everything), np.int64)
        if column in everything:
            values[:] = everything[column]
        values[trusted] = found.localisations[column]
        everything[column] = values
    return Found(
        everything,
        screening.rotors,
        screening.decisions,
        found.distance_reason,
        found.duplicates,
        found.small_clusters,
    )


def move(
    localisations: pd.DataFrame,
    rotors: pd.DataFrame,
    settings: Settings,
    *,
    workers: int | None = None,
) -> Moved:
    """Follow each rotor's angle from frame to frame; measure speed, diffusion and switches."""
    movie = settings["movie"]
    workers = workers or parallel.default_workers()
    tracks = build_tracks(
        localisations,
        rotors,
        frame_interval_s=movie.frame_interval_s,
        gap_mode=settings["motion"].gap_mode,
    )
    measured = measure_motion(
        tracks,
        rotors,
        settings["motion"],
        frame_interval_s=movie.frame_interval_s,
        exposure_s=movie.exposure_s,
        workers=workers,
    )
    return Moved(tracks, **vars(measured))
