from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from rotortrack.report.figures import distances, speeds_distances
from rotortrack.twocolour.compare import compare_groups
from rotortrack.twocolour.compare_options import CompareOptions
from rotortrack.twocolour.population import rod_population

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "twocolour"))
from mock_run import clipped, overlaps
from planted_groups import GRID, LENGTH_NM, group, scan_tables

FAST = {"resamples": 100, "permutations": 99, "twins": 2}


def compared(n_groups=1, n_scans=1, name="run", axes="log", **changed):
    groups = [
        dataclasses.replace(group(i, f"{name}{i}", n=20, mean_nm=180.0 + 30.0 * i), **changed)
        for i in range(n_groups)
    ]
    rods = rod_population(*scan_tables(GRID), length_nm=LENGTH_NM)
    scans = {f"scan{i}": rods for i in range(n_scans)}
    return compare_groups(groups, scans, CompareOptions(axes=axes, **FAST))


@pytest.mark.parametrize("draw", [distances.figure, speeds_distances.figure])
@pytest.mark.parametrize(
    ("n_groups", "n_scans", "name"),
    [
        (1, 0, "run"),
        (1, 1, "run"),
        (2, 1, "run"),
        (5, 1, "run"),
        (2, 1, "a-run-of-20-letters-" * 3),
    ],
)
def test_nothing_overlaps_whatever_is_compared(draw, n_groups, n_scans, name):
    figure = draw(compared(n_groups, n_scans, name))
    assert overlaps(figure) == []
    assert clipped(figure) == []


def test_bars_are_shares_whose_edges_and_n_are_told():
    shown = compared(2, 1)
    figure = distances.figure(shown)
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    for group_, label in zip(shown.groups, labels, strict=False):
        assert label.startswith(f"{group_.name}: measured, n = {group_.n} rotors")
    assert any("bins [low, high), the last bin closed" in text.get_text() for text in figure.texts)
    for axes in figure.axes:
        for patch in axes.patches:
            assert patch.get_data().values.sum() == pytest.approx(100.0)


def test_unresolved_rotors_are_counted_on_logarithmic_axes_and_shown_on_linear_ones():
    speed = np.full(20, 500.0)
    speed[:3] = 20.0
    for axes, words in (("log", "n = 17 + 3 unresolved"), ("linear", "n = 20)")):
        figure = speeds_distances.figure(compared(1, 1, axes=axes, speed_deg_s=speed))
        assert words in figure.axes[0].get_legend().get_texts()[0].get_text()


def test_rotors_without_speeds_say_so():
    figure = speeds_distances.figure(compared(1, 1, speed_deg_s=np.full(20, np.nan)))
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert "no rotor has both" in texts
    assert overlaps(figure) == []
