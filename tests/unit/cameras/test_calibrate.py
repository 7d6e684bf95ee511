"""A calibration against the sensor that its films were drawn from, and films that do not do."""

from __future__ import annotations

import dataclasses
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rotortrack.cameras.calibrate import Calibration, calibrate
from rotortrack.cameras.camera import Camera
from rotortrack.cameras.film_statistics import FilmStatistics, film_statistics
from rotortrack.errors import (
    CalibrationWarning,
    CameraError,
    ConfigurationError,
    GainWarning,
)

sys.path.insert(0, str(Path(__file__).parent))
from sensor import Sensor, sensor

SENSOR = sensor()
FEW = "flat frames tell a pixel's own gain"


def dark_film(frames: int = 200, known: Sensor = SENSOR, seed: int = 1) -> NDArray[np.uint16]:
    return known.film(0, frames, np.random.default_rng(seed))


def flat_film(
    light: float, frames: int = 150, known: Sensor = SENSOR, **options: Any
) -> NDArray[np.uint16]:
    return known.film(light, frames, np.random.default_rng(int(light)), **options)


def calibrated(
    dark: NDArray[Any], flats: dict[str, NDArray[Any]], **options: Any
) -> tuple[Calibration, list[str]]:
    """Calibrate; give the warnings too, but the one that a pixel's gain takes many frames."""
    of_dark = film_statistics([dark])
    of_flats = [
        (name, film_statistics([film], offset_adu=of_dark.mean)) for name, film in flats.items()
    ]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = calibrate(of_dark, of_flats, **options)
    assert all(issubclass(w.category, CalibrationWarning | GainWarning) for w in caught)
    return found, [str(w.message) for w in caught if FEW not in str(w.message)]


def refusal(dark: NDArray[Any], flats: dict[str, NDArray[Any]], **options: Any) -> str:
    with pytest.raises(CameraError) as caught:
        calibrated(dark, flats, **options)
    return str(caught.value)


def true_noise(known: Sensor) -> NDArray[np.float64]:
    """Read noise with that of rounding to whole counts, which the counts have too."""
    return np.sqrt(known.read**2 + known.gain**2 / 12)


@pytest.fixture(scope="module")
def sound() -> Calibration:
    """A calibration with flickering light, with nothing to complain about."""
    flats = {f"{light}": flat_film(light, 400, flicker=0.02) for light in (300, 1200, 5000)}
    found, warned = calibrated(dark_film(400), flats)
    assert warned == []
    return found


def test_every_map_errs_as_much_as_its_frames_allow(sound: Calibration) -> None:
    offset_error = true_noise(SENSOR) / SENSOR.gain / np.sqrt(400)
    assert np.std((sound.offset_adu - SENSOR.offset) / offset_error) == pytest.approx(1, abs=0.05)
    ratio = sound.read_noise_e / true_noise(SENSOR)
    assert ratio.mean() == pytest.approx(1, abs=0.003)
    # The pixel's gain, known to no better than it differs, adds its 1 %.
    assert ratio.std() == pytest.approx(np.hypot(1 / np.sqrt(2 * 399), 0.01), rel=0.1)
    pull = (sound.gain_e_per_adu - SENSOR.gain) / sound.gain_sd_e_per_adu
    assert abs(pull.mean()) < 0.15
    assert pull.std() == pytest.approx(1, abs=0.15)


def test_flicker_does_not_bias_the_gain(sound: Calibration) -> None:
    # At 5000 electrons 2 % of flicker has twice the variance of the light itself.
    assert sound.gains is not None
    assert sound.gains.mean_e_per_adu == pytest.approx(0.46, abs=4 * sound.gains.mean_sd + 2e-4)
    assert sound.gains.mean_sd < 1e-3 * 0.46
    for level in sound.levels:
        assert level.gain_e_per_adu == pytest.approx(0.46, rel=0.006)
        assert level.flicker == pytest.approx(0.02, rel=0.15)


def test_hot_pixels_are_those_of_the_sensor(sound: Calibration) -> None:
    assert not (SENSOR.hot & ~sound.hot_pixels).any()
    assert (sound.hot_pixels & ~SENSOR.hot).sum() <= 3
    assert not sound.dead_pixels.any()
    camera = sound.camera()
    assert isinstance(camera, Camera)
    assert camera.hot_pixels is sound.hot_pixels


