"""Photon transfer pixel by pixel, on variances drawn from their exact distribution."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rotortrack.cameras.pixel_gains import Level, PixelGains, mean_slope, pixel_gains

SIZE = (80, 100)
ALL = np.ones(SIZE, np.bool_)
GAIN = 0.5


def levels(
    gain: NDArray[np.float64], signals: tuple[float, ...], frames: int, seed: int
) -> tuple[Level, list[Level]]:
    """Draw a dark film of 500 frames and flats: chi-squared variances, gains in electrons/ADU."""
    rng = np.random.default_rng(seed)

    def drawn(signal: float, n: int) -> Level:
        variance = 9.0 + signal / gain
        found = variance * rng.chisquare(n - 1, SIZE) / (n - 1)
        return Level(np.full(SIZE, signal), found, n - 1.0, ALL)

    return drawn(0.0, 500), [drawn(signal, frames) for signal in signals]


def fitted(gain: NDArray[np.float64], frames: int, seed: int = 1) -> PixelGains:
    dark, flats = levels(gain, (200.0, 1000.0, 5000.0), frames, seed)
    return pixel_gains(flats, dark, mean_slope(flats[-1], dark, ALL)[0], ALL)


def spread(pixels: float, columns: float = 0.0, rows: float = 0.0) -> NDArray[np.float64]:
    rng = np.random.default_rng(7)
    apart = rng.normal(0, pixels, SIZE) + rng.normal(0, columns, (1, SIZE[1]))
    return GAIN * (1 + apart + rng.normal(0, rows, (SIZE[0], 1)))


@pytest.mark.parametrize("frames", [1500, 20_000])
def test_gains_err_as_much_as_they_say_and_less_than_one_for_all(frames: int) -> None:
    # Three flats, of which the dimmest tells a little less than the others.
    own2 = 2 / frames / 3
    weight = 0.01**2 / (0.01**2 + own2)
    true = spread(0.01)
    found = fitted(true, frames)
    error = found.gain_e_per_adu / true - 1
    pull = (found.gain_e_per_adu - true) / found.sd
    assert found.pixel_spread == pytest.approx(0.01, rel=0.15)
    assert found.own_weight == pytest.approx(weight, rel=0.3)
    assert pull.std() == pytest.approx(1.0, abs=0.06)
    assert abs(error.mean()) < 4 * found.mean_sd / GAIN + 4e-4
    # The best that can be: a share T^2 / (T^2 + e^2) of the spread is known.
    assert error.std() == pytest.approx(0.01 * np.sqrt(1 - found.own_weight), rel=0.05)
    assert error.std() < 0.97 * np.std(true / GAIN)
    assert found.own_error == pytest.approx(np.sqrt(own2), rel=0.15)


def test_few_frames_give_one_gain_whose_error_covers_the_spread() -> None:
    found = fitted(spread(0.01), 30)
    assert found.pixel_spread == found.column_spread == found.own_weight == 0
    assert np.ptp(found.gain_e_per_adu) < 1e-9
    assert found.mean_e_per_adu == pytest.approx(GAIN, abs=4 * found.mean_sd)
    assert np.median(found.sd) > 0.01 * GAIN


def test_columns_and_rows_are_told_apart_from_pixels() -> None:
    true = spread(0.0, columns=0.02, rows=0.01)
    found = fitted(true, 400)
    assert found.column_spread == pytest.approx(0.02, rel=0.2)
    assert found.row_spread == pytest.approx(0.01, rel=0.3)
    assert found.pixel_spread == 0
    error = found.gain_e_per_adu / true - 1
    assert error.std() < 0.006
    assert np.median(found.sd) < 0.012 * GAIN
    assert np.std((error * GAIN) / found.sd) == pytest.approx(1.0, abs=0.5)


def test_a_sensor_without_spread_gets_none() -> None:
    for seed in range(5):
        found = fitted(np.full(SIZE, GAIN), 1000, seed)
        assert found.pixel_spread == 0
        assert np.std(found.gain_e_per_adu) < 0.002 * GAIN


def test_pixels_without_a_level_take_the_gain_of_the_others() -> None:
    dark, flats = levels(spread(0.01), (1000.0,), 20_000, 3)
    usable = ALL.copy()
    usable[3, 4] = False
    (flat,) = flats
    flat = Level(flat.signal, np.where(usable, flat.variance, np.nan), flat.freedom, usable)
    slope, error = mean_slope(flat, dark, ALL)
    assert slope == pytest.approx(1 / GAIN, abs=5 * error + 0.001)
    found = pixel_gains([flat], dark, slope, ALL)
    assert found.gain_e_per_adu[3, 4] == pytest.approx(found.mean_e_per_adu, rel=0.005)
    assert found.sd[3, 4] == pytest.approx(0.01 * GAIN, rel=0.2)
    assert found.pixels == ALL.size - 1
