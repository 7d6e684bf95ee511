"""Pieces of one rotor, and neighbours that are none."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from rotortrack.rotors.find import find_rotors
from rotortrack.rotors.fragments import find_fragments
from rotortrack.rotors.options import ClusterOptions
from rotortrack.rotors.per_frame import is_duplicate

FRAMES = 3000


def spots(rng, frame, x, y, noise=10.0):
    return pd.DataFrame(
        {
            "frame": frame,
            "x_nm": x + noise * rng.normal(size=frame.size),
            "y_nm": y + noise * rng.normal(size=frame.size),
            "uncertainty_nm": noise,
        }
    )


def seen_in(rng, part=None):
    return np.flatnonzero(rng.random(FRAMES) < (part or rng.uniform(0.4, 0.95)))


def broken_ring(rng, radius):
    """A ring with two dark arcs of 60 to 90 degrees, opposite each other."""
    theta = np.cumsum(rng.normal(0.0, math.sqrt(0.004 * rng.uniform(10.0, 60.0)), FRAMES))
    width = rng.uniform(0.52, 0.79)
    dark = np.abs((theta - rng.uniform(0.0, math.pi)) % math.pi - math.pi / 2) < width
    frame = np.intersect1d(seen_in(rng), np.flatnonzero(~dark))
    return spots(rng, frame, radius * np.cos(theta[frame]), radius * np.sin(theta[frame]))


def toggling(rng, radius):
    pole = np.cumsum(rng.random(FRAMES) < rng.uniform(0.005, 0.05)) % 2
    theta = math.pi * pole + rng.normal(0.0, 0.15, FRAMES)
    frame = seen_in(rng)
    return spots(rng, frame, radius * np.cos(theta[frame]), radius * np.sin(theta[frame]))


def neighbours(rng, radius):
    two = [seen_in(rng), seen_in(rng)]
    return pd.concat([spots(rng, frame, k * 1.5 * radius, 0.0) for k, frame in enumerate(two)])


def successors(rng, radius):
    """One emitter that another replaces."""
    moment, frame = FRAMES * rng.uniform(0.2, 0.8), seen_in(rng)
    early = frame < moment
    return pd.concat(
        [spots(rng, frame[early], 0.0, 0.0), spots(rng, frame[~early], 1.5 * radius, 0.0)]
    )


def side_by_side(rng, radius):
    theta = rng.uniform(0.0, 2.0 * math.pi, (2, FRAMES))
    two = [seen_in(rng), seen_in(rng)]
    return pd.concat(
        [
            spots(
                rng,
                frame,
                k * (2.0 * radius + 120.0) + radius * np.cos(theta[k][frame]),
                radius * np.sin(theta[k][frame]),
            )
            for k, frame in enumerate(two)
        ]
    )


def found_in(table, noise_nm=10.0):
    """Numbers of the clusters, and which of them are pieces."""
    found = find_rotors(table.reset_index(drop=True), ClusterOptions(distance_nm=60.0))
    single = found.localisations[~is_duplicate(found.localisations)]
    return list(found.rotors["rotor"]), find_fragments(single, noise_nm)


@pytest.mark.parametrize("kind", [broken_ring, toggling])
@pytest.mark.parametrize("noise_nm", [10.0, math.nan])
def test_pieces_of_one_rotor_are_named(kind, noise_nm):
    rng = np.random.default_rng(1)
    named = split = 0
    for _ in range(40):
        numbers, pieces = found_in(kind(rng, rng.uniform(110.0, 200.0)), noise_nm)
        split += len(numbers) > 1
        named += len(numbers) > 1 and pieces == dict.fromkeys(numbers, 0)
    assert split >= 38
    assert named >= 0.95 * split


@pytest.mark.parametrize("kind", [neighbours, successors, side_by_side])
def test_emitters_of_their_own_are_none(kind):
    rng = np.random.default_rng(2)
    for _ in range(40):
        numbers, pieces = found_in(kind(rng, rng.uniform(100.0, 150.0)))
        assert len(numbers) == 2
        assert pieces == {}


def test_a_spot_that_jumps_between_places_off_a_circle_is_no_rotor_in_pieces():
    rng = np.random.default_rng(3)
    place = rng.integers(0, 5, FRAMES)
    x, y = np.array([[0, 150, 0, 150, 75], [0, 0, 150, 150, 75]])[:, place].astype(float)
    assert found_in(spots(rng, np.arange(FRAMES), x, y))[1] == {}


def test_nothing_and_one_cluster_have_no_pieces():
    rng = np.random.default_rng(4)
    table = spots(rng, np.arange(200), np.zeros(200), 0.0).assign(rotor=0)
    assert find_fragments(table, 10.0) == {}
    assert find_fragments(table.iloc[:0], 10.0) == {}
    assert find_fragments(table.assign(rotor=-1), 10.0) == {}