def test_pixels_that_do_not_answer_are_dead() -> None:
    films = {"dark": dark_film(), "a": flat_film(500), "b": flat_film(2000)}
    for film in films.values():
        film[:, 3, 4] = 102  # stuck low
        film[:, 5, 6] = 65535  # stuck high
        film[:, 7, 8] = films["dark"][: len(film), 7, 8]  # noisy, but blind
    dark = films.pop("dark")
    dark[:, 9, 10] = 100  # quiet in the dark only
    found, warned = calibrated(dark, films)
    assert warned == []
    assert np.argwhere(found.dead_pixels).tolist() == [[3, 4], [5, 6], [7, 8]]
    assert not found.hot_pixels[found.dead_pixels].any()
    assert found.read_noise_e[9, 10] == pytest.approx(1.2, rel=0.05)
    # What stands in for a dead pixel is usable by programs that know no dead ones.
    assert found.offset_adu[5, 6] == pytest.approx(100, abs=0.2)
    variance = found.camera().variance_e2
    assert np.isinf(np.asarray(variance)[found.dead_pixels]).all()
    without_flats, _ = calibrated(dark, {}, gain_e_per_adu=0.46)
    assert np.argwhere(without_flats.dead_pixels).tolist() == [[3, 4], [5, 6], [9, 10]]


def test_a_given_gain_serves_without_flats_and_is_held_against_them() -> None:
    found, warned = calibrated(dark_film(), {}, gain_e_per_adu=0.5)
    assert warned == []
    assert np.all(found.gain_e_per_adu == 0.5)
    assert found.gains is None
    assert np.median(found.read_noise_e) == pytest.approx(1.2 * 0.5 / 0.46, rel=0.03)
    _, warned = calibrated(dark_film(), {"flat": flat_film(1000)}, gain_e_per_adu=1 / 0.46)
    assert len(warned) == 1
    assert "is it the inverse" in warned[0]
    with pytest.raises(ConfigurationError, match=r"FLAT.*or --gain-e-per-adu"):
        calibrate(film_statistics([dark_film()]))


def test_how_many_frames_a_pixels_gain_would_take_is_said() -> None:
    of_dark = film_statistics([dark_film()])
    flat = film_statistics([flat_film(2000)], offset_adu=of_dark.mean)
    with pytest.warns(CalibrationWarning, match="own gain to 11.6%") as caught:
        calibrate(of_dark, [("flat", flat)])
    sentence = str(caught[0].message)
    assert sentence.startswith("150 flat frames tell")
    assert "one gain" in sentence
    # sqrt(2 / n) = 1 %
    assert "about 2" in sentence
    assert "000 frames would tell it to 1.00%" in sentence


@pytest.mark.parametrize("largest", [4095, 65535])
def test_saturated_flats_and_pixels_are_left_out(largest: int) -> None:
    full = (largest - 100) * 0.46
    flats = {
        "dim": flat_film(0.1 * full, largest=largest),
        "edge": flat_film(0.97 * full, largest=largest),
        "full": flat_film(1.3 * full, largest=largest),
    }
    found, warned = calibrated(dark_film(), flats)
    assert found.saturation_adu == (4095 if largest == 4095 else None)
    reasons = {level.name: level.reason for level in found.levels}
    assert reasons["dim"] is None
    assert "% of its pixels are saturated" in str(reasons["full"])
    assert any(sentence.startswith("full is left out: ") for sentence in warned)
    assert found.levels[1].saturated_pixels > 0
    assert found.gains is not None
    assert found.gains.mean_e_per_adu == pytest.approx(0.46, rel=0.005)


def test_a_flat_whose_counts_do_not_follow_the_light_is_left_out() -> None:
    bent = flat_film(20_000).astype(np.float64)
    # Compression: the mean is 0.7 of what it was, the variance half.
    bent = np.rint(100 + 0.7 * (bent - 100)).astype(np.uint16)
    for others in ((500,), (500, 2000)):
        flats = {str(light): flat_film(light) for light in others} | {"bent": bent}
        found, warned = calibrated(dark_film(), flats)
        assert len(warned) == 1
        assert "bent is left out: by its variance the gain is 0.65" in warned[0]
        assert "do not follow the light" in warned[0]
        assert found.gains is not None
        assert found.gains.mean_e_per_adu == pytest.approx(0.46, rel=0.005)


def test_light_that_changes_unevenly_is_taken_by_differences() -> None:
    film = flat_film(2000, 400).astype(np.float64)
    tilt = np.linspace(-1, 1, 80) * np.linspace(-1, 1, 400)[:, None, None]
    film = np.rint(film + 0.03 * (film.mean() - 100) * tilt).astype(np.uint16)
    found, warned = calibrated(dark_film(), {"flat": film})
    assert len(warned) == 1
    assert "changes slowly and unevenly" in warned[0]
    assert found.gains is not None
    assert found.gains.mean_e_per_adu == pytest.approx(0.46, rel=0.005)


