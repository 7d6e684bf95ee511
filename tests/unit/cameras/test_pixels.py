"""Saturated and dead pixels and empty frames, each put into counts where it must be found."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rotortrack.cameras import pixels
from rotortrack.cameras.pixels import check_pixels
from rotortrack.movies.movie import ArrayMovie
from rotortrack.movies.select import select


def counts(frames: int = 20, dtype: str = "uint16") -> NDArray[np.generic]:
    drawn = np.random.default_rng(1).integers(90, 110, (frames, 12, 16)).astype(dtype)
    drawn[0, 0, 0], drawn[1, 0, 0] = 89, 120
    return drawn


def test_sound_counts_have_no_faults() -> None:
    seen = check_pixels(ArrayMovie(counts()))
    assert (seen.frames, seen.least_adu, seen.largest_adu) == (20, 89, 120)
    assert seen.saturation_adu == 65535
    assert seen.saturated_pixels == seen.saturated_frames == seen.missing_pixels == 0
    assert seen.zero_frames == seen.constant_frames == seen.dead_rows == seen.dead_columns == ()
    assert seen.dead_pixels == 0
    assert seen.looks_like_bits is None


def test_each_fault_is_found_where_it_is() -> None:
    drawn = counts()
    drawn[:, 3] = 100
    drawn[:, :, 7] = np.arange(12)
    drawn[:, 9, 9] = 50
    drawn[4] = 0
    drawn[[5, 11]] = 77
    drawn[6, 1, :3] = 65535
    drawn[8, 1, 1] = 65535
    seen = check_pixels(ArrayMovie(drawn))
    assert seen.zero_frames == (4,)
    assert seen.constant_frames == (5, 11)
    assert seen.dead_rows == (3,)
    assert seen.dead_columns == (7,)
    assert seen.dead_pixels == 12 + 16 - 1 + 1
    assert (seen.saturated_pixels, seen.saturated_frames) == (4, 2)


def test_numbers_are_those_of_the_sensor_and_the_recording() -> None:
    drawn = counts()
    drawn[:, 5] = 100
    drawn[:, :, 7] = 100
    drawn[12] = 0
    part = select(ArrayMovie(drawn), region=(4, 2, 10, 9), frames=(8, 20))
    seen = check_pixels(part)
    assert (seen.zero_frames, seen.dead_rows, seen.dead_columns) == ((12,), (5,), (7,))


def test_a_given_saturation_counts_and_the_end_of_a_converter_is_recognised() -> None:
    drawn = counts()
    drawn[3, 4, 5] = 4095
    assert check_pixels(ArrayMovie(drawn)).looks_like_bits == 12
    seen = check_pixels(ArrayMovie(drawn), saturation_adu=4095.0)
    assert (seen.saturated_pixels, seen.saturated_frames) == (1, 1)


def test_numbers_that_are_none_are_counted_and_do_not_hide_the_rest() -> None:
    drawn = counts(dtype="float32")
    drawn[2, 3, 4] = np.nan
    drawn[:, 6, 6] = np.inf
    drawn[9] = np.nan
    seen = check_pixels(ArrayMovie(drawn))
    assert seen.missing_pixels == 1 + 19 + 12 * 16
    assert (seen.least_adu, seen.largest_adu) == (89, 120)
    assert seen.saturation_adu is None
    assert seen.zero_frames == seen.constant_frames == ()
    assert seen.dead_pixels == 1


def test_no_number_at_all_gives_no_range() -> None:
    seen = check_pixels(ArrayMovie(np.full((9, 4, 4), np.nan)))
    assert math.isnan(seen.least_adu)
    assert math.isnan(seen.largest_adu)


def test_few_frames_do_not_make_pixels_dead() -> None:
    assert check_pixels(ArrayMovie(np.tile(counts()[:1], (7, 1, 1)))).dead_pixels == 0
    assert check_pixels(ArrayMovie(np.tile(counts()[:1], (8, 1, 1)))).dead_pixels == 12 * 16


def test_a_long_movie_is_sampled_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pixels, "MOST_BYTES", 5 * 12 * 16 * 2)
    drawn = counts(100)
    drawn[[0, 50, 99]] = 0
    seen = check_pixels(ArrayMovie(drawn))
    assert seen.frames == 5
    assert seen.zero_frames == (0, 99)


@settings(max_examples=40, deadline=None)
@given(block_bytes=st.integers(1, 20_000), seed=st.integers(0, 100))
def test_blocks_change_nothing(block_bytes: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    drawn = counts()
    drawn[rng.integers(0, 20, 2)] = rng.integers(0, 2)
    drawn[:, rng.integers(0, 12)] = 100
    movie = ArrayMovie(drawn)
    whole = check_pixels(movie, saturation_adu=108)
    steps: list[tuple[int, int]] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pixels, "_BLOCK_BYTES", block_bytes)
        again = check_pixels(
            movie, saturation_adu=108, progress=lambda done, total: steps.append((done, total))
        )
    assert again == whole
    assert steps[-1] == (20, 20)
