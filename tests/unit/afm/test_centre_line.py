from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from rotortrack.afm.centre_line import Sampler, along, follow, resample, smooth
from rotortrack.afm.level import level_lines
from rotortrack.afm.ridges import centre_noise, find_ridges
from rotortrack.simulate.afm import Microscope, image_rods

FLAT = {"noise_nm": 0.0, "line_offset_nm": 0.0, "tilt_nm_um": (0.0, 0.0)}


def test_the_smoother_passes_what_its_transfer_function_says():
    n, waves, length = 4000, 100, 4.0
    wave = np.cos(2.0 * np.pi * waves * np.arange(n) / n)
    passed = smooth(wave[:, None], length)[1000:3000, 0] / wave[1000:3000]
    u = 2.0 * np.pi * waves / n * length
    # The second difference of a cosine is -4 sin^2(k / 2), not -k^2.
    exact = 1.0 / (1.0 + (length * 2.0 * np.sin(np.pi * waves / n)) ** 4)
    assert np.median(passed) == pytest.approx(exact, rel=1e-6)
    assert exact == pytest.approx(1.0 / (1.0 + u**4), rel=0.02)


def test_a_straight_line_is_smoothed_into_itself():
    line = np.stack([np.arange(30.0), 3.0 - 0.5 * np.arange(30.0)], axis=1)
    assert smooth(line, 5.0) == pytest.approx(line, abs=1e-8)


@given(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(0.3, 3.0))
def test_resampling_keeps_length_and_goes_straight_beyond_ends(before, behind, spacing):
    turn = np.linspace(0.0, 1.5, 300)
    arc = 30.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    start, stop = -before, 45.0 + behind
    new = resample(arc, spacing, start, stop)
    assert along(new)[-1] == pytest.approx(stop - start, rel=0.01)
    gaps = np.diff(along(new))
    assert gaps.max() / gaps.min() < 1.03


@pytest.mark.parametrize("degrees", [0.0, 17.0, 45.0, 90.0])
@pytest.mark.parametrize("off", [0.0, 0.3, 0.7])
def test_a_clean_rod_is_followed_to_a_hundredth_of_a_pixel(degrees, off):
    turn = np.radians(degrees)
    way = np.array([np.cos(turn), np.sin(turn)])
    spine = [150.0 + 5.0 * off, 150.0] + np.linspace(0.0, 300.0, 900)[:, None] * way
    scope = Microscope(shape=(120, 120), **FLAT)
    image = image_rods(np.random.default_rng(0), scope, [spine])
    start = spine[::20] / 5.0 + 0.4 * np.array([-way[1], way[0]])
    found = follow(Sampler(image), start, 1.53, 1.53)
    off_px = (found.path_px - spine[0] / 5.0) @ np.array([-way[1], way[0]])
    assert np.abs(off_px).max() < 0.03
    assert along(found.path_px)[-1] == pytest.approx(60.0, abs=0.1)
    assert found.sigma_px == pytest.approx(18.0 / 2.3548 / 5.0, rel=0.01)
    assert found.height == pytest.approx(np.full(len(found.path_px), 2.0), rel=0.03)


def test_nothing_to_follow_is_told():
    flat = np.zeros((40, 40))
    flat[20, 20] = 1.0
    spot = gaussian_filter(flat, 1.5)
    start = np.array([[18.0, 20.5], [20.0, 20.5], [23.0, 20.5]])
    found = follow(Sampler(spot), start, 1.5, 1.5)
    assert found is None or along(found.path_px)[-1] < 3.0


def test_the_noise_of_centre_lines_is_that_seen():
    scatter, told = [], []
    rng = np.random.default_rng(3)
    scope = Microscope(shape=(120, 140), noise_nm=0.3)
    spine = [60.0, 300.0] + np.linspace(0.0, 580.0, 1500)[:, None] * [1.0, 0.03]
    for _ in range(25):
        image, _ = level_lines(image_rods(rng, scope, [spine]), order=1, grown_px=4)
        ridges = find_ridges(image, 1.53, 6.0)
        told.append(centre_noise(image, ridges, 1.53, 2.0, 4) / 2.0)
        found = follow(Sampler(image), spine[::20] / 5.0, 1.53, 2.0)
        inner = found.path_px[10:-10] - spine[0] / 5.0
        scatter.append((inner @ np.array([-0.03, 1.0])).std())
    assert np.sqrt(np.mean(np.square(scatter))) == pytest.approx(np.mean(told), rel=0.15)
