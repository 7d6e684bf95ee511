"""Mean and variance over a film, against two plain passes over all of it."""

from __future__ import annotations

import dataclasses
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rotortrack.cameras.film_statistics import FilmStatistics, film_statistics
from rotortrack.errors import CameraError

sys.path.insert(0, str(Path(__file__).parent))
from sensor import sensor

OFFSET = sensor((24, 30)).offset


def dark(frames: int = 60, seed: int = 1) -> NDArray[np.uint16]:
    return sensor((24, 30)).film(0, frames, np.random.default_rng(seed))


def flat(frames: int = 60, seed: int = 2, flicker: float = 0.0) -> NDArray[np.uint16]:
    return sensor((24, 30)).film(400, frames, np.random.default_rng(seed), flicker=flicker)


def maps(found: FilmStatistics) -> dict[str, NDArray[Any]]:
    return {name: getattr(found, name) for name in ("mean", "variance", "successive")}


def plainly(film: NDArray[Any], offset: NDArray[Any] | None) -> dict[str, NDArray[Any]]:
    """Fit what all pixels share, subtract it, and look at what is left."""
    film = film.astype(np.float64)
    n, pixels = len(film), film[0].size
    if offset is None:
        shared = film.mean(axis=(1, 2), keepdims=True) - film.mean()
        rest = film - film.mean(axis=0) - shared
        mean, share = film.mean(axis=0), 1 / pixels
    else:
        above = film - offset
        level = above.mean(axis=(1, 2), keepdims=True)
        pattern = (level * above).sum(axis=0) / (level**2).sum()
        rest = above - level * pattern
        mean = film.mean(axis=0)
        share = above.mean(axis=0) / above.mean() / pixels
    return {
        "mean": mean,
        "variance": (rest**2).sum(axis=0) / (n - 1) / (1 - share),
        "successive": (np.diff(rest, axis=0) ** 2).sum(axis=0) / 2 / (n - 1) / (1 - share),
    }


@pytest.mark.parametrize("offset", [None, OFFSET])
@pytest.mark.parametrize("dtype", [np.uint16, np.int32, np.float32, np.float64])
def test_maps_are_those_of_two_plain_passes(offset: Any, dtype: Any) -> None:
    film = (dark() if offset is None else flat(flicker=0.03)).astype(dtype)
    found = film_statistics([film], offset_adu=offset)
    for name, values in plainly(film, offset).items():
        np.testing.assert_allclose(maps(found)[name], values, rtol=1e-5)
    assert found.frames == len(film)
    np.testing.assert_array_equal(found.largest, film.max(axis=0))
    assert found.largest.dtype == dtype


@given(cuts=st.lists(st.integers(0, 60), max_size=8), lit=st.booleans())
def test_no_bit_depends_on_how_the_film_is_cut(cuts: list[int], lit: bool) -> None:
    film, offset = (flat(flicker=0.02), OFFSET) if lit else (dark(), None)
    whole = film_statistics([film], offset_adu=offset)
    parts = film_statistics(np.split(film, sorted(cuts)), offset_adu=offset)
    for field in dataclasses.fields(whole):
        np.testing.assert_array_equal(getattr(parts, field.name), getattr(whole, field.name))


@given(seed=st.integers(0, 1000), lit=st.booleans())
def test_the_order_of_frames_does_not_matter(seed: int, lit: bool) -> None:
    film, offset = (flat(flicker=0.02), OFFSET) if lit else (dark(), None)
    shuffled = film[np.random.default_rng(seed).permutation(len(film))]
    one, other = (film_statistics([f], offset_adu=offset) for f in (film, shuffled))
    np.testing.assert_allclose(one.mean, other.mean, rtol=1e-6)
    np.testing.assert_allclose(one.variance, other.variance, rtol=1e-5)


