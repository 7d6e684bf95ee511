"""The gain is found from counts drawn with numpy alone, also while rotors move."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rotortrack.cameras.photon_transfer import (
    GainEstimate,
    gain_from_movie,
    warn_if_contradicted,
)
from rotortrack.errors import GainWarning
from rotortrack.movies.movie import ArrayMovie
from rotortrack.movies.tiff import open_movie

GAIN = 0.4545
SHAPE = (64, 96)


def expose(photons: NDArray[np.float64], seed: int) -> ArrayMovie:
    """Poisson, read noise 1.4 e, gain, offset 100: written out, not taken from Camera."""
    rng = np.random.default_rng(seed)
    electrons = rng.poisson(photons) + rng.normal(0.0, 1.4, photons.shape)
    return ArrayMovie(np.clip(np.rint(electrons / GAIN + 100), 0, 65535).astype(np.uint16))


def ramp(frames: int) -> NDArray[np.float64]:
    return np.broadcast_to(np.linspace(5, 100, SHAPE[1]), (frames, *SHAPE))


def turning_spots(frames: int, step_rad: float | None, seed: int) -> NDArray[np.float64]:
    """24 spots of 800 photons on circles of 2 px over a background of 10; None jumps at random."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    film = np.full((frames, *SHAPE), 10.0)
    for frame in range(frames):
        for spot in range(24):
            angle = rng.uniform(0, 2 * math.pi) if step_rad is None else step_rad * frame
            dx = x - (spot % 6 * 16 + 8) - 2 * math.cos(angle)
            dy = y - (spot // 6 * 16 + 8) - 2 * math.sin(angle)
            film[frame] += 800 / (2.88 * math.pi) * np.exp(-(dx**2 + dy**2) / 2.88)
    return film


def test_gain_of_still_scenes_is_right_within_its_standard_deviation() -> None:
    found = [gain_from_movie(expose(ramp(60), seed)) for seed in range(20)]
    gains = np.array([estimate.gain_e_per_adu for estimate in found])
    sds = np.array([estimate.sd for estimate in found])
    assert gains.mean() == pytest.approx(GAIN, rel=0.01)
    assert np.all(sds < 0.03 * GAIN)
    # The standard deviation is meant to be cautious, not wrong.
    assert 0.4 < np.sqrt(np.mean(((gains - GAIN) / sds) ** 2)) < 1.3


@pytest.mark.parametrize("step_rad", [0.0, 0.3, 2.0, None])
def test_moving_spots_do_not_bias_the_gain(step_rad: float | None) -> None:
    film = turning_spots(80, step_rad, 1)
    found = [gain_from_movie(expose(film, seed)) for seed in range(4)]
    mean = np.mean([estimate.gain_e_per_adu for estimate in found])
    assert mean == pytest.approx(GAIN, rel=0.06)
    # The plain slope over pixels is off by a factor when spots jump, so this test can fail.
    if step_rad is None:
        counts = expose(film, 0).frames(0, 80).astype(float)
        variance = (np.diff(counts, axis=0) ** 2).mean(axis=0) / 2
        slope = np.polyfit(counts.mean(axis=0).ravel(), variance.ravel(), 1)[0]
        assert 1 / slope < 0.5 * GAIN


def test_drifting_illumination_does_not_bias_the_gain() -> None:
    fading = ramp(100) * np.linspace(1.5, 0.5, 100)[:, np.newaxis, np.newaxis]
    assert gain_from_movie(expose(fading, 1)).gain_e_per_adu == pytest.approx(GAIN, rel=0.06)


def test_saturated_and_missing_pixels_are_left_out() -> None:
    counts = expose(ramp(60), 2).frames(0, 60).astype(np.float32)
    counts[:, 10:14, 50:54] = 4095
    counts[3, 30, 30] = np.nan
    found = gain_from_movie(ArrayMovie(counts), saturation_adu=4095)
    assert found.gain_e_per_adu == pytest.approx(GAIN, rel=0.06)


@pytest.mark.parametrize(
    ("movie", "reason"),
    [
        (expose(ramp(15), 1), "15 frames"),
        (ArrayMovie(expose(ramp(20), 1).frames(0, 20)[:, :4]), "smaller than"),
        (ArrayMovie(np.full((20, 30, 30), 65535, np.uint16)), "do not vary"),
        (
            ArrayMovie(np.minimum(expose(ramp(20), 1).frames(0, 20) * 600.0, 65535).astype("u2")),
            "not saturated",
        ),
        (ArrayMovie(np.full((20, 30, 30), 100, np.uint16)), "do not vary"),
        (expose(np.full((60, *SHAPE), 20.0), 1), "equally bright"),
    ],
)
def test_what_does_not_determine_the_gain_gives_a_reason(movie: ArrayMovie, reason: str) -> None:
    found = gain_from_movie(movie)
    assert math.isnan(found.gain_e_per_adu)
    assert found.reason is not None
    assert reason in found.reason


def test_dead_pixels_and_black_or_repeated_frames_do_not_bias_the_gain() -> None:
    counts = expose(ramp(120), 4).frames(0, 120).copy()
    counts[:, :, 30] = 60
    counts[[10, 43, 44, 77]] = 0
    counts[21::12] = counts[20::12]
    assert gain_from_movie(ArrayMovie(counts)).gain_e_per_adu == pytest.approx(GAIN, rel=0.06)


def test_frame_without_a_finite_pixel_costs_its_pair_alone() -> None:
    frames = expose(ramp(60), 3).frames(0, 60).astype(np.float32)
    frames[31] = np.nan
    found = gain_from_movie(ArrayMovie(frames))
    assert found.pairs == 29
    assert found.gain_e_per_adu == pytest.approx(GAIN, rel=0.1)


def test_noise_that_does_not_grow_with_the_mean_gives_a_reason() -> None:
    rng = np.random.default_rng(3)
    counts = np.rint(ramp(60) + 100 + rng.normal(0, 5, (60, *SHAPE))).astype(np.uint16)
    reason = gain_from_movie(ArrayMovie(counts)).reason
    assert reason is not None
    assert "does not grow" in reason


def test_contradiction_warns_only_when_it_is_large_and_significant() -> None:
    estimate = GainEstimate(0.45, 0.01, 200)
    with pytest.warns(GainWarning, match=r"given as 2\.2 .* 0\.45"):
        warn_if_contradicted(estimate, 2.2)
    with pytest.warns(GainWarning):
        warn_if_contradicted(estimate, np.full(SHAPE, 0.6))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_if_contradicted(estimate, 0.5)
        warn_if_contradicted(GainEstimate(0.45, 0.2, 8), 0.7)
        warn_if_contradicted(GainEstimate(math.nan, math.nan, 0, "none"), 2.2)


def test_reference_movie_does_not_contradict_its_gain(
    reference_data: Callable[[str], object],
) -> None:
    with open_movie(reference_data("thunderstorm") / "movie.tif") as movie:
        estimate = gain_from_movie(movie)
    assert estimate.gain_e_per_adu == pytest.approx(1 / 2.2, abs=3 * estimate.sd)
    assert estimate.sd < 0.06
    warn_if_contradicted(estimate, 1 / 2.2)
    with pytest.warns(GainWarning):
        warn_if_contradicted(estimate, 2.2)
