"""Counts against theory: Poisson, normal and column noise, gain, saturation, streams."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from rotortrack.cameras.maps import write_maps
from rotortrack.errors import CameraError
from rotortrack.simulate.film.options import (
    ColumnNoiseOptions,
    HotPixelsOptions,
    PixelMapsOptions,
    SensorOptions,
)
from rotortrack.simulate.film.sensor import Sensor
from rotortrack.simulate.film.shot_noise import draw_electrons

ALPHA = 1e-3


def drawn(mean, n=200_000, seed=3):
    electrons = np.empty((200, n // 200))
    draw_electrons(np.full(electrons.shape, float(mean)), np.random.default_rng(seed), electrons)
    return electrons.ravel()


def sensor(shape=(64, 64), seed=7, options=None, **effects):
    return Sensor(options or SensorOptions(), *shape, seed, **effects)


@pytest.mark.parametrize(
    "mean", [1e-5, 0.01, 0.1249, 0.5, 1.0, 2.7, 9.99, 10.0, 30.0, 63.99, 64.0, 1e3, 1e5]
)
def test_electrons_are_poisson_distributed(mean):
    values = drawn(mean)
    law = stats.poisson(mean)
    low, high = int(law.ppf(1e-3)), int(law.isf(1e-3))
    # Classes of at least some tens of expected numbers each, the outer ones open.
    edges = np.unique(law.ppf(np.linspace(0.0, 1.0, 41)[1:-1])).astype(int)
    edges = edges[(edges >= low) & (edges <= high)]
    counts = np.diff([0, *np.searchsorted(np.sort(values), edges, side="right"), values.size])
    expected = values.size * np.diff([0.0, *law.cdf(edges), 1.0])
    assert stats.chisquare(counts, expected).pvalue > ALPHA


def test_electrons_keep_their_law_where_every_pixel_has_a_mean_of_its_own():
    means = np.random.default_rng(8).uniform(0.0, 70.0, (500, 400))
    means[::7] = 0.3
    electrons = np.empty(means.shape)
    draw_electrons(means, np.random.default_rng(9), electrons)
    # A random place between the steps of the distribution function is uniform.
    part = np.random.default_rng(10).random(means.shape)
    law = stats.poisson(means)
    place = law.cdf(electrons - 1.0) + part * law.pmf(electrons)
    assert stats.kstest(place.ravel(), "uniform").pvalue > ALPHA
    assert stats.kstest(place[::7].ravel(), "uniform").pvalue > ALPHA
    assert abs(np.corrcoef(place[:, 1:].ravel(), place[:, :-1].ravel())[0, 1]) < 4.0 / 440


@settings(max_examples=30, deadline=None)
@given(mean=st.floats(0.0, 63.0), more=st.floats(0.0, 0.9), seed=st.integers(0, 99))
def test_a_little_more_light_gives_no_other_noise(mean, more, seed):
    pair = [
        drawn(light, n=2000, seed=seed) if light else np.zeros(2000)
        for light in (mean, mean + more)
    ]
    # Electrons of a film with a little more light are mostly those of the film without.
    assert np.mean(pair[1] != pair[0]) < 2.0 * more + 0.05


def test_no_light_gives_no_electrons_and_much_light_as_many_as_it_should():
    assert not drawn(0.0).any()
    many = drawn(1e5)
    assert many.mean() == pytest.approx(1e5, abs=4.0 * np.sqrt(1e5 / many.size))
    assert many.var() == pytest.approx(1e5, rel=4.0 * np.sqrt(2.0 / many.size))


@pytest.mark.parametrize("bad", [-1e-9, np.nan, np.inf])
def test_light_that_cannot_be_is_refused_with_the_frame(bad):
    photons = np.ones((2, 64, 64))
    photons[1, 3, 4] = bad
    with pytest.raises(CameraError, match="frame 11: expected photons must be finite"):
        sensor().expose(photons, 10)


def test_mean_variance_and_neighbours_of_pixels():
    photons = np.linspace(2.0, 90.0, 64)[:, np.newaxis] * np.ones((64, 64))
    frames = sensor().expose(np.repeat(photons[np.newaxis], 600, axis=0), 0).astype(float)
    gain = 0.4545
    mean = 100.0 + photons / gain
    variance = (photons + 1.4**2) / gain**2 + 1.0 / 12.0
    z = (frames.mean(axis=0) - mean) / np.sqrt(variance / 600)
    assert stats.kstest(z.ravel(), "norm").pvalue > ALPHA
    ratio = frames.var(axis=0, ddof=1) / variance
    assert ratio.mean() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 600 / ratio.size))
    noise = (frames - mean) / np.sqrt(variance)
    for shift, axis in ((1, 1), (1, 2), (1, 0)):
        together = np.mean(noise * np.roll(noise, shift, axis=axis))
        assert abs(together) < 4.0 / np.sqrt(noise.size)


def test_the_photon_transfer_slope_gives_the_gain():
    levels = np.geomspace(1.0, 2000.0, 12)
    means, variances = [], []
    for number, level in enumerate(levels):
        frames = sensor().expose(np.full((100, 64, 64), level), 100 * number).astype(float)
        means.append(frames.mean())
        variances.append(frames.var(axis=0, ddof=1).mean())
    slope = np.polyfit(means, variances, 1, w=1.0 / np.array(variances))[0]
    assert 1.0 / slope == pytest.approx(0.4545, rel=0.005)


def test_every_pixel_has_the_noise_of_its_map():
    made = sensor(pixel_maps=PixelMapsOptions(), hot_pixels=HotPixelsOptions(fraction=0.05))
    camera = made.camera
    frames = made.expose(np.zeros((800, 64, 64)), 0).astype(float)
    sds = np.sqrt((camera.read_noise_e / camera.gain_e_per_adu) ** 2 + 1.0 / 12.0)
    assert frames.std(axis=0, ddof=1) / sds == pytest.approx(1.0, abs=5.0 / np.sqrt(1600))
    z = (frames.mean(axis=0) - camera.offset_adu) / (sds / np.sqrt(800))
    assert stats.kstest(z.ravel(), "norm").pvalue > ALPHA
    assert camera.hot_pixels.mean() == pytest.approx(0.05, abs=0.015)
    assert np.all(camera.read_noise_e[camera.hot_pixels] == 20.0)


def test_columns_share_their_noise():
    made = sensor(column_noise=ColumnNoiseOptions(sd_adu=3.0))
    frames = made.expose(np.full((500, 64, 64), 5.0), 0).astype(float)
    columns = frames.mean(axis=1)
    own = ((5.0 + 1.4**2) / 0.4545**2 + 1 / 12) / 64
    assert columns.var() == pytest.approx(9.0 + own, rel=5.0 * np.sqrt(2.0 / columns.size))


def test_an_effect_changes_no_other_ones_stream():
    photons = np.full((4, 64, 64), 12.0)
    plain = sensor().expose(photons, 3).astype(int)
    noisy = sensor(column_noise=ColumnNoiseOptions(sd_adu=5.0)).expose(photons, 3).astype(int)
    shift = noisy - plain
    # Whole columns move together, by what rounding leaves.
    assert (shift.max(axis=1) - shift.min(axis=1)).max() <= 1
    hot = sensor(hot_pixels=HotPixelsOptions(fraction=0.01))
    same = hot.expose(photons, 3) == plain
    assert np.all(same[:, ~hot.camera.hot_pixels])


def test_frames_are_the_same_however_they_are_cut_and_by_whom():
    photons = np.random.default_rng(2).uniform(0, 100, (9, 32, 48))
    whole = sensor((32, 48)).expose(photons, 20)
    made = sensor((32, 48))
    parts: dict[int, np.ndarray] = {}

    def work(first, stop):
        parts[first] = made.expose(np.ascontiguousarray(photons[first:stop]), 20 + first)

    threads = [threading.Thread(target=work, args=cut) for cut in ((0, 4), (4, 5), (5, 9))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_array_equal(np.concatenate([parts[0], parts[4], parts[5]]), whole)


def test_counts_saturate_at_the_bits_and_efficiency_takes_light():
    made = sensor(options=SensorOptions(bits=12))
    assert made.expose(np.full((1, 64, 64), 1e5), 0).min() == 4095
    assert made.camera.saturation_adu == 4095
    half = sensor(options=SensorOptions(quantum_efficiency=0.5, gain_e_per_adu=1.0))
    assert half.expose(np.full((20, 64, 64), 50.0), 0).mean() == pytest.approx(125.0, abs=0.1)


def test_maps_of_a_file_are_used_and_must_be_large_enough(tmp_path):
    path = tmp_path / "camera.npz"
    rng = np.random.default_rng(5)
    maps = {
        "offset_adu": rng.uniform(90, 110, (64, 80)),
        "gain_e_per_adu": np.full((64, 80), 0.5),
        "read_noise_e": rng.uniform(1, 2, (64, 80)),
    }
    write_maps(path, maps, {})
    made = sensor((48, 80), options=SensorOptions(camera_maps=str(path)))
    np.testing.assert_allclose(made.camera.offset_adu, maps["offset_adu"][:48])
    with pytest.raises(CameraError, match="fewer than the film's 81 x 64"):
        sensor((64, 81), options=SensorOptions(camera_maps=str(path)))
