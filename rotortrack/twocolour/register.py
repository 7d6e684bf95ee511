"""From the localised beads of both colours to the map of one onto the other."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from rotortrack.errors import RegistrationError, RegistrationWarning
from rotortrack.twocolour.fit import Fitted, best_map
from rotortrack.twocolour.options import RegisterOptions
from rotortrack.twocolour.pairing import pair_beads
from rotortrack.twocolour.registration import Beads, ErrorGrid, Region, Registration

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

_COLLINEAR, _NEARLY_COLLINEAR = 1e-3, 0.05
"""Least over largest extent of the beads about their middle."""

_ONE_CLUSTER, _MUCH_EMPTY = 0.02, 0.3
"""Part of the field that lies among the beads."""

_GRID = 33
_BLOCKS = 6
_FEWEST_A_BLOCK = 3
_SAME_BEAD_NM = 300.0
_SEEN_PART = 0.5
_JITTER_SD = 4.0
"""Squared length over its error from which a film's own shift counts."""


def register_beads(
    first: Sequence[pd.DataFrame],
    second: Sequence[pd.DataFrame],
    options: RegisterOptions,
    *,
    pixel_size_nm: float,
    regions: tuple[Region, Region],
) -> Registration:
    """Register the second colour onto the first.

    Parameters
    ----------
    first, second
        Localised beads of each film, one film a stage position: frame, x_nm, y_nm, photons, and
        uncertainty_nm where known. Places of a bead in the frames of a film are averaged.
    options
        How beads are paired, and the kind of the map.
    pixel_size_nm, regions
        Of the sensor; the regions that show the two colours.

    Raises
    ------
    RegistrationError
        The beads are too few, on one line, in one heap, or could be paired in several ways.

    Warns
    -----
    RegistrationWarning
        The beads lie nearly on a line, or leave much of the field empty.
    """
    firsts, seconds, films = [], [], []
    mirror = "none"
    for film, (one, other) in enumerate(zip(first, second, strict=True)):
        beads = [mean_places(table, options, pixel_size_nm) for table in (one, other)]
        pairs = pair_beads(
            beads[0][:, :2],
            beads[1][:, :2],
            beads[0][:, 2],
            beads[1][:, 2],
            regions=regions,
            pixel_size_nm=pixel_size_nm,
            options=options,
        )
        mirror = pairs.mirror
        firsts.append(beads[0][pairs.first, :2])
        seconds.append(beads[1][pairs.second, :2])
        films.append(np.full(len(pairs.first), film))
    of_first, of_second = np.concatenate(firsts), np.concatenate(seconds)
    film_of = np.concatenate(films)
    _check_spread(of_first, regions[0], pixel_size_nm)
    fitted, telling = best_map(of_second, of_first, options)
    shifts, jitter_nm = _jitter(fitted, film_of)
    if jitter_nm:
        fitted, telling = best_map(of_second, of_first - shifts[film_of], options)
    return _registration(
        fitted, telling, of_first, of_second, mirror, jitter_nm, pixel_size_nm, regions
    )


def mean_places(spots: pd.DataFrame, options: RegisterOptions, pixel_size_nm: float) -> Floats:
    """Average each bead over the frames; leave out beads with a close neighbour.

    Parameters
    ----------
    spots
        Localised beads of one film.
    options, pixel_size_nm
        As of :func:`register_beads`.

    Returns
    -------
    x_nm, y_nm and photons, (beads, 3).

    Raises
    ------
    RegistrationError
        No bead is known well enough.
    """
    if "uncertainty_nm" in spots:
        spots = spots[spots["uncertainty_nm"].to_numpy() <= options.max_uncertainty_nm]
    if spots.empty:
        raise RegistrationError(
            "too few beads",
            f"no bead is known to {options.max_uncertainty_nm:g} nm: film brighter ones, or raise "
            "--max-uncertainty-nm",
        )
    frames = spots["frame"].nunique()
    places = spots[["x_nm", "y_nm"]].to_numpy(np.float64)
    photons = spots["photons"].to_numpy(np.float64) if "photons" in spots else np.ones(len(spots))
    order = np.argsort(-photons, kind="stable")
    places, photons = places[order], photons[order]
    tree = cKDTree(places)
    # The brightest spot of a heap begins its bead, so that the order of rows does not matter.
    taken = np.zeros(len(places), bool)
    beads = []
    for row in range(len(places)):
        if taken[row]:
            continue
        members = np.array(tree.query_ball_point(places[row], _SAME_BEAD_NM))
        members = members[~taken[members]]
        taken[members] = True
        if members.size >= _SEEN_PART * frames:
            beads.append([*places[members].mean(axis=0), photons[members].mean()])
    found = np.array(beads).reshape(-1, 3)
    if len(found) > 1:
        nearest = np.asarray(cKDTree(found[:, :2]).query(found[:, :2], 2)[0])[:, 1]
        found = found[nearest >= options.min_separation_px * pixel_size_nm]
    return found


