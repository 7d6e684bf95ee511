"""Which bead of the second colour is which of the first.

Grids of beads are periodic: shifted by one pitch they fit as well, and residuals cannot tell. Only
what breaks the period can: holes, displaced and brighter beads, and the grid's own edge. So every
shift that the places allow is followed to its end, all are judged by that evidence alone, and where
it does not decide, none is taken.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from rotortrack.errors import RegistrationError
from rotortrack.twocolour.options import RegisterOptions
from rotortrack.twocolour.polynomial import HIGHEST_ORDER, Frame, parameters_of, powers
from rotortrack.twocolour.robust import scale_of, tukey

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Region = tuple[int, int, int, int]

_BIN_NM = 100.0
_BLUR_NM = 250.0
"""Spread of the differences that distortion makes over the field."""

_MOST_CANDIDATES = 40
_LEAST_PEAK = 0.25
_REACH_NM = 600.0
"""Farthest from its predicted place that a bead is looked for."""

_CLOSE = 0.45
"""The same over the distance of neighbouring beads, beyond which the next bead is meant."""

_ROUNDS = 6
_LEAST_NM, _LEAST_LIGHT = 3.0, 0.02
_LEAST_PART = 0.5
"""Part of the beads that must find their partner."""

_LIKE = 0.1
"""Relative difference of spreads that means nothing."""

_FEWEST = 4
_DECIDED: Final = 5.0
"""Standard deviations from which one shift is taken and the others are not."""

_TOLD = 5


@dataclass(frozen=True)
class Pairs:
    """Beads of both colours that belong together.

    Attributes
    ----------
    first, second
        Their rows, (pairs,).
    shift_nm
        Mean of the second colour's places from the first's, each from its region's corner.
    mirror
        How the second image is flipped: none, left-right or top-bottom.
    spread_nm
        Standard deviation of a coordinate about a smooth map.
    evidence
        Standard deviations against the next best shift; infinite where there is none.
    """

    first: Integers
    second: Integers
    shift_nm: tuple[float, float]
    mirror: str
    spread_nm: float
    evidence: float


@dataclass(frozen=True)
class _Candidate:
    first: Integers
    second: Integers
    shift_nm: Floats
    mirror: str
    spread_nm: float
    lost: frozenset[tuple[int, int]]
    light_sd: float

    def over(self, other: _Candidate) -> float:
        """Tell by how many standard deviations the beads speak for this one, not the other."""
        pairs = np.array([len(self.first), len(other.first)], np.float64)
        # Twice the error of a normal sample: the scales are robust ones.
        error = math.hypot(_LIKE, math.sqrt(float(np.sum(1.0 / pairs))))
        places = math.log(max(other.spread_nm, _LEAST_NM) / max(self.spread_nm, _LEAST_NM)) / error
        light = math.log(max(other.light_sd, _LEAST_LIGHT) / max(self.light_sd, _LEAST_LIGHT)) / (
            math.sqrt(2.0) * error
        )
        # Beads that one shift pairs and the other loses, as in McNemar's test.
        here, there = len(other.lost - self.lost), len(self.lost - other.lost)
        losses = (here - there) / math.sqrt(max(here + there, 1.0))
        return places + light + losses


def pair_beads(
    first_nm: Floats,
    second_nm: Floats,
    first_photons: Floats,
    second_photons: Floats,
    *,
    regions: tuple[Region, Region],
    pixel_size_nm: float,
    options: RegisterOptions,
) -> Pairs:
    """Pair the beads of both colours.

    Parameters
    ----------
    first_nm, second_nm
        Places on the sensor, (beads, 2).
    first_photons, second_photons
        Brightness of each, in any unit.
    regions
        Where the colours are on the sensor, pixels.
    pixel_size_nm
        Size of a pixel.
    options
        The shift and the mirror, where known, and the largest shift.

    Raises
    ------
    RegistrationError
        A colour has too few beads, none fit, or several shifts fit equally well: all are told.
    """
    for colour, beads in (("first", first_nm), ("second", second_nm)):
        if len(beads) < _FEWEST:
            raise RegistrationError(
                "too few beads",
                f"the {colour} colour shows {len(beads)} beads: film a field with dozens of them",
            )
    sizes_nm = np.array(regions[0][2:], np.float64) * pixel_size_nm
    corners = [np.array(region[:2], np.float64) * pixel_size_nm for region in regions]
    one, other = first_nm - corners[0], second_nm - corners[1]
    mirrors = [options.mirror]
    if options.mirror == "auto":
        mirrors = ["none", "left-right", "top-bottom"]
    found: list[_Candidate] = []
    for mirror in mirrors:
        flipped = _flip(other, mirror, sizes_nm)
        for shift in _coarse_shifts(one, flipped, options):
            candidate = _follow(
                one, flipped, shift, (first_photons, second_photons), sizes_nm, mirror
            )
            if candidate is not None:
                _add(found, candidate)
    if not found:
        raise RegistrationError(
            "no match",
            f"no shift below {options.max_shift_nm:g} nm brings the beads of both colours "
            "together: look at both halves of the film, or give --shift-nm, --max-shift-nm or "
            "--mirror",
        )
    best = max(found, key=lambda one: min(_against(one, found), default=math.inf))
    evidence = min(_against(best, found), default=math.inf)
    if evidence < _DECIDED:
        raise _ambiguous(best, found)
    return Pairs(
        best.first,
        best.second,
        (float(best.shift_nm[0]), float(best.shift_nm[1])),
        best.mirror,
        best.spread_nm,
        evidence,
    )


def _against(one: _Candidate, found: list[_Candidate]) -> list[float]:
    return [one.over(other) for other in found if other is not one]


def _flip(places: Floats, mirror: str, sizes_nm: Floats) -> Floats:
    if mirror == "left-right":
        return np.column_stack([sizes_nm[0] - places[:, 0], places[:, 1]])
    if mirror == "top-bottom":
        return np.column_stack([places[:, 0], sizes_nm[1] - places[:, 1]])
    return places


def _coarse_shifts(first: Floats, second: Floats, options: RegisterOptions) -> Iterator[Floats]:
    """Give shifts of the second colour that many beads agree on, the most frequent first."""
    if options.shift_nm is not None:
        yield np.array(options.shift_nm, np.float64)
        return
    largest = options.max_shift_nm
    pairs = cKDTree(first).query_ball_tree(cKDTree(second), largest)
    rows = np.repeat(np.arange(len(first)), [len(near) for near in pairs])
    if not rows.size:
        return
    columns = np.concatenate([np.array(near, np.int64) for near in pairs if near])
    shifts = second[columns] - first[rows]
    edges = np.arange(-largest - _BIN_NM, largest + 2.0 * _BIN_NM, _BIN_NM)
    counts = np.histogram2d(shifts[:, 0], shifts[:, 1], bins=(edges, edges))[0]
    smooth = ndimage.gaussian_filter(counts, _BLUR_NM / _BIN_NM, mode="constant")
    peaks = (smooth == ndimage.maximum_filter(smooth, size=5)) & (
        smooth >= _LEAST_PEAK * smooth.max()
    )
    places = np.argwhere(peaks)
    order = np.argsort(-smooth[peaks], kind="stable")[:_MOST_CANDIDATES]
    middles = 0.5 * (edges[1:] + edges[:-1])
    for column, row in places[order]:
        yield np.array([middles[column], middles[row]])


def _follow(
    first: Floats,
    second: Floats,
    shift: Floats,
    photons: tuple[Floats, Floats],
    sizes_nm: Floats,
    mirror: str,
) -> _Candidate | None:
    """Pair beads from a rough shift on, by a map that follows the distortion better and better."""
    tree = cKDTree(second)
    spacing = float(np.median(np.asarray(tree.query(second, 2)[0])[:, 1]))
    reach = min(_REACH_NM, max(_CLOSE * spacing, 4.0 * _LEAST_NM))
    frame = Frame.about(first)
    predicted = first + shift
    rows = partners = np.zeros(0, np.int64)
    scale = reach
    for number in range(_ROUNDS):
        rows, partners = _mutual(predicted, second, tree, reach)
        if len(rows) < _FEWEST:
            return None
        order = _order(len(rows), number)
        columns = powers(frame.inside(first), order)
        coefficients, scale = _robust(columns[rows], second[partners])
        predicted = columns @ coefficients
        reach = min(reach, max(6.0 * scale, 4.0 * _LEAST_NM))
    rows, partners = _mutual(predicted, second, tree, reach)
    if len(rows) < _FEWEST:
        return None
    back = second - (predicted[rows] - first[rows]).mean(axis=0)
    lost = frozenset(
        (colour, int(row))
        for colour, (places, paired) in enumerate(((predicted, rows), (back, partners)))
        for row in _lost(places, paired, sizes_nm)
    )
    if len(rows) < _LEAST_PART * (len(rows) + 0.5 * len(lost)):
        return None
    light = np.log(np.maximum(photons[1][partners], 1e-9) / np.maximum(photons[0][rows], 1e-9))
    light_sd = 1.4826 * float(np.median(np.abs(light - np.median(light))))
    moved = (second[partners] - first[rows]).mean(axis=0)
    return _Candidate(rows, partners, moved, mirror, scale, lost, light_sd)


def _order(pairs: int, number: int) -> int:
    """Choose the order of the polynomial: low at first, and with three pairs a parameter."""
    order = 0 if pairs < 3 * parameters_of(1) else 1
    while order < min(number, 3, HIGHEST_ORDER) and pairs >= 3 * parameters_of(order + 1):
        order += 1
    return order


def _mutual(
    predicted: Floats, second: Floats, tree: cKDTree, reach: float
) -> tuple[Integers, Integers]:
    """Pair those that are nearest to each other and within reach."""
    distance, partner = (np.asarray(found) for found in tree.query(predicted))
    back = np.asarray(cKDTree(predicted).query(second)[1])
    rows = np.flatnonzero((distance <= reach) & (back[partner] == np.arange(len(predicted))))
    return rows, partner[rows].astype(np.int64)


def _robust(columns: Floats, targets: Floats) -> tuple[Floats, float]:
    """Fit by least squares with weights that mismatches do not pass."""
    weights = np.ones(len(columns))
    for _ in range(10):
        root = np.sqrt(weights)[:, np.newaxis]
        coefficients = np.linalg.lstsq(root * columns, root * targets, rcond=None)[0]
        residual = targets - columns @ coefficients
        scale = scale_of(residual, columns.shape[1])
        weights = tukey(residual, max(scale, 1e-3))
        if weights.sum() < columns.shape[1]:
            weights = np.ones(len(columns))
    return np.asarray(coefficients, np.float64), scale


def _lost(places: Floats, paired: Integers, sizes_nm: Floats) -> Integers:
    """List beads without a partner where the other colour is seen, but for the very edge."""
    margin = _REACH_NM / 2.0
    inside = np.all((places > margin) & (places < sizes_nm - margin), axis=1)
    inside[paired] = False
    return np.flatnonzero(inside)


def _add(found: list[_Candidate], candidate: _Candidate) -> None:
    """Keep a candidate unless it ended where another one did."""
    for number, other in enumerate(found):
        same = np.intersect1d(
            other.first * 10**6 + other.second, candidate.first * 10**6 + candidate.second
        ).size
        if other.mirror == candidate.mirror and same > 0.5 * min(
            len(other.first), len(candidate.first)
        ):
            if candidate.over(other) > 0.0:
                found[number] = candidate
            return
    found.append(candidate)


def _ambiguous(best: _Candidate, found: list[_Candidate]) -> RegistrationError:
    near = [best, *(one for one in found if one is not best and best.over(one) < _DECIDED)]
    told = "; ".join(
        f"{one.shift_nm[0]:.0f}, {one.shift_nm[1]:.0f}"
        + ("" if one.mirror == "none" else f" mirrored {one.mirror}")
        for one in near[:_TOLD]
    )
    more = f" and {len(near) - _TOLD} more" if len(near) > _TOLD else ""
    return RegistrationError(
        "ambiguous beads",
        f"the beads of both colours fit equally well with shifts (x, y nm) of {told}{more}: give "
        "the right one with --shift-nm, or film beads without a regular grid, or one with holes",
    )
