from __future__ import annotations

import numpy as np
import pytest

from rotortrack.afm.level import level_lines


def scanned(order, rows=120, columns=150, rod=True, seed=0):
    """A rod along the rows, but for 12 pixels at both ends, on crooked scan lines."""
    rng = np.random.default_rng(seed)
    truth = np.zeros((rows, columns))
    if rod:
        y = np.arange(rows)[:, None]
        truth[:, 12:-12] = 2.0 * np.exp(-((y - 60.0) ** 2) / 8.0)
    x = np.linspace(-1.0, 1.0, columns)
    slow = np.linspace(0.0, 3.0, rows)[:, None]
    lines = rng.normal(0.0, 1.0, (rows, 1))
    lines = lines + sum(np.sin(slow + k) * x**k for k in range(1, order + 1))
    tilt = 0.02 * np.arange(columns) - 0.05 * np.arange(rows)[:, None]
    return truth, truth + lines + tilt + rng.normal(0.0, 0.1, truth.shape)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_lines_are_levelled_to_a_small_part_of_the_noise(order):
    truth, image = scanned(order, rod=False)
    level, noise = level_lines(image, order=order, grown_px=4)
    assert noise == pytest.approx(0.1, rel=0.05)
    assert np.std((level - truth).mean(axis=1)) < 0.02
    assert np.std(level - truth) == pytest.approx(0.1, rel=0.03)


def test_a_rod_along_a_line_is_not_levelled_away():
    truth, image = scanned(0)
    level, _ = level_lines(image, order=0, grown_px=4)
    assert level[60, 20:-20].mean() == pytest.approx(2.0, abs=0.15)
    assert np.abs((level - truth).mean(axis=1)).max() < 0.15


def test_a_plane_alone_becomes_zero():
    y, x = np.mgrid[:40, :50]
    level, _ = level_lines(1.0 + 0.5 * x - 2.0 * y, order=0, grown_px=3)
    assert np.abs(level).max() < 1e-9
