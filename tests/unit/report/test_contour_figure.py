from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from rotortrack.afm.options import ContourOptions
from rotortrack.afm.trace import trace_rods
from rotortrack.report.draw import draw_contours
from rotortrack.report.figures import contour
from rotortrack.simulate.afm import Microscope, image_rods, scatter_rods, worm_like_chain

sys.path.insert(0, str(Path(__file__).parent))
from mock_run import clipped, overlaps


def scene(seed, shape, count, *, dense=False, known=450.0):
    rng = np.random.default_rng(seed)
    scope = Microscope(shape=shape)
    rods = {"contour_nm": 450.0, "persistence_nm": 1200.0}
    if dense:
        field = 5.0 * np.array(shape[::-1])
        spines = [worm_like_chain(rng, 444.0, 1200.0) + rng.uniform(0, field) for _ in range(count)]
    else:
        spines = scatter_rods(rng, count, scope, **rods)
    image = image_rods(rng, scope, spines)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return trace_rods(image, 5.0, ContourOptions(contour_length_nm=known, resamples=100))


@pytest.mark.parametrize(
    ("shape", "count", "dense"),
    [
        *(((320, 320), 5, False), ((420, 420), 30, True), ((160, 480), 4, False)),
        *(((480, 160), 4, False), ((140, 140), 1, False)),
    ],
)
def test_nothing_overlaps_whatever_the_rods(shape, count, dense):
    figure = contour.figure(scene(1, shape, count, dense=dense))
    assert overlaps(figure) == []
    assert clipped(figure) == []


def test_an_image_without_rods_says_so():
    noise = np.random.default_rng(0).normal(0.0, 0.1, (60, 80))
    figure = contour.figure(trace_rods(noise, 5.0))
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert {"no rods", "no rod of two segments"} <= set(texts)
    assert overlaps(figure) == []


def test_each_rod_has_its_number_and_each_refused_one_its_reason():
    found = scene(2, (360, 360), 10, dense=True)
    figure = contour.figure(found)
    texts = {text.get_text() for text in figure.axes[0].texts}
    wanted = {
        f"{row['rod']} {row['reason'].replace('_', ' ')}".strip()
        for row in found.rods.to_dict("records")
    }
    assert texts == wanted
    assert any("crossing" in text or "border" in text for text in texts)


def test_equal_images_give_equal_files(tmp_path):
    for name in ("a", "b"):
        draw_contours(tmp_path / name, scene(3, (240, 240), 3))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
