"""Dyes that are missing, bleach and blink: light and middle of an end against their laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.dyes import Dyes
from rotortrack.simulate.film.options import BleachingOptions, BlinkingOptions, DyesOptions

T = 0.002


def dyes(rotor=0, end=0, photons=600.0, *, seed=4, exposure_s=T, **effects):
    return Dyes(rotor, end, photons, Clock(10_000, T, exposure_s), seed, **effects)


def test_an_end_without_effects_gives_its_light_once():
    photons, offset = dyes().advance(7)
    assert photons.tolist() == [600.0]
    assert offset is None


@given(
    cuts=st.lists(st.integers(1, 30), min_size=1, max_size=6),
    exposure_s=st.sampled_from([0.0, 0.001, T]),
)
def test_nothing_depends_on_how_many_frames_are_asked_for_at_a_time(cuts, exposure_s):
    effects = {
        "dyes": DyesOptions(labelled=0.8, spread=0.2),
        "bleaching": BleachingOptions(lifetime_s=0.05),
        "blinking": BlinkingOptions(on_s=0.02, off_s=0.01),
    }
    whole = dyes(exposure_s=exposure_s, **effects).advance(sum(cuts))
    made = dyes(exposure_s=exposure_s, **effects)
    pieces = [made.advance(n) for n in cuts]
    for which in (0, 1):
        np.testing.assert_array_equal(np.concatenate([p[which] for p in pieces]), whole[which])


def test_places_without_dye_dim_the_end_and_move_its_middle():
    light, offsets = [], []
    for rotor in range(400):
        photons, offset = dyes(rotor, dyes=DyesOptions(labelled=0.7)).advance(1)
        light.append(photons[0] / 600.0 * 20)
        offsets.append(offset[0])
    assert np.round(light) == pytest.approx(light)
    assert np.mean(light) == pytest.approx(14.0, abs=4.0 * math.sqrt(20 * 0.21 / 400))
    assert abs(np.mean(offsets)) < 4.0 * np.std(offsets) / 20.0
    assert 0.0 < np.max(np.abs(offsets)) < 20.0
    full = dyes(dyes=DyesOptions()).advance(1)
    assert (full[0][0], full[1][0]) == pytest.approx((600.0, 0.0))


def test_the_second_end_has_its_own_dyes():
    places = DyesOptions(counts=(20, 3), lengths_nm=(40.0, 30.0), labelled=0.5)
    seen = set()
    for rotor in range(60):
        photons, offset = dyes(rotor, 1, 300.0, dyes=places).advance(1)
        seen.add((round(photons[0]), round(offset[0])))
    # Three places, 10 nm apart, of 100 photons each.
    assert seen == {
        (0, 0),
        (100, -10),
        (100, 0),
        (100, 10),
        (200, -5),
        (200, 0),
        (200, 5),
        (300, 0),
    }


def test_brightness_differs_but_is_right_on_average():
    light = [dyes(rotor, dyes=DyesOptions(spread=0.5)).advance(1)[0][0] for rotor in range(400)]
    sd = 600.0 * 0.5 / math.sqrt(20)
    assert np.mean(light) == pytest.approx(600.0, abs=4.0 * sd / 20.0)
    assert np.std(light) == pytest.approx(sd, rel=4.0 / math.sqrt(800))


def test_bleached_ends_die_exponentially_and_stay_dark():
    survived = np.zeros(2000)
    for rotor in range(400):
        photons, _ = dyes(rotor, bleaching=BleachingOptions(lifetime_s=1.0)).advance(2000)
        assert np.all(np.diff(photons) <= 0.0)
        survived += photons / 600.0
    survived /= 400
    times = (np.arange(2000) + 0.5) * T
    expected = np.exp(-times)
    assert np.abs(survived - expected).max() < 4.0 * math.sqrt(0.25 / 400)


def test_bleaching_begins_when_the_end_comes_into_the_light():
    photons, _ = dyes(bleaching=BleachingOptions(lifetime_s=1e-3), lit_from_s=1.0).advance(600)
    assert np.all(photons[:500] == 600.0)
    assert not photons[550:].any()


@pytest.mark.parametrize("exposure_s", [0.0, 0.001, T])
def test_a_blinking_end_shines_for_its_share_of_time(exposure_s):
    blinking = BlinkingOptions(on_s=0.03, off_s=0.01)
    n = 50_000
    photons, _ = dyes(blinking=blinking, exposure_s=exposure_s).advance(n)
    share = photons / 600.0
    assert share.min() >= 0.0
    assert share.max() <= 1.0
    relaxation_s = 1.0 / (1.0 / 0.03 + 1.0 / 0.01)
    independent = n * T / (2.0 * relaxation_s)
    assert share.mean() == pytest.approx(0.75, abs=4.0 * math.sqrt(0.1875 / independent))
    if exposure_s == 0.0:
        assert set(share.tolist()) == {0.0, 1.0}
        together = np.mean((share[5:] - 0.75) * (share[:-5] - 0.75)) / 0.1875
        expected = math.exp(-5 * T / relaxation_s)
        assert together == pytest.approx(expected, abs=4.0 / math.sqrt(independent))
    else:
        # A telegraph averaged over a window of r relaxation times: 2 v (r - 1 + exp(-r)) / r^2.
        r = exposure_s / relaxation_s
        variance = 0.1875 * 2.0 * (r - 1.0 + math.exp(-r)) / r**2
        assert share.var() == pytest.approx(variance, rel=5.0 / math.sqrt(independent))


def test_one_effect_does_not_change_another():
    bleaching = BleachingOptions(lifetime_s=0.5)
    alone, _ = dyes(bleaching=bleaching).advance(2000)
    both, _ = dyes(bleaching=bleaching, blinking=BlinkingOptions(on_s=1.0, off_s=0.01)).advance(
        2000
    )
    assert np.all(both <= alone + 1e-9)
    assert np.flatnonzero(alone)[-1] - np.flatnonzero(both)[-1] < 100
