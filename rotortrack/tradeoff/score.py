"""How far the analysis of a film agrees with its truth."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.exchange.parquet import read_table
from rotortrack.localise.precision import bound_nm
from rotortrack.simulate.film.optics import gaussian_widths_nm
from rotortrack.simulate.film.options import PsfOptions
from rotortrack.simulate.film.truth import SPOTS
from rotortrack.tradeoff.matching import match_rotors, match_spots

Floats = NDArray[np.float64]

KEPT: Final = ("driven", "brownian", "switching", "two_position")
"""Motions of which the screening is to keep single rotors that are there all the time."""

MEASURED: Final = ("driven", "brownian")
"""Motions that have a speed and a diffusion coefficient to compare with."""


@dataclass(frozen=True)
class Truth:
    """What is true in a film.

    Attributes
    ----------
    spots
        Of schema `film_spots`, those of the first colour that shine.
    rotors
        One row a rotor, with `double` (its pore held two), `mean_omega_rad_s` (under the scene's
        voltage), `expected` (the verdict that screening should give; empty where either is right)
        and `behaviour` (empty where none is asked for).
    background, sigma_nm, pixel_size_nm, read_noise_e, efficiency
        For the bound of a position; the last one is the part of the photons that is detected.
    drifts
        Whether the stage moved.
    """

    spots: pd.DataFrame
    rotors: pd.DataFrame
    background: float
    sigma_nm: float
    pixel_size_nm: float
    read_noise_e: float
    efficiency: float = 1.0
    drifts: bool = False


@dataclass(frozen=True)
class Score:
    """One analysis of one film against its truth.

    Attributes
    ----------
    spots
        Counts and sums over spots: found, true, matched, squared errors.
    rotors
        The truth's rotors, one row each, with what was found of them: columns of the run's rotors
        prefix `found_`; `found` tells whether any rotor was, and `stage_x_nm` and `stage_y_nm`
        where the analysis thinks that the stage began, 0 where it did not move.
    false_rotors
        Rotors kept where there is none.
    """

    spots: dict[str, float]
    rotors: pd.DataFrame
    false_rotors: int


def read_truth(folder: Path) -> Truth:
    """Read the truth beside a film.

    Parameters
    ----------
    folder
        As `rotortrack simulate film` writes it.

    Raises
    ------
    OSError, TableError
        A file is missing or cannot be read.
    """
    scene = tomllib.loads((folder / "scene.toml").read_text(encoding="utf-8"))
    spots = read_table(folder / "spots.parquet", SPOTS)
    spots = spots[(spots["channel"] == 0) & (spots["photons"] > 0.0)].reset_index(drop=True)
    drift = folder / "drift.csv"
    if drift.exists():
        moved = pd.read_csv(drift).set_index("frame").loc[spots["frame"]]
        spots["x_nm"] -= moved["dx_nm"].to_numpy()
        spots["y_nm"] -= moved["dy_nm"].to_numpy()
    film, camera = scene["film"], scene.get("camera", {})
    rotors = pd.read_csv(folder / "rotors.csv", keep_default_na=True)
    duration_s = film["n_frames"] * film["frame_interval_s"]
    rotors = _judged(rotors, scene.get("voltage"), duration_s)
    return Truth(
        spots=spots,
        rotors=rotors,
        background=float(scene.get("background", {}).get("photons", 0.0)),
        sigma_nm=_width_nm(PsfOptions(**scene.get("psf", {}))),
        pixel_size_nm=float(film["pixel_size_nm"]),
        read_noise_e=float(camera.get("read_noise_e", 0.0)),
        efficiency=float(camera.get("quantum_efficiency", 1.0)),
        drifts=drift.exists(),
    )


def score(truth: Truth, localisations: pd.DataFrame, rotors: pd.DataFrame) -> Score:
    """Compare one run with the truth.

    Parameters
    ----------
    truth
        Of the film.
    localisations, rotors
        Tables of the run; positions are compared without the drift that either side tells.

    Returns
    -------
    Score
    """
    matched = match_spots(localisations, truth.spots)
    hits = np.flatnonzero(matched >= 0)
    true_rotor = truth.spots["rotor"].to_numpy()[matched[hits]]
    found_rotor = localisations["rotor"].to_numpy()[hits]
    owners = match_rotors(found_rotor, true_rotor)
    # Two rotors on one pore hide each other; their spots tell nothing of the fit.
    single = ~truth.rotors["double"].to_numpy(bool)[true_rotor]
    spots = _spot_numbers(truth, localisations, matched, hits[single])
    table = truth.rotors.copy()
    chosen = _chosen(owners, rotors)
    rows = rotors.set_index("rotor")
    found = [chosen.get(number) for number in table["rotor"]]
    # Both rotors of a pore are judged by what was found there.
    at_pore: dict[int, int] = {}
    for pore, number in zip(table["pore"].tolist(), found, strict=True):
        if number is not None:
            at_pore.setdefault(pore, number)
    table["found_rotor"] = [
        number if number is not None else (at_pore.get(pore, -1) if double else -1)
        for pore, double, number in zip(table["pore"], table["double"], found, strict=True)
    ]
    taken = rows.reindex(table["found_rotor"]).add_prefix("found_").reset_index(drop=True)
    table = pd.concat([table.reset_index(drop=True), taken], axis=1)
    table["found"] = table["found_rotor"] >= 0
    for name in ("x_nm", "y_nm"):
        errors = _errors(truth, localisations, matched, hits[single], name)
        known = truth.drifts and errors.size > 0
        table[f"stage_{name}"] = float(np.median(errors)) if known else 0.0
    false = [n for n in rows.index if n not in owners and rows.loc[n, "verdict"] == "kept"]
    return Score(spots, table, len(false))


def _chosen(owners: dict[int, tuple[int, int]], rotors: pd.DataFrame) -> dict[int, int]:
    """Give each true rotor the found one that shares most of its spots."""
    known = set(rotors["rotor"].tolist())
    best: dict[int, tuple[int, int]] = {}
    for number, (true, count) in owners.items():
        if number in known and count > best.get(true, (-1, 0))[1]:
            best[true] = (number, count)
    return {true: number for true, (number, _) in best.items()}


def _spot_numbers(
    truth: Truth, found: pd.DataFrame, matched: NDArray[np.int64], hits: NDArray[np.int64]
) -> dict[str, float]:
    rows = matched[hits]
    errors = np.stack([_errors(truth, found, matched, hits, name) for name in ("x_nm", "y_nm")])
    # Where the stage stood in the first frame is nobody's error.
    errors -= np.median(errors, axis=1, keepdims=True) if errors.size else 0.0
    sds = np.stack([found[name].to_numpy(float)[hits] for name in ("x_sd_nm", "y_sd_nm")])
    photons = truth.spots["photons"].to_numpy()[rows]
    bounds = np.array([truth_bound(truth, light) for light in np.unique(np.round(photons, -1))])
    bound = bounds[np.searchsorted(np.unique(np.round(photons, -1)), np.round(photons, -1))]
    within = np.abs(errors) < _OUTLIER * bound
    known = within & (sds > 0.0)
    return {
        "found": float(len(found)),
        "true": float(len(truth.spots)),
        "matched": float((matched >= 0).sum()),
        "errors": float(within.sum()),
        "outliers": float((~within).sum()),
        "square_nm2": float((errors[within] ** 2).sum()),
        "square_over_bound": float(((errors / bound)[within] ** 2).sum()),
        "with_sd": float(known.sum()),
        "square_over_sd": float(((errors[known] / sds[known]) ** 2).sum()),
    }


def _errors(
    truth: Truth,
    found: pd.DataFrame,
    matched: NDArray[np.int64],
    hits: NDArray[np.int64],
    name: str,
) -> Floats:
    errors: Floats = (
        found[name].to_numpy(float)[hits] - truth.spots[name].to_numpy(float)[matched[hits]]
    )
    return errors


_OUTLIER = 10.0
"""Errors of more bounds than this are told apart: mismatches, not fits."""


def truth_bound(truth: Truth, photons: float) -> float:
    """Cramer-Rao bound per axis of a spot that stands still, nm."""
    return bound_nm(
        max(truth.efficiency * photons, 1.0),
        background=max(truth.efficiency * truth.background, 1e-3),
        sigma_nm=truth.sigma_nm,
        pixel_size_nm=truth.pixel_size_nm,
        read_noise_e=truth.read_noise_e,
    )


def _width_nm(psf: PsfOptions) -> float:
    """Width of the Gaussian that a spot is, or that is nearest to its Airy pattern, nm."""
    if psf.model == "airy":
        return _AIRY_WIDTH * psf.wavelength_nm / psf.numerical_aperture
    return math.sqrt(math.prod(gaussian_widths_nm(psf)))


_AIRY_WIDTH = 0.225
"""Zhang et al. 2007: the Gaussian that fits an Airy pattern best, over wavelength / NA."""


def _mean_drives(voltage: dict[str, Any], begin_s: Floats, end_s: Floats) -> Floats:
    """Mean factor of all speeds between two times, for each pair of them."""
    factors = np.array(voltage["voltages_mv"]) / voltage["reference_mv"]
    starts = np.array(voltage["times_s"])
    stops = np.append(starts[1:], np.inf)
    spans = np.minimum(end_s[:, np.newaxis], stops) - np.maximum(begin_s[:, np.newaxis], starts)
    spans = np.maximum(spans, 0.0)
    means: Floats = spans @ factors / np.maximum(spans.sum(axis=1), 1e-300)
    return means


def _judged(
    rotors: pd.DataFrame, voltage: dict[str, Any] | None, duration_s: float
) -> pd.DataFrame:
    """Add to the truth what a perfect analysis would say."""
    begin_s = rotors["arrive_s"].to_numpy(float)
    end_s = np.minimum(rotors["leave_s"].to_numpy(float), duration_s)
    # What comes after the film's end shares a pore with nobody.
    seen = begin_s < end_s
    pores = rotors["pore"].where(seen, -1 - rotors["rotor"])
    rotors["double"] = pores.duplicated(keep=False)
    drives = 1.0 if voltage is None else _mean_drives(voltage, begin_s, end_s)
    rotors["mean_omega_rad_s"] = drives * rotors["omega_rad_s"]
    motion, omega = rotors["motion"], rotors["mean_omega_rad_s"]
    always = (begin_s <= 0.0) & (end_s >= duration_s)
    expected = np.where(motion.isin(KEPT) & always, "kept", "")
    expected = np.where(motion == "stuck", "refused", expected)
    rotors["expected"] = np.where(rotors["double"], "refused", expected)
    names = motion.map(
        {
            "brownian": "brownian",
            "switching": "switching",
            "two_position": "toggling",
            "stuck": "stuck",
            "tethered": "confined",
            "arc": "confined",
        }
    ).fillna("")
    turns = np.where(omega > 0.0, "driven_ccw", "driven_cw")
    behaviour = np.where(motion == "driven", turns, names)
    rotors["behaviour"] = np.where(rotors["double"], "", behaviour)
    return rotors
