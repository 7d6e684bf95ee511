"""Noise that columns or rows share is found in what numpy alone draws, and nothing else is."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.cameras.camera import Camera
from rotortrack.cameras.line_noise import LineNoise, check_line_noise, line_noise
from rotortrack.errors import LineNoiseWarning
from rotortrack.movies.movie import ArrayMovie
from rotortrack.movies.tiff import open_movie
from rotortrack.simulate.ideal_examples import ExampleKind, example_scene
from rotortrack.simulate.ideal_film import film

ROTORS: Sequence[ExampleKind] = ("driven",) * 6 + ("brownian", "two_position")


def expose(
    seed: int,
    *,
    column_adu: float = 0.0,
    row_adu: float = 0.0,
    read_adu: float = 3.0,
    gain: float = 1.0,
    background: float = 10.0,
    kinds: Sequence[ExampleKind] = ROTORS,
    shape: tuple[int, int] = (64, 96),
    frames: int = 200,
    flicker: float = 0.0,
    drift_nm: float = 0.0,
) -> ArrayMovie:
    """Film rotors under uneven light, then add noise of pixels, columns and rows."""
    rng = np.random.default_rng(seed)
    scene = example_scene(
        kinds, rng=rng, shape_px=shape, n_frames=frames, background_photons=background
    )
    if drift_nm:
        scene = replace(scene, drift_nm=np.cumsum(rng.normal(0, drift_nm, (frames, 2)), axis=0))
    photons = film(scene, Camera(0.0, 1.0, 0.0), rng).expected_photons(0, frames)
    y, x = (np.arange(side) / side for side in shape)
    photons *= 1 + 0.5 * np.cos(3 * x) * np.cos(2 * y)[:, np.newaxis]
    photons *= np.maximum(1 + flicker * rng.normal(size=(frames, 1, 1)), 0)
    counts = rng.poisson(photons) / gain + 100 + rng.normal(0, read_adu, photons.shape)
    counts += rng.normal(0, column_adu, (frames, 1, shape[1]))
    counts += rng.normal(0, row_adu, (frames, shape[0], 1))
    return ArrayMovie(np.clip(np.rint(counts), 0, 65535).astype(np.uint16))


@pytest.mark.parametrize("seed", range(5))
def test_column_noise_of_one_count_in_read_noise_of_three_is_found_within_ten_per_cent(
    seed: int,
) -> None:
    column, row = line_noise(expose(seed, column_adu=1.0))
    assert column.rms_adu == pytest.approx(1.0, rel=0.1)
    assert column.matters
    assert not row.matters
    assert row.rms_adu < 0.5


def test_row_noise_is_told_from_column_noise() -> None:
    column, row = line_noise(expose(1, row_adu=1.0))
    assert row.rms_adu == pytest.approx(1.0, rel=0.1)
    assert row.matters
    assert not column.matters


@pytest.mark.parametrize("column_adu", [0.5, 1.0, 2.0, 4.0, 12.0])
def test_small_frames_and_strong_noise_do_not_bias_the_estimate(column_adu: float) -> None:
    rng = np.random.default_rng(1)
    found = []
    for _ in range(6):
        counts = 200 + rng.normal(0, 3, (150, 48, 64)) + rng.normal(0, column_adu, (150, 1, 64))
        found.append(line_noise(ArrayMovie(counts))[0].rms_adu)
    assert np.mean(found) == pytest.approx(column_adu, rel=0.04)


def test_standard_error_is_right() -> None:
    found = [line_noise(expose(seed, column_adu=1.0, frames=100))[0] for seed in range(30)]
    errors = np.array([noise.rms_adu - 1.0 for noise in found])
    sds = np.array([noise.sd_adu for noise in found])
    assert abs(errors.mean()) < 0.02
    assert 0.6 < np.sqrt(np.mean((errors / sds) ** 2)) < 1.3


def test_noise_below_one_count_is_measured_as_it_is() -> None:
    """A median would stick to whole counts here."""
    fast = {"gain": 5.0, "read_adu": 0.7, "background": 5.0}
    found = [line_noise(expose(seed, column_adu=0.5, **fast))[0] for seed in range(4)]
    assert np.mean([noise.rms_adu for noise in found]) == pytest.approx(0.5, rel=0.05)
    assert not any(noise.matters for noise in line_noise(expose(9, **fast)))


def test_halves_of_a_sensor_with_converters_of_their_own_are_judged_alike() -> None:
    counts = expose(1).frames(0, 200).astype(np.float32)
    rng = np.random.default_rng(1)
    for half in (np.s_[:, :32], np.s_[:, 32:]):
        counts[half] += rng.normal(0, 1.0, (200, 1, 96))
    assert line_noise(ArrayMovie(counts))[0].rms_adu == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("seed", range(50))
def test_rotors_drift_and_flicker_are_no_line_noise(seed: int) -> None:
    movie = expose(seed, drift_nm=5.0, flicker=(0.0, 0.05, 0.2)[seed % 3], frames=120)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = check_line_noise(movie)
    assert all(noise.reason is None and noise.significance < 5 for noise in found)


def test_dense_fast_rotors_on_a_dark_background_are_no_line_noise() -> None:
    for seed in range(8):
        movie = expose(seed, kinds=("driven",) * 30, background=1.0, read_adu=1.0, frames=100)
        assert not any(noise.matters for noise in line_noise(movie))


def test_an_offset_that_stays_is_no_noise() -> None:
    counts = expose(1).frames(0, 200).astype(np.float32)
    counts += np.random.default_rng(1).normal(0, 10, (1, 1, 96)).astype(np.float32)
    assert not line_noise(ArrayMovie(counts))[0].matters


def test_masked_and_dead_pixels_do_not_matter() -> None:
    counts = expose(2, column_adu=1.0).frames(0, 200).astype(np.float32)
    counts[:, 5, 7] = np.nan
    counts[:, :, 40] = 100
    counts[7] = 0
    found = line_noise(ArrayMovie(counts))[0]
    assert found.rms_adu == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize(
    ("movie", "reason"),
    [
        (ArrayMovie(np.ones((15, 64, 64), np.uint16)), "15 frames"),
        (ArrayMovie(np.ones((20, 31, 64), np.uint16)), "64 x 31"),
        (ArrayMovie(np.full((20, 64, 64), 100, np.uint16)), "do not vary"),
    ],
)
def test_what_does_not_tell_gives_a_reason(movie: ArrayMovie, reason: str) -> None:
    for noise in check_line_noise(movie):
        assert math.isnan(noise.rms_adu)
        assert not noise.matters
        assert noise.reason is not None
        assert reason in noise.sentence()
        assert noise.axis in noise.sentence()


@settings(max_examples=60, deadline=None)
@given(
    dtype=st.sampled_from(["uint8", "uint16", "uint32", "int16", "float32", "float64"]),
    share=st.sampled_from([0.0, 0.001, 0.05, 1.0]),
    special=st.sampled_from([0, 255, np.nan, np.inf, -np.inf, 1e300]),
    seed=st.integers(0, 1000),
)
def test_no_counts_whatever_raise_or_warn(
    dtype: str, share: float, special: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 200, (18, 32, 33)).astype(np.float64)
    counts *= rng.random(counts.shape) < share
    if np.dtype(dtype).kind == "f":
        counts[rng.random(counts.shape) < 0.01] = special
    with np.errstate(over="ignore"):
        movie = ArrayMovie(counts.astype(dtype))
    for noise in line_noise(movie):
        assert (noise.reason is None) == math.isfinite(noise.rms_adu)
        assert noise.sentence()


def test_a_finding_warns_once_with_its_size_in_counts_and_electrons() -> None:
    with pytest.warns(LineNoiseWarning) as caught:
        found, _ = check_line_noise(expose(1, column_adu=1.3), 2.0)
    (warning,) = caught
    sentence = str(warning.message)
    assert sentence.startswith(f"column noise of {found.rms_adu:.2g} +- ")
    assert f"({2 * found.rms_adu:.2g} electrons)" in sentence


def test_certain_but_small_noise_does_not_warn() -> None:
    assert not LineNoise("column", 0.2, 0.01, 3.0, 20.0).matters
    assert LineNoise("column", 0.4, 0.01, 3.0, 20.0).matters
    assert not LineNoise("column", 0.4, 0.2, 3.0, 2.0).matters


def test_reference_movie_has_no_line_noise(reference_data: Callable[[str], object]) -> None:
    with open_movie(reference_data("thunderstorm") / "movie.tif") as movie:  # type: ignore[operator]
        assert not any(noise.matters for noise in line_noise(movie))
