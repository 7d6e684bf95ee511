"""Frames of two colours belong together, or are refused."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.errors import MovieError
from rotortrack.movies.movie import ArrayMovie
from rotortrack.pipeline import colours


def movie(frames=10, width=8, times_s=None, numbers=None):
    made = ArrayMovie(np.zeros((frames, 8, width), np.uint16))
    made.times_s = None if times_s is None else np.asarray(times_s, float)
    made.numbers = None if numbers is None else np.asarray(numbers)
    return made


AT = np.arange(10) * 0.002


@pytest.mark.parametrize(
    ("first", "second", "told"),
    [
        (movie(), movie(width=9), r"frames of 8 x 8 pixels and movie of 9 x 8"),
        (movie(), movie(frames=9), r"10 frames and movie has 9, and neither tells the time"),
        (movie(times_s=AT), movie(times_s=AT * 1.2), r"out of step by up to 0.0036 s"),
        (
            movie(times_s=AT, numbers=np.arange(10)),
            movie(times_s=AT, numbers=np.arange(10) + 20),
            "no frame in common",
        ),
    ],
    ids=["size", "number", "step", "none"],
)
def test_what_does_not_belong_together_is_refused(first, second, told):
    with pytest.raises(MovieError, match=told):
        colours._check_together(first, second)


def test_a_dropped_frame_and_a_late_start_are_no_reason():
    numbers = np.delete(np.arange(10), 4)
    second = movie(frames=9, times_s=100.0 + AT[numbers], numbers=numbers)
    colours._check_together(movie(times_s=AT, numbers=np.arange(10)), second)
