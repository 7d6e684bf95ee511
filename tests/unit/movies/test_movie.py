"""Movies in memory and parts of movies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError, MovieError
from rotortrack.movies.movie import ArrayMovie, Movie
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie
from rotortrack.movies.write import write_movie

COUNTS = np.arange(10 * 8 * 12, dtype=np.uint16).reshape(10, 8, 12)


def test_array_movie_gives_its_frames_in_native_order() -> None:
    movie: Movie = ArrayMovie(COUNTS.astype(">u2"))
    assert movie.dtype.isnative
    assert movie.reopen() is movie
    np.testing.assert_array_equal(movie.frames(2, 5), COUNTS[2:5])


@pytest.mark.parametrize(
    "array", [np.zeros((4, 4)), np.zeros((0, 4, 4)), np.zeros((2, 3, 4), complex)]
)
def test_array_that_is_no_movie_is_refused(array: np.ndarray) -> None:
    with pytest.raises(MovieError, match="is not a movie"):
        ArrayMovie(array)


@pytest.mark.parametrize(("start", "stop"), [(-1, 2), (3, 2), (0, 11)])
def test_frames_outside_the_movie_are_refused(start: int, stop: int) -> None:
    with pytest.raises(MovieError, match="it has 10"):
        ArrayMovie(COUNTS).frames(start, stop)


@given(st.data())
def test_selection_equals_slicing_and_keeps_sensor_coordinates(data: st.DataObject) -> None:
    start = data.draw(st.integers(0, 9))
    stop = data.draw(st.integers(start + 1, 10))
    x0, y0 = data.draw(st.integers(0, 11)), data.draw(st.integers(0, 7))
    width, height = data.draw(st.integers(1, 12 - x0)), data.draw(st.integers(1, 8 - y0))
    part = select(ArrayMovie(COUNTS), (x0, y0, width, height), (start, stop))
    assert part.shape == (stop - start, height, width)
    assert (part.origin_px, part.first_frame) == ((x0, y0), start)
    expected = COUNTS[start:stop, y0 : y0 + height, x0 : x0 + width]
    np.testing.assert_array_equal(part.frames(0, stop - start), expected)
    again = select(part, (x0, y0, 1, 1), (stop - 1, stop))
    assert again.frames(0, 1).item() == COUNTS[stop - 1, y0, x0]


def test_nothing_selected_is_the_movie_itself() -> None:
    movie = ArrayMovie(COUNTS)
    assert select(movie) is movie


def test_selection_outside_the_movie_names_both_mistakes() -> None:
    with pytest.raises(ConfigurationError) as caught:
        select(ArrayMovie(COUNTS), (6, 0, 7, 8), (5, 11))
    assert len(caught.value.mistakes) == 2
    assert "x 0 to 12" in caught.value.mistakes[0]
    assert "0 to 10" in caught.value.mistakes[1]


def test_selection_of_a_file_reopens_and_closes_its_own_handle(tmp_path: Path) -> None:
    write_movie(tmp_path / "m.tif", [COUNTS], shape=COUNTS.shape)
    with open_movie(tmp_path / "m.tif") as movie:
        part = select(movie, (1, 2, 3, 4), (5, 7))
        with part.reopen() as own:
            np.testing.assert_array_equal(own.frames(0, 2), COUNTS[5:7, 2:6, 1:4])
        np.testing.assert_array_equal(part.frames(1, 2), COUNTS[6:7, 2:6, 1:4])
        assert part.path == movie.path


def test_movie_in_memory_knows_no_files_and_no_times() -> None:
    movie = ArrayMovie(COUNTS)
    assert (movie.path, movie.paths, movie.notes, movie.missing_frames) == (None, (), (), 0)
    assert movie.times_s is None
    assert movie.numbers is None


def test_selection_cuts_times_and_numbers_like_frames() -> None:
    movie = ArrayMovie(COUNTS)
    movie.times_s, movie.numbers = 0.1 * np.arange(10), np.arange(10) + (np.arange(10) > 4)
    part = select(select(movie, frames=(2, 9)), frames=(4, 7))
    assert part.times_s is not None
    np.testing.assert_array_equal(part.times_s, movie.times_s[4:7])
    assert part.numbers is not None
    np.testing.assert_array_equal(part.numbers, [4, 6, 7])