@given(factor=st.integers(1, 20), added=st.integers(0, 20_000), lit=st.booleans())
def test_counts_that_are_scaled_and_shifted(factor: int, added: int, lit: bool) -> None:
    film, offset = (flat(), OFFSET) if lit else (dark(), None)
    moved = film_statistics(
        [film.astype(np.int32) * factor + added],
        offset_adu=None if offset is None else offset * factor + added,
    )
    found = film_statistics([film], offset_adu=offset)
    np.testing.assert_allclose(moved.mean, found.mean * factor + added, rtol=1e-6)
    np.testing.assert_allclose(moved.variance, found.variance * factor**2, rtol=2e-5)


def test_flicker_and_a_wandering_offset_leave_the_variance_alone() -> None:
    steady = film_statistics([flat(400)], offset_adu=OFFSET)
    flickering = film_statistics([flat(400, flicker=0.05)], offset_adu=OFFSET)
    # 5 % of 870 counts would add 1900 to a variance of 1900.
    assert flickering.variance.mean() == pytest.approx(steady.variance.mean(), rel=0.01)
    assert flickering.levels.std() / flickering.levels.mean() == pytest.approx(0.05, rel=0.15)
    still = dark(400)
    moved = still + np.arange(400, dtype=np.uint16)[:, None, None]
    one, other = film_statistics([still]), film_statistics([moved])
    np.testing.assert_allclose(other.variance, one.variance, rtol=1e-4)
    np.testing.assert_allclose(other.mean, one.mean + 199.5, rtol=1e-6)
    assert np.ptp(other.levels) > 390


def test_differences_of_successive_frames_do_not_see_a_slow_change_of_the_pattern() -> None:
    film = flat(400).astype(np.float64)
    tilt = np.linspace(-1, 1, 30) * 40 * np.linspace(-1, 1, 400)[:, None, None]
    found = film_statistics([film + tilt], offset_adu=OFFSET)
    steady = film_statistics([film], offset_adu=OFFSET)
    assert found.variance.mean() > 1.05 * steady.variance.mean()
    assert found.successive.mean() == pytest.approx(steady.successive.mean(), rel=1e-3)


def test_frames_without_a_picture_and_copies_are_left_out() -> None:
    film = flat(30)
    black, full = np.zeros_like(film[:1]), np.full_like(film[:1], 65535)
    with_lost = np.concatenate([black, film[:10], film[9:10], film[10:], full])
    found = film_statistics([with_lost[:11], with_lost[11:]], offset_adu=OFFSET)
    whole = film_statistics([film], offset_adu=OFFSET)
    assert (found.frames, found.skipped) == (30, 3)
    np.testing.assert_array_equal(found.variance, whole.variance)
    np.testing.assert_array_equal(found.largest, whole.largest)


def test_pixels_without_a_number_have_none_and_spare_the_others() -> None:
    film = dark(50).astype(np.float32)
    film[3, 4, 5] = np.nan
    film[7, 8, 9] = np.inf
    found = film_statistics([film])
    expected = film_statistics([dark(50)])
    lost = np.isnan(found.variance)
    assert np.argwhere(lost).tolist() == [[4, 5], [8, 9]]
    np.testing.assert_allclose(found.variance[~lost], expected.variance[~lost], rtol=0.01)


def test_pixels_that_never_change_are_told() -> None:
    film = dark(50)
    film[:, 2, 3] = 100
    assert np.argwhere(film_statistics([film]).constant).tolist() == [[2, 3]]


def test_films_that_tell_nothing_are_refused() -> None:
    with pytest.raises(CameraError, match="without frames"):
        film_statistics([])
    with pytest.raises(CameraError, match="2 of 9 frames can be used"):
        film_statistics([np.concatenate([dark(2), np.zeros_like(dark(7))])])
    with pytest.raises(CameraError, match="ADU darker than the dark one"):
        film_statistics([dark()], offset_adu=OFFSET + 50)


def test_memory_does_not_grow_with_the_length() -> None:
    block = dark(20)

    def peak(blocks: int) -> int:
        tracemalloc.start()
        film_statistics(block + np.uint16(number) for number in range(blocks))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(2)
    assert peak(100) < peak(5) + 100_000
