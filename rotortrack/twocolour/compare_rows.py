"""The rows of a comparison: effects with intervals, and p-values where rotors can be permuted."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.twocolour.compare_options import CompareOptions
from rotortrack.twocolour.forward import Twins
from rotortrack.twocolour.handedness import (
    ONE_SIDED,
    UNKNOWN,
    HandsCompared,
    compare_hands,
    compare_hands_with_rods,
    hands,
)
from rotortrack.twocolour.measured import MeasuredGroup, histograms
from rotortrack.twocolour.population import RodPopulation
from rotortrack.twocolour.resampling import (
    GRID_REFUSED,
    Curves,
    Effects,
    bootstrap,
    curves_of_counts,
    curves_of_values,
    effects,
    matched_p,
    permutation_p,
)

Floats = NDArray[np.float64]
Row = dict[str, Any]

_EFFECTS: Final = ("difference", "wasserstein", "energy", "ks")

_QUANTITIES: Final = (
    ("distance", "frames", "nm"),
    ("distance", "rotors", "nm"),
    ("mean_distance", "rotors", "nm"),
    ("true_distance", "rotors", "nm"),
    ("speed", "rotors", "deg/s"),
)
"""What is compared, what counts the same in it, and its unit; rods have no speed of their own."""


def measured_rows(
    first: MeasuredGroup,
    second: MeasuredGroup,
    fine: Floats,
    options: CompareOptions,
    rng: np.random.Generator,
) -> Iterator[Row]:
    """Compare two measured groups; a quantity that fewer than two rotors of one have is left out.

    Parameters
    ----------
    first, second
        The groups.
    fine
        Edges of the bins in which frames are counted, nm.
    options, rng
        How, and random numbers.
    """
    frames = curves_of_counts(np.concatenate([first.counts(fine), second.counts(fine)]), fine)
    for quantity, weight, unit in _QUANTITIES:
        parts = [_values(group, quantity) for group in (first, second)]
        known = np.concatenate([np.isfinite(part) for part in parts])
        is_first = (np.arange(len(known)) < first.n)[known]
        if not 2 <= is_first.sum() <= len(is_first) - 2:
            continue
        values = np.concatenate(parts)[known]
        if quantity == "distance":
            curves = Curves(frames.grid, frames.step, frames.cdf[known])
        else:
            curves = curves_of_values(values)
        each = _weights((first, second), weight)[known]
        members = [np.flatnonzero(is_first), np.flatnonzero(~is_first)]
        drawn = bootstrap(len(values), members, options.resamples, rng)
        found = effects(curves, each * is_first, each * ~is_first, drawn)
        p = permutation_p(curves, each, is_first, options.permutations, rng)
        yield {
            **_heads(first.name, second.name, quantity, weight, unit),
            **_numbers(found),
            "first_rotors": int(is_first.sum()),
            "second_rotors": int((~is_first).sum()),
            "first_frames": first.n_frames.sum() if quantity == "distance" else 0,
            "second_frames": second.n_frames.sum() if quantity == "distance" else 0,
            "first_mean": np.average(values[is_first], weights=each[is_first]),
            "second_mean": np.average(values[~is_first], weights=each[~is_first]),
            "p": p,
            "p_reason": "rotors permuted between the groups",
        }


def simulated_rows(
    group: MeasuredGroup,
    name: str,
    rods: RodPopulation,
    twins: Twins,
    fine: Floats,
    options: CompareOptions,
    rng: np.random.Generator,
) -> Iterator[Row]:
    """Compare a measured group with its simulated twins.

    Parameters
    ----------
    group, name, rods
        The group, and the scan that its twins are drawn from.
    twins
        Drawn with the same bins.
    fine, options, rng
        As for :func:`measured_rows`.
    """
    n, each = group.n, len(twins.mean_nm)
    is_first = np.arange(2 * n) < n
    # A rotor that is drawn brings its twins, whose noise is its own.
    drawn = np.tile(bootstrap(n, [np.arange(n)], options.resamples, rng), (1, 2))
    for quantity, weight, unit in _QUANTITIES[:-1]:
        measured = _values(group, quantity)
        simulated = twins.true_nm if quantity == "true_distance" else twins.mean_nm
        if quantity == "distance":
            own, of_twins = group.counts(fine), twins.counts
        else:
            one = np.ones(n, np.int64)
            own = histograms(measured, one, fine)
            of_twins = np.stack([histograms(values, one, fine) for values in simulated])
        # Twins of a rotor are drawn together, so that their sum will do.
        curves = curves_of_counts(np.concatenate([own, of_twins.sum(axis=0)]), fine)
        alone = _weights((group,), weight)
        both = np.tile(alone, 2)
        found = effects(curves, both * is_first, both * ~is_first, drawn)
        p, reason = math.nan, GRID_REFUSED
        if rods.declared:
            whole = curves_of_counts(np.concatenate([own, *of_twins]), fine)
            p = matched_p(whole, np.tile(alone, each + 1), n, options.permutations, rng)
            reason = "rotors permuted with their twins from the declared prior"
        in_frames = int(group.n_frames.sum()) if quantity == "distance" else 0
        yield {
            **_heads(group.name, name, quantity, weight, unit),
            **_numbers(found),
            "first_rotors": n,
            "second_rotors": rods.attractors,
            "first_frames": in_frames,
            "second_frames": in_frames,
            "first_mean": np.average(measured, weights=alone),
            "second_mean": np.average(simulated.mean(axis=0), weights=alone),
            "p": p,
            "p_reason": reason,
        }


def hand_rows(
    groups: Sequence[MeasuredGroup], scans: Mapping[str, RodPopulation], notes: list[str]
) -> Iterator[Row]:
    """Compare shares of rotors that turn counter-clockwise; `notes` gets why not, where not."""
    counted = {group.name: hands(group) for group in groups}
    if len(groups) + len(scans) > 1:
        notes += [UNKNOWN.format(name=name) for name, found in counted.items() if found is None]
    known = {name: found for name, found in counted.items() if found is not None}
    for (first, one), (second, other) in itertools.combinations(known.items(), 2):
        yield _hand_row(first, second, one.n, other.n, compare_hands(one, other))
    for (first, one), (second, rods) in itertools.product(known.items(), scans.items()):
        found = compare_hands_with_rods(one, rods)
        yield _hand_row(first, second, one.n, rods.attractors, found)
        if not rods.mirrored_starts:
            notes.append(ONE_SIDED.format(name=second))


def _hand_row(first: str, second: str, n_first: int, n_second: int, found: HandsCompared) -> Row:
    return {
        **_heads(first, second, "ccw_share", "rotors", ""),
        "first_rotors": n_first,
        "second_rotors": n_second,
        "first_mean": found.first.value,
        "second_mean": found.second.value,
        "difference": found.difference.value,
        "difference_ci_low": found.difference.low,
        "difference_ci_high": found.difference.high,
        "p": found.p,
        "p_reason": found.reason or "rotors permuted, all ways",
    }


def _values(group: MeasuredGroup, quantity: str) -> Floats:
    """Give one value a rotor; for frames their mean."""
    if quantity == "speed":
        return np.abs(group.speed_deg_s)
    return group.true_nm if quantity == "true_distance" else group.mean_nm


def _weights(groups: Sequence[MeasuredGroup], weight: str) -> Floats:
    frames = np.concatenate([group.n_frames for group in groups]).astype(np.float64)
    return frames if weight == "frames" else np.ones_like(frames)


def _heads(first: str, second: str, quantity: str, weight: str, unit: str) -> Row:
    return {"first": first, "second": second, "quantity": quantity, "weight": weight, "unit": unit}


def _numbers(found: Effects) -> dict[str, float]:
    numbers = {}
    for name in _EFFECTS:
        interval = getattr(found, name)
        ends = {"": interval.value, "_ci_low": interval.low, "_ci_high": interval.high}
        numbers.update({f"{name}{end}": value for end, value in ends.items()})
    return numbers
