"""Runs of a scan that end in one shape are told, however it is turned, mirrored or reversed."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.twocolour.attractors import label_attractors, shape_distance_nm

from .planted_groups import TURNS, arc, scan_tables


@pytest.mark.parametrize("turn_rad", [0.0, 0.7, 3.0])
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("step", [1, -1])
def test_a_turned_mirrored_or_reversed_shape_is_the_same(turn_rad, mirrored, step):
    other = arc(200.0, turn_rad, mirrored=mirrored)[::step]
    assert shape_distance_nm(arc(200.0), other) == pytest.approx(0.0, abs=1e-5)


def test_the_distance_is_that_of_the_best_of_many_turns():
    first, second = arc(200.0), arc(260.0, 0.4)
    z, w = (shape[:, 0] + 1j * shape[:, 1] for shape in (first, second))
    turns = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 20_001))
    found = [
        np.sqrt(np.mean(np.abs(z[:, None] - turns * image[::step, None]) ** 2, axis=0)).min()
        for image in (w, w.conj())
        for step in (1, -1)
    ]
    assert shape_distance_nm(first, second) == pytest.approx(min(found), rel=1e-6)


def test_a_mirror_image_is_another_shape_where_that_is_asked():
    mirror = arc(200.0, mirrored=True)
    assert shape_distance_nm(arc(200.0), mirror, mirrored=False) > 5.0


def test_a_shape_in_another_height_is_another_shape():
    assert shape_distance_nm(arc(200.0), arc(200.0) + np.array([0.0, 0.0, 7.0])) == pytest.approx(
        7.0
    )


def test_equal_shapes_of_one_cell_have_one_number_and_cells_share_none():
    runs, shapes = scan_tables(
        [
            (0.2, 120.0, TURNS, 200.0, 0.0, False),
            (0.2, 120.0, TURNS, 200.0, 1.0, True),
            (0.2, 120.0, TURNS, 260.0, 0.0, False),
            (0.26, 120.0, TURNS, 200.0, 0.0, False),
        ]
    )
    labels = label_attractors(runs, shapes, 3.0)
    assert labels[0] == labels[1]
    assert len(np.unique(labels)) == 3


def test_a_chain_of_close_shapes_is_one_shape():
    runs, shapes = scan_tables([(0.2, 120.0, TURNS, 200.0 + 8.0 * i, 0.0, False) for i in range(5)])
    steps = shape_distance_nm(shapes[0], shapes[1])
    assert shape_distance_nm(shapes[0], shapes[4]) > 2.0 * steps
    assert len(np.unique(label_attractors(runs, shapes, 1.5 * steps))) == 1
    assert len(np.unique(label_attractors(runs, shapes, 0.5 * steps))) == 5
