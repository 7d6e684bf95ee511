"""What a user's movie is like is measured in some of its frames."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from rotortrack.errors import MovieError
from rotortrack.movies.movie import ArrayMovie
from rotortrack.pipeline.localise_run import OpenedMovie
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.settings import Layer, resolve
from rotortrack.tradeoff.own_movie import SPAN_FRAMES, SPANS, groups, measure, spread
from rotortrack.tradeoff.questions import ON_MOVIES
from rotortrack.tradeoff.questions import filter as spot_filter


def opened(counts, camera):
    values = {"movie": {"pixel_size_nm": 100.0}, "localise": {"max_emitters": 1}}
    return OpenedMovie(ArrayMovie(counts), resolve(SECTIONS, [Layer("test", values)]), camera)


def test_spots_and_background_are_measured_as_they_were_filmed():
    camera, counts, _ = spot_filter.filmed(spot_filter.Film(500.0, 10.0), 64)
    measured = measure(opened(counts, camera))
    assert measured.photons["usual"] == pytest.approx(500.0, rel=0.03)
    assert measured.background == pytest.approx(spot_filter.BACKGROUND, rel=0.05)
    assert measured.sigma_px == pytest.approx(spot_filter.SIGMA_PX, rel=0.03)
    assert measured.spots_per_frame == pytest.approx(10.0, rel=0.1)
    assert (measured.frames, measured.seen_frames) == (64, 64)
    assert "64 of 64 frames" in measured.sentence
    asked = groups(measured)
    assert set(asked) == set(ON_MOVIES)
    assert [spots.photons for spots in asked["localiser"].values()] == list(
        measured.photons.values()
    )


def test_a_movie_without_spots_says_so():
    camera, counts, _ = spot_filter.filmed(spot_filter.Film(500.0, 10.0), 2)
    with pytest.raises(MovieError, match="too few to tell"):
        measure(opened(np.full_like(counts, 120), camera))


def test_frames_are_spread_over_a_long_movie_and_all_of_a_short_one():
    assert spread(100) == [(0, 100)]
    spans = spread(100_000)
    assert len(spans) == SPANS
    assert spans[0][0] == 0
    assert spans[-1][1] == 100_000
    assert all(stop - start == SPAN_FRAMES for start, stop in spans)
    assert all(b[0] > a[1] for a, b in itertools.pairwise(spans))