def test_films_that_do_not_do_are_refused_in_one_sentence() -> None:
    dark, flat = dark_film(), flat_film(1000)
    assert "19 usable frames: give at least 20; 100 tell" in refusal(dark[:19], {"flat": flat})
    assert "flat has 9 usable frames: give at least 10" in refusal(dark, {"flat": flat[:9]})
    assert "give the dark film first" in refusal(flat, {"dark": dark})
    assert "dim is 100" in refusal(dark, {"dim": flat_film(0.3)})
    other = film_statistics([flat[:, :60]], offset_adu=SENSOR.offset[:60])
    with pytest.raises(CameraError, match=r"flat has frames of 80 x 60 pixels, .* of 80 x 64"):
        calibrate(film_statistics([dark]), [("flat", other)])
    sentence = refusal(dark, {"full": flat_film(10_000)}, saturation_adu=20_000.0)
    assert "no flat tells the gain (full: 5" in sentence
    assert "% of its pixels are saturated (at 20000 ADU)" in sentence
    for dead in (np.full_like(dark, 65535), np.zeros_like(dark)):
        with pytest.raises(CameraError, match="0 of 200 frames can be used"):
            film_statistics([dead])


def warned_of(dark: NDArray[Any], **flats: NDArray[Any]) -> str:
    _, warned = calibrated(dark, flats, gain_e_per_adu=None if flats else 0.46)
    assert len(warned) == 1, warned
    return warned[0]


def test_doubtful_films_are_warned_of_in_one_sentence() -> None:
    dark = dark_film()
    assert "30 dark frames tell a pixel's read noise to 13%" in warned_of(dark[:30])
    drifting = dark + np.repeat(np.uint16([0, 30]), 100)[:, None, None]
    assert "the level of the dark film moves between" in warned_of(drifting)
    y, x = np.mgrid[:64, :80]
    wander = 3 * np.sin(x + y) * np.linspace(-1, 1, 200)[:, None, None]
    assert "the offsets of the dark film wander" in warned_of(np.rint(dark + wander + 10))
    two = np.concatenate([flat_film(500), flat_film(1500)])
    assert "one film for each brightness" in warned_of(dark, flat=two)


def test_a_dark_film_with_light_in_it_is_told() -> None:
    rng = np.random.default_rng(3)
    light = 12 * np.exp(-(np.linspace(0, 3, 80) ** 2))
    electrons = rng.poisson(np.broadcast_to(light, (200, 64, 80)))
    lit = np.rint(dark_film() + electrons / SENSOR.gain).astype(np.uint16)
    assert "brighter in some parts than in others" in warned_of(lit, flat=flat_film(2000))
    assert "brighter in some parts than in others" in warned_of(lit)
    uneven = dark_film() + np.linspace(0, 40, 80).astype(np.uint16)
    assert calibrated(uneven, {}, gain_e_per_adu=0.46)[1] == []
    assert (
        "more than that of cameras for single molecules"
        in calibrated(flat_film(1000), {}, gain_e_per_adu=0.46)[1][-1]
    )


def test_the_answer_scales_with_the_counts() -> None:
    dark, flat = dark_film(), flat_film(2000)
    found, _ = calibrated(dark, {"flat": flat})
    wider, _ = calibrated(
        dark.astype(np.int32) * 4 + 1000, {"flat": flat.astype(np.int32) * 4 + 1000}
    )
    np.testing.assert_allclose(wider.offset_adu, found.offset_adu * 4 + 1000, rtol=1e-6)
    np.testing.assert_allclose(wider.gain_e_per_adu, found.gain_e_per_adu / 4, rtol=2e-3)
    np.testing.assert_allclose(wider.read_noise_e, found.read_noise_e, rtol=2e-3)
    np.testing.assert_array_equal(wider.hot_pixels, found.hot_pixels)


def test_statistics_do_not_change_under_calibration() -> None:
    of_dark = film_statistics([dark_film()])
    before = dataclasses.replace(of_dark, **{n: getattr(of_dark, n).copy() for n in MAPS})
    calibrate(of_dark, gain_e_per_adu=0.5)
    for name in MAPS:
        np.testing.assert_array_equal(getattr(of_dark, name), getattr(before, name))


MAPS = [f.name for f in dataclasses.fields(FilmStatistics) if f.name not in ("frames", "skipped")]
