from __future__ import annotations

import numpy as np
import pytest
from skimage.morphology import skeletonize

from rotortrack.afm.skeleton import pieces_of


def drawn(*lines, shape=(60, 80), thick=2):
    """Thick strokes of (y0, x0, y1, x1), and their skeleton."""
    mask = np.zeros(shape, bool)
    for y0, x0, y1, x1 in lines:
        for part in np.linspace(0.0, 1.0, 400):
            y, x = round(y0 + part * (y1 - y0)), round(x0 + part * (x1 - x0))
            mask[max(y - thick, 0) : y + thick + 1, max(x - thick, 0) : x + thick + 1] = True
    return mask, skeletonize(mask)


def only(*lines, longest=8.0, **how):
    (piece,) = pieces_of(*drawn(*lines, **how), max_branch_px=longest)
    return piece


def length(line):
    return np.hypot(*np.diff(line, axis=0).T).sum()


@pytest.mark.parametrize("line", [(10, 10, 10, 60), (10, 10, 50, 12), (8, 8, 50, 60)])
def test_a_stroke_is_one_line_between_its_ends(line):
    piece = only(line)
    assert (len(piece.lines), piece.junctions, piece.closed, piece.at_border) == (
        1,
        0,
        False,
        False,
    )
    ends = sorted(piece.lines[0][[0, -1]].tolist())
    given = sorted([[line[1] + 0.5, line[0] + 0.5], [line[3] + 0.5, line[2] + 0.5]])
    assert np.array(ends) == pytest.approx(np.array(given), abs=4.0)
    # Neighbours in the list are neighbours in the image: nothing is left out.
    assert np.abs(np.diff(piece.lines[0], axis=0)).max() == 1.0


def test_a_side_branch_is_pruned_up_to_its_limit():
    lines = [(30, 8, 30, 70), (30, 40, 45, 40)]
    short = only(*lines, longest=20.0)
    assert (len(short.lines), short.junctions, len(short.pruned_px)) == (1, 0, 1)
    assert short.pruned_px[0] == pytest.approx(16.0, abs=3.0)
    assert length(short.lines[0]) == pytest.approx(62.0, abs=6.0)
    left = only(*lines, longest=6.0)
    assert (len(left.lines), left.junctions, left.pruned_px) == (3, 1, [])


def test_a_cross_has_four_arms():
    piece = only((30, 8, 30, 70), (5, 38, 55, 42))
    assert piece.junctions >= 1
    assert len([line for line in piece.lines if len(line) > 10]) == 4


def test_a_ring_is_closed():
    piece = only((10, 10, 10, 50), (10, 50, 45, 50), (45, 50, 45, 10), (45, 10, 10, 10))
    assert piece.closed
    assert (piece.lines[0][0] == piece.lines[0][-1]).all()


def test_the_border_and_separate_pieces_are_told():
    pieces = pieces_of(*drawn((20, 0, 20, 30), (40, 20, 40, 60)), max_branch_px=8.0)
    assert sorted(piece.at_border for piece in pieces) == [False, True]


def test_a_single_pixel_and_an_empty_image_do_no_harm():
    mask = np.zeros((9, 9), bool)
    assert pieces_of(mask, mask, max_branch_px=5.0) == []
    mask[4, 4] = True
    (piece,) = pieces_of(mask, mask, max_branch_px=5.0)
    assert piece.lines[0].tolist() == [[4.5, 4.5]]
