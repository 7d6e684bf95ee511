"""Calibration grids: pitch, jitter, holes, and what stays when an option changes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree

from rotortrack.simulate.film.fiducials import fiducial_points
from rotortrack.simulate.film.options import FiducialsOptions

SHAPE_PX, PIXEL_NM = (300, 280), 100.0


def points(seed=1, **options):
    x, y, photons = fiducial_points(FiducialsOptions(**options), SHAPE_PX, PIXEL_NM, seed)
    return np.stack([x, y], axis=1), photons


def test_neighbours_are_a_pitch_apart_along_turned_rows():
    places, _ = points(jitter_nm=0.0, missing=0.0, pitch_nm=1500.0, rotation_deg=2.0)
    assert len(places) == pytest.approx(29.0 * 27.0 / 1.5**2, rel=0.1)
    tree = KDTree(places)
    distance, near = tree.query(places, 2)
    assert distance[:, 1] == pytest.approx(1500.0)
    step = places[near[:, 1]] - places
    rows = np.degrees(np.arctan2(-step[:, 1], step[:, 0])) % 90.0
    assert rows == pytest.approx(2.0)


def test_points_keep_off_the_edge():
    places, _ = points()
    assert places.min() > 500.0
    assert (places < np.array([28000.0, 30000.0]) - 500.0).all()


def test_jitter_has_its_standard_deviation_and_moves_no_point_otherwise():
    still, _ = points(jitter_nm=0.0, missing=0.0)
    moved, _ = points(jitter_nm=20.0, missing=0.0)
    distance, near = KDTree(still).query(moved)
    assert len(set(near)) == len(moved)
    # The mean square of a two-dimensional normal: its relative sd is 1 / sqrt(points).
    assert np.mean(distance**2) == pytest.approx(2 * 20.0**2, rel=5 / np.sqrt(len(moved)))


def test_missing_points_are_among_those_of_the_whole_grid():
    whole, light = points(missing=0.0)
    holed, less = points(missing=0.2)
    n = len(whole)
    assert len(holed) == pytest.approx(0.8 * n, abs=5 * np.sqrt(0.16 * n))
    where = {tuple(place): row for place, row in zip(whole, light, strict=True)}
    assert all(tuple(place) in where for place in holed)
    assert all((where[tuple(p)] == row).all() for p, row in zip(holed, less, strict=True))


def test_photons_lie_in_their_range_and_differ_by_colour():
    _, photons = points(photons=(1000.0, 3000.0))
    assert photons.shape[1] == 2
    assert photons.min() >= 1000.0
    assert photons.max() <= 3000.0
    assert np.abs(photons[:, 0] - photons[:, 1]).max() > 500.0
    _, even = points(photons=2000.0)
    assert (even == 2000.0).all()


def test_the_seed_names_the_grid():
    assert (points(seed=3)[0] == points(seed=3)[0]).all()
    assert (
        points(seed=3)[0].shape != points(seed=4)[0].shape
        or (points(seed=3)[0] != points(seed=4)[0]).any()
    )


def test_a_field_without_room_has_no_points():
    x, y, photons = fiducial_points(FiducialsOptions(), (8, 8), 100.0, 1)
    assert (len(x), len(y), photons.shape) == (0, 0, (0, 2))
