from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from rotortrack.motion.link_options import LinkOptions
from rotortrack.motion.particles import track_particles
from rotortrack.report.draw import draw_particles
from rotortrack.report.figures import particles
from rotortrack.tables import LOCALISATIONS, empty

sys.path.insert(0, str(Path(__file__).parent))
from mock_run import clipped, overlaps

CLOCK = {"frame_interval_s": 0.01, "exposure_s": 0.01}


def drawn(table):
    found = track_particles(table, LinkOptions(search_range_nm=400.0), **CLOCK)
    return particles.figure(
        found.tracks, found.particles, found.ensemble, frame_interval_s=CLOCK["frame_interval_s"]
    )


@pytest.mark.parametrize(
    ("count", "diffusion", "frames"),
    [
        *((40, 0.1, 60), (1, 0.1, 200), (3, 1e-7, 40), (60, np.geomspace(1e-3, 1.0, 60), 80)),
        (2, 0.0, 12),
    ],
)
def test_nothing_overlaps_whatever_the_particles(swimming, count, diffusion, frames):
    table = swimming(np.random.default_rng(1), count, frames, diffusion_um2_s=diffusion)
    figure = drawn(table)
    assert overlaps(figure) == []
    assert clipped(figure) == []


def test_particles_that_stand_still_are_drawn_too(swimming):
    table = swimming(np.random.default_rng(3), 3, 30)
    figure = drawn(table.assign(x_nm=0.0, y_nm=1e4 * table["truth"]))
    assert overlaps(figure) == []


def test_no_particles_are_told():
    figure = drawn(empty(LOCALISATIONS))
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert texts.count("no particles") == 3
    assert overlaps(figure) == []


def test_a_small_diffusion_is_written_as_a_power():
    assert particles.significant(12.3, 0.5) == "(1.230 ± 0.050)·10⁻⁵"
    assert particles.significant(1.27e5, 1.4e4) == "0.127 ± 0.014"


def test_equal_tables_give_equal_files(swimming, tmp_path):
    table = swimming(np.random.default_rng(2), 5, 40)
    found = track_particles(table, LinkOptions(search_range_nm=400.0), **CLOCK)
    for name in ("a", "b"):
        draw_particles(
            tmp_path / name, found.tracks, found.particles, found.ensemble, frame_interval_s=0.01
        )
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
