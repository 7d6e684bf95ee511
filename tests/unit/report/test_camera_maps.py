"""The picture of camera maps stays readable for sensors of all kinds."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotortrack.report.figures import camera_maps

sys.path.insert(0, str(Path(__file__).parent))
from mock_run import clipped, overlaps


def maps(shape: tuple[int, int] = (60, 80), **changes: Any) -> dict[str, Any]:
    rng = np.random.default_rng(1)
    read = np.exp(rng.normal(0.2, 0.2, shape))
    found = {
        "offset_adu": rng.normal(100, 1.5, shape),
        "gain_e_per_adu": rng.normal(0.46, 0.005, shape),
        "read_noise_e": read,
        "hot_pixels": read > 2.2,
        "dead_pixels": np.zeros(shape, np.bool_),
        "hot_limit_e": 2.2,
        "made_from": "1000 dark frames, 2000 frames of 4 flats",
    }
    return found | changes


EXTREMES = {
    "plain": maps(),
    "large": maps((512, 512)),
    "strip": maps((8, 200)),
    "tower": maps((200, 8)),
    "one pixel": maps((1, 1)),
    "one gain": maps(gain_e_per_adu=np.full((60, 80), 0.46)),
    "all dead": maps(dead_pixels=np.ones((60, 80), np.bool_), hot_limit_e=np.inf),
    "all hot": maps(hot_pixels=np.ones((60, 80), np.bool_)),
    "no noise": maps(read_noise_e=np.zeros((60, 80)), hot_limit_e=np.inf),
    "large numbers": maps(offset_adu=np.random.default_rng(2).normal(31_000, 900, (60, 80))),
    "small numbers": maps(gain_e_per_adu=np.random.default_rng(2).normal(1e-4, 1e-6, (60, 80))),
    "long words": maps(made_from="many frames of flats, " * 9),
}


@pytest.mark.parametrize("extreme", EXTREMES)
def test_no_text_overlaps_or_leaves_the_page(extreme: str) -> None:
    figure = camera_maps.figure(**EXTREMES[extreme])
    assert overlaps(figure) == []
    assert clipped(figure) == []


def test_maps_show_ordinary_pixels_and_mark_the_others() -> None:
    values = maps()
    values["read_noise_e"][5, 7] = 300.0
    values["hot_pixels"][5, 7] = True
    values["dead_pixels"][9, 11] = True
    figure = camera_maps.figure(**values)
    images = [axes for axes in figure.axes if axes.images]
    shown = next(axes for axes in images if axes.get_title(loc="left").startswith("Read noise"))
    image = shown.images[0]
    assert image.get_clim()[1] < 2.5
    assert np.ma.getmaskarray(image.get_array())[9, 11] or np.isnan(image.get_array()[9, 11])
    bottom, top = shown.get_ylim()
    assert bottom > top
    marked = next(axes for axes in figure.axes if "hot pixel" in axes.get_title(loc="left"))
    hot, dead = (line.get_xydata().tolist() for line in marked.lines)
    assert [7.5, 5.5] in hot
    assert dead == [[11.5, 9.5]]