def _check_spread(places: Floats, region: Region, pixel_size_nm: float) -> None:
    """Refuse beads that leave the map undetermined."""
    if len(places) < 3:
        raise RegistrationError(
            "too few beads", f"{len(places)} beads are seen in both colours: film more"
        )
    about = places - places.mean(axis=0)
    extent = np.linalg.svd(about, compute_uv=False)
    if extent[1] <= _COLLINEAR * extent[0]:
        raise RegistrationError(
            "beads on a line",
            f"the {len(places)} beads lie on one line, which leaves the map across it open: film "
            "beads all over the field",
        )
    covered = ConvexHull(about).volume / (region[2] * region[3] * pixel_size_nm**2)
    if covered < _ONE_CLUSTER:
        raise RegistrationError(
            "beads in one heap",
            f"the {len(places)} beads cover {covered:.1%} of the field: film beads all over it",
        )
    if extent[1] <= _NEARLY_COLLINEAR * extent[0]:
        warnings.warn(
            "the beads lie nearly on one line, so that the map across it is hardly known: film "
            "beads all over the field",
            RegistrationWarning,
            stacklevel=3,
        )
    elif covered < _MUCH_EMPTY:
        warnings.warn(
            f"the beads cover {covered:.0%} of the field; places outside are extrapolated and "
            "flagged: film beads all over it",
            RegistrationWarning,
            stacklevel=3,
        )


def _jitter(fitted: Fitted, film_of: NDArray[np.int64]) -> tuple[Floats, float]:
    """Find what all beads of a film move together, where that is more than chance.

    Returns
    -------
    Shift of each film, (films, 2), and their rms per axis; zeros where it is chance.
    """
    count = int(film_of.max()) + 1
    none = np.zeros((count, 2))
    if count == 1:
        return none, 0.0
    used = fitted.used
    numbers = np.bincount(film_of[used], minlength=count)
    sums = np.stack(
        [np.bincount(film_of[used], fitted.residual[used, axis], count) for axis in (0, 1)], axis=1
    )
    means = sums / np.maximum(numbers, 1)[:, np.newaxis]
    errors = fitted.noise_nm / np.sqrt(np.maximum(numbers, 1))
    excess = float(np.sum((means / errors[:, np.newaxis]) ** 2)) - 2.0 * (count - 1)
    if excess <= _JITTER_SD * math.sqrt(4.0 * (count - 1)):
        return none, 0.0
    variance = float(np.mean(means**2) - np.mean(errors**2))
    return means - means.mean(axis=0), math.sqrt(max(variance, 0.0))


def _registration(
    fitted: Fitted,
    telling: Fitted,
    first: Floats,
    second: Floats,
    mirror: str,
    jitter_nm: float,
    pixel_size_nm: float,
    regions: tuple[Region, Region],
) -> Registration:
    noise_nm = telling.noise_nm
    # What a stiff map leaves beyond the beads' noise is an error of its own.
    left_nm2 = max(fitted.noise_nm**2 - noise_nm**2, 0.0)
    x0, y0, width, height = (edge * pixel_size_nm for edge in regions[0])
    x_nm, y_nm = np.linspace(x0, x0 + width, _GRID), np.linspace(y0, y0 + height, _GRID)
    made = Registration(
        mapping=fitted.mapping,
        regions=regions,
        pixel_size_nm=pixel_size_nm,
        beads=Beads(first, second, fitted.left_out, fitted.used),
        errors=ErrorGrid(x_nm, y_nm, np.zeros((_GRID, _GRID))),
        target_error_nm=0.0,
        bead_noise_nm=noise_nm,
        systematic_nm=_systematic(fitted, first, noise_nm),
        jitter_nm=jitter_nm,
        mirror=mirror,
    )
    at_beads = fitted.variance(second[fitted.used])
    grid = np.stack(np.meshgrid(x_nm, y_nm), axis=-1).reshape(-1, 2)
    # The error hardly changes within the distortion, so that its place need not be exact.
    places = _roughly_second(grid, first[fitted.used], second[fitted.used])
    variance = fitted.variance(places).reshape(_GRID, _GRID)
    errors = ErrorGrid(x_nm, y_nm, np.sqrt(variance * noise_nm**2 + left_nm2))
    target_nm = math.sqrt(float(at_beads.mean()) * noise_nm**2 + left_nm2)
    return dataclasses.replace(made, errors=errors, target_error_nm=target_nm)


def _systematic(fitted: Fitted, first: Floats, noise_nm: float) -> float:
    """Estimate by means over blocks of the field what neighbouring beads miss together."""
    used = fitted.used
    low, high = first[used].min(axis=0), first[used].max(axis=0)
    cells = np.minimum((first[used] - low) / np.maximum(high - low, 1e-9) * _BLOCKS, _BLOCKS - 1e-9)
    block = cells.astype(np.int64) @ (1, _BLOCKS)
    numbers = np.bincount(block, minlength=_BLOCKS**2)
    many = numbers >= _FEWEST_A_BLOCK
    if not many.any():
        return math.nan
    residual = fitted.left_out[used]
    sums = np.stack([np.bincount(block, residual[:, axis], _BLOCKS**2) for axis in (0, 1)], axis=1)
    means = sums[many] / numbers[many, np.newaxis]
    chance = noise_nm**2 / numbers[many]
    weights = numbers[many] / numbers[many].sum()
    excess = float(np.sum(weights * (0.5 * np.sum(means**2, axis=1) - chance)))
    return math.sqrt(max(excess, 0.0))


def _roughly_second(places: Floats, first: Floats, second: Floats) -> Floats:
    """Map places of the first colour to the second by the affine map of the beads."""
    columns = np.column_stack([np.ones(len(first)), first])
    coefficients = np.linalg.lstsq(columns, second, rcond=None)[0]
    mapped: Floats = np.column_stack([np.ones(len(places)), places]) @ coefficients
    return mapped
