"""Illumination, background, stage and free rods against their laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.free_rods import FreeRods
from rotortrack.simulate.film.illumination import (
    Flicker,
    background_image,
    laser_at,
    laser_map,
)
from rotortrack.simulate.film.options import (
    BackgroundOptions,
    DriftOptions,
    FlickerOptions,
    FreeRodsOptions,
    LaserOptions,
    VibrationOptions,
)
from rotortrack.simulate.film.stage import Stage

T = 0.002
PIXEL_NM = 108.3
CUTS = st.lists(st.integers(1, 20), min_size=1, max_size=6)


def clock(n=1000, exposure_s=T):
    return Clock(n, T, exposure_s)


def pieces(made, cuts):
    return np.concatenate([made.advance(n) for n in cuts])


def test_the_laser_falls_off_as_a_gaussian_about_its_middle():
    laser = LaserOptions(waist_nm=3000.0)
    middle = np.array([32 * PIXEL_NM])
    assert laser_at(laser, (64, 64), PIXEL_NM, middle, middle) == pytest.approx(1.0)
    edge = laser_at(laser, (64, 64), PIXEL_NM, middle + 3000.0, middle)
    assert edge == pytest.approx(math.exp(-2.0))
    moved = LaserOptions(waist_nm=3000.0, centre_nm=(1000.0, 2000.0))
    picture = laser_map(moved, (40, 64), PIXEL_NM)
    assert picture.shape == (40, 64)
    row, column = np.unravel_index(picture.argmax(), picture.shape)
    assert (column, row) == (int(1000 / PIXEL_NM), int(2000 / PIXEL_NM))


def test_a_background_has_its_level_and_gradient():
    flat = background_image(BackgroundOptions(photons=7.0), (20, 30), PIXEL_NM, 1)
    assert np.all(flat == 7.0)
    tilted = background_image(
        BackgroundOptions(photons=10.0, gradient=(0.4, -0.2)), (20, 30), PIXEL_NM, 1
    )
    assert tilted.mean() == pytest.approx(10.0)
    assert np.diff(tilted, axis=1) == pytest.approx(10.0 * 0.4 / 30)
    assert np.diff(tilted, axis=0) == pytest.approx(-10.0 * 0.2 / 20)


def test_a_texture_has_its_strength_and_correlation():
    length_px = 4.0
    options = BackgroundOptions(photons=1.0, texture=0.1, texture_length_nm=length_px * PIXEL_NM)
    fields = [
        background_image(options, (128, 128), PIXEL_NM, seed) / 0.1 - 10.0 for seed in range(8)
    ]
    # Each patch of pi l^2 is about one independent value.
    independent = 8 * 128**2 / (2.0 * math.pi * length_px**2)
    variance = np.mean([np.mean(field**2) for field in fields])
    assert variance == pytest.approx(1.0, rel=5.0 * math.sqrt(2.0 / independent))
    for lag in (2, 4, 8):
        for axis in (0, 1):
            near = np.mean(
                [
                    np.mean(np.take(f, range(128 - lag), axis) * np.take(f, range(lag, 128), axis))
                    for f in fields
                ]
            )
            expected = math.exp(-(lag**2) / (2.0 * length_px**2))
            assert near == pytest.approx(expected, abs=5.0 / math.sqrt(independent))


def test_a_background_below_nothing_is_refused():
    with pytest.raises(ConfigurationError, match=r"\[background\] gradient and texture make"):
        background_image(BackgroundOptions(gradient=(2.0, 2.0)), (64, 64), PIXEL_NM, 1)


@given(cuts=CUTS, time_s=st.sampled_from([0.0, 0.01]))
def test_flicker_does_not_depend_on_the_cuts(cuts, time_s):
    options = FlickerOptions(sd=0.05, time_s=time_s)
    whole = Flicker(options, clock(), 3).advance(sum(cuts))
    np.testing.assert_array_equal(pieces(Flicker(options, clock(), 3), cuts), whole)


@pytest.mark.parametrize("time_s", [0.0, 0.02])
def test_flicker_has_its_spread_and_memory(time_s):
    n = 40_000
    light = Flicker(FlickerOptions(sd=0.05, time_s=time_s), clock(), 3).advance(n)
    independent = n * T / (2.0 * max(time_s, T / 2.0))
    assert light.mean() == pytest.approx(1.0, abs=4.0 * 0.05 / math.sqrt(independent))
    assert light.std() == pytest.approx(0.05, rel=5.0 / math.sqrt(independent) + 0.04)
    near = np.corrcoef(light[10:], light[:-10])[0, 1]
    expected = math.exp(-10 * T / time_s) if time_s else 0.0
    assert near == pytest.approx(expected, abs=5.0 / math.sqrt(independent))


@given(cuts=CUTS)
def test_drift_does_not_depend_on_the_cuts(cuts):
    options = DriftOptions(total_nm=(50.0, -20.0), walk_nm=1.0, step_nm=(5.0, 0.0), step_s=0.02)
    whole = Stage(options, None, clock(), 3).advance(sum(cuts))
    np.testing.assert_array_equal(pieces(Stage(options, None, clock(), 3), cuts), whole)


def test_even_drift_begins_with_nothing_and_ends_with_all():
    moved = Stage(DriftOptions(total_nm=(50.0, -20.0)), None, clock(200), 3).advance(200)
    assert moved[0].tolist() == [0.0, 0.0]
    assert moved[-1] == pytest.approx((50.0, -20.0))
    assert np.diff(moved[:, 0]) == pytest.approx(50.0 / 199)


def test_a_sudden_step_comes_when_it_should():
    moved = Stage(DriftOptions(step_nm=(7.0, 3.0), step_s=0.1), None, clock(), 3).advance(100)
    assert not moved[:50].any()
    assert np.all(moved[50:] == (7.0, 3.0))


def test_the_walk_spreads_with_the_square_root_of_time():
    steps = np.diff(Stage(DriftOptions(walk_nm=0.7), None, clock(), 3).advance(20_000), axis=0)
    assert steps.std(axis=0) == pytest.approx(0.7, rel=4.0 / math.sqrt(40_000))
    assert np.mean(steps[1:] * steps[:-1]) == pytest.approx(0.0, abs=4 * 0.49 / 200)


def test_a_table_moves_the_stage_and_must_tell_every_frame(tmp_path):
    path = tmp_path / "drift.csv"
    path.write_text("frame,dx_nm,dy_nm\n0,1,2\n1,3,4\n2,5,6\n")
    options = DriftOptions(table=str(path))
    assert Stage(options, None, clock(3), 1).advance(3).tolist() == [[1, 2], [3, 4], [5, 6]]
    with pytest.raises(ConfigurationError, match=r"does not tell frame 3 \(7 of 10 frames"):
        Stage(options, None, clock(10), 1)


def test_vibration_swings_in_its_direction():
    options = VibrationOptions(amplitude_nm=10.0, frequency_hz=50.0, direction_deg=90.0)
    stage = Stage(None, options, clock(), 1)
    assert stage.advance(5) is None
    x_nm, y_nm = stage.vibration_nm(np.array([0.0, 0.005, 0.01, 0.015]))
    assert x_nm == pytest.approx([0.0] * 4, abs=1e-12)
    # Up on the image is towards smaller y.
    assert y_nm == pytest.approx([0.0, -10.0, 0.0, 10.0], abs=1e-12)
    assert Stage(DriftOptions(), None, clock(), 1).vibration_nm(np.zeros(3)) is None


def rods(seed=2, **changes):
    options = FreeRodsOptions(**{"count": 3, "diffusion_um2_s": 2.0, **changes})
    return FreeRods(options, clock(), (64, 128), PIXEL_NM, seed)


@given(cuts=CUTS)
def test_free_rods_do_not_depend_on_the_cuts(cuts):
    whole = list(rods().advance(sum(cuts)))
    made = rods()
    parts = [list(made.advance(n)) for n in cuts]
    for rod, (x_nm, y_nm, photons) in enumerate(whole):
        np.testing.assert_array_equal(np.concatenate([p[rod][0] for p in parts]), x_nm)
        np.testing.assert_array_equal(np.concatenate([p[rod][1] for p in parts]), y_nm)
        assert 300.0 <= photons[0] <= 1000.0


def test_free_rods_diffuse_and_flow_and_come_in_again():
    n = 4000
    span_nm = 128 * PIXEL_NM + 4000.0
    for x_nm, y_nm, _ in rods(flow_um_s=(20.0, 0.0)).advance(n):
        assert x_nm.min() > -2600.0
        assert x_nm.max() < 128 * PIXEL_NM + 2600.0
        steps = np.diff(x_nm.mean(axis=1))
        steps = (steps + span_nm / 2) % span_nm - span_nm / 2
        assert steps.mean() == pytest.approx(20e3 * T, abs=4.0 * steps.std() / math.sqrt(n))
        # Means over exposures that fill the frame: 2 D T (1 - 1/3).
        expected = 2.0 * 2e6 * T * 2.0 / 3.0
        assert steps.var() == pytest.approx(expected, rel=5.0 * math.sqrt(2.0 / n))
        assert y_nm.shape == x_nm.shape
