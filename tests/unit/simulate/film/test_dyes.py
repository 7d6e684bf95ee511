"""Dyes: how many there are, when they are dark, and where the middle of the lit ones is."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import stats

from rotortrack.simulate.film import dyes as module
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.dyes import Dyes
from rotortrack.simulate.film.options import BleachingOptions, BlinkingOptions, DyesOptions
from rotortrack.simulate.film.streams import Effect, stream

T = 0.002
PHOTONS = 1000.0
DYES = DyesOptions(labelled=0.8, spread=0.3)
BLEACHING = BleachingOptions(lifetime_s=0.1)
BLINKING = BlinkingOptions(on_s=0.01, off_s=0.004)


@pytest.fixture
def touched(monkeypatch):
    """Give the effects whose streams are asked for."""
    asked = []

    def noted(seed, effect, *numbers):
        asked.append(effect)
        return stream(seed, effect, *numbers)

    monkeypatch.setattr(module, "stream", noted)
    return asked


def light_of(n_frames, *, rotor=0, end=0, exposure_s=T, interval_s=T, seed=5, **effects):
    clock = Clock(n_frames, interval_s, exposure_s)
    return Dyes(rotor, end, PHOTONS, clock, seed, **effects).advance(n_frames)


def test_an_end_without_effects_is_one_steady_point_and_draws_nothing(touched):
    photons, offset_nm = light_of(50)
    assert photons.tolist() == [PHOTONS]
    assert offset_nm is None
    assert touched == []


@pytest.mark.parametrize("end", [0, 1])
def test_a_full_cloud_has_all_photons_in_its_middle_and_draws_nothing(end, touched):
    photons, offset_nm = light_of(50, end=end, dyes=DyesOptions())
    assert photons == pytest.approx([PHOTONS], rel=1e-14)
    assert offset_nm == pytest.approx([0.0], abs=1e-12)
    assert touched == []


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        ({"dyes": DyesOptions(labelled=0.5)}, {Effect.LABELS}),
        ({"dyes": DyesOptions(spread=0.5)}, {Effect.LABELS}),
        ({"bleaching": BLEACHING}, {Effect.BLEACHING}),
        ({"dyes": DyesOptions(), "blinking": BLINKING}, {Effect.BLINKING}),
    ],
)
def test_each_effect_touches_its_own_stream(effects, expected, touched):
    light_of(20, **effects)
    assert set(touched) == expected


def test_places_carry_dyes_at_random():
    labelled, places, ends = 0.7, 20, 2000
    options = DyesOptions(labelled=labelled)
    photons = [light_of(1, rotor=rotor, dyes=options)[0][0] for rotor in range(ends)]
    lit = np.array(photons) / (PHOTONS / places)
    np.testing.assert_allclose(lit, np.round(lit), atol=1e-9)
    counts = np.bincount(np.round(lit).astype(int), minlength=places + 1)
    expected = ends * stats.binom.pmf(np.arange(places + 1), places, labelled)
    rare = expected < 5.0
    counts = np.append(counts[~rare], counts[rare].sum())
    expected = np.append(expected[~rare], expected[rare].sum())
    assert stats.chisquare(counts, expected).pvalue > 1e-3


def test_spread_of_brightness_keeps_the_mean_end():
    spread, ends = 0.6, 4000
    options = DyesOptions(counts=(1, 1), spread=spread)
    photons = [light_of(1, rotor=rotor, dyes=options)[0][0] for rotor in range(ends)]
    relative = np.array(photons) / PHOTONS
    assert relative.mean() == pytest.approx(1.0, abs=5.0 * spread / math.sqrt(ends))
    gamma = stats.gamma(1.0 / spread**2, scale=spread**2)
    assert stats.kstest(relative, gamma.cdf).pvalue > 1e-3


def test_labels_do_not_depend_on_the_spread_nor_brightness_on_the_labels():
    few, many, bright = (
        [light_of(1, rotor=rotor, dyes=options)[0][0] for rotor in range(40)]
        for options in (
            DyesOptions(counts=(1, 1), labelled=0.5),
            DyesOptions(counts=(1, 1), labelled=1.0, spread=0.3),
            DyesOptions(counts=(1, 1), labelled=0.5, spread=0.3),
        )
    )
    np.testing.assert_allclose(bright, np.array(few) * many / PHOTONS)


def test_the_offset_is_the_middle_of_the_lit_places():
    # Two places in the middles of the halves of 40 nm.
    options = DyesOptions(counts=(2, 2), labelled=0.5)
    ends = [light_of(1, rotor=rotor, dyes=options) for rotor in range(200)]
    found = {(round(photons[0]), round(offset[0], 9)) for photons, offset in ends}
    assert found == {(0, 0.0), (500, -10.0), (500, 10.0), (1000, 0.0)}


def test_bleaching_times_are_exponential_from_the_arrival_on():
    arrive_s, ends = 0.05, 1500
    clock_frames = 800
    left = np.array(
        [
            light_of(clock_frames, rotor=rotor, bleaching=BLEACHING, lit_from_s=arrive_s)[0].sum()
            for rotor in range(ends)
        ]
    )
    # Exposures without gaps: the sum of the shares is the time at which it goes dark.
    lasted_s = left / PHOTONS * T - arrive_s
    assert lasted_s.min() > 0.0
    assert stats.kstest(lasted_s, stats.expon(scale=0.1).cdf).pvalue > 1e-3


def test_many_dyes_decay_exponentially():
    count, lifetime_s, frames = 5000, 0.1, 150
    options = DyesOptions(counts=(count, 1))
    photons, _ = light_of(
        frames, exposure_s=0.0, dyes=options, bleaching=BleachingOptions(lifetime_s=lifetime_s)
    )
    left = np.exp(-T * np.arange(frames) / lifetime_s)
    sd = np.sqrt(left * (1.0 - left) / count)
    assert np.all(np.abs(photons / PHOTONS - left) <= 5.0 * sd + 1e-12)


def test_a_bleached_end_gives_no_light_at_all():
    photons, offset_nm = light_of(5000, dyes=DYES, bleaching=BLEACHING, blinking=BLINKING)
    last = np.flatnonzero(photons)[-1]
    assert 10 < last < 4000
    assert np.all(photons[last + 1 :] == 0.0)
    assert np.all(offset_nm[last + 1 :] == 0.0)


@pytest.mark.parametrize("exposure_s", [0.001, 0.01, 0.1])
def test_blinking_in_an_exposure_has_mean_and_variance_of_a_telegraph(exposure_s):
    ends, (on_s, off_s) = 4000, (BLINKING.on_s, BLINKING.off_s)
    shares = (
        np.array(
            [
                light_of(
                    1, rotor=rotor, blinking=BLINKING, exposure_s=exposure_s, interval_s=exposure_s
                )[0][0]
                for rotor in range(ends)
            ]
        )
        / PHOTONS
    )
    lit = on_s / (on_s + off_s)
    a = exposure_s * (1.0 / on_s + 1.0 / off_s)
    variance = 2.0 * lit * (1.0 - lit) * (a - 1.0 + math.exp(-a)) / a**2
    assert shares.mean() == pytest.approx(lit, abs=5.0 * math.sqrt(variance / ends))
    spread = np.var((shares - lit) ** 2)
    assert shares.var() == pytest.approx(variance, abs=5.0 * math.sqrt(spread / ends))


def test_blinking_is_remembered_from_frame_to_frame():
    n, (on_s, off_s) = 40_000, (BLINKING.on_s, BLINKING.off_s)
    lit = light_of(n, blinking=BLINKING, exposure_s=0.0)[0] / PHOTONS
    assert set(lit.tolist()) == {0.0, 1.0}
    mean = on_s / (on_s + off_s)
    rate = 1.0 / on_s + 1.0 / off_s
    for lag in (1, 3):
        products = (lit[:-lag] - mean) * (lit[lag:] - mean)
        blocks = products[: products.size // 200 * 200].reshape(-1, 200).mean(axis=1)
        error = blocks.std() / math.sqrt(blocks.size)
        expected = mean * (1.0 - mean) * math.exp(-rate * lag * T)
        assert products.mean() == pytest.approx(expected, abs=5.0 * error)


@pytest.mark.parametrize("rotor", range(4))
def test_shares_of_exposures_are_averages_of_instants(rotor):
    effects = {"dyes": DyesOptions(), "bleaching": BLEACHING, "blinking": BLINKING}
    # Long exposures, within which many dyes first go dark for a while and then for ever.
    frames, finer, interval_s = 25, 500, 5.0 * T
    exposed = light_of(
        frames, rotor=rotor, interval_s=interval_s, exposure_s=0.5 * interval_s, **effects
    )
    instants = light_of(
        frames * finer, rotor=rotor, interval_s=interval_s / finer, exposure_s=0.0, **effects
    )
    photons, offset_nm = (values.reshape(frames, finer)[:, : finer // 2] for values in instants)
    # An edge in each dye's exposure is wrong by half an instant: 0.1 photons of 50.
    np.testing.assert_allclose(exposed[0], photons.mean(axis=1), atol=2.0)
    moments = (photons * offset_nm).mean(axis=1)
    np.testing.assert_allclose(exposed[0] * exposed[1], moments, atol=2.0 * 20.0)


@pytest.mark.parametrize("rotor", range(5))
def test_what_dyes_do_before_they_bleach_does_not_depend_on_bleaching(rotor):
    blinks = light_of(400, rotor=rotor, blinking=BLINKING)[0]
    both = light_of(400, rotor=rotor, blinking=BLINKING, bleaching=BLEACHING)[0]
    bleaches = light_of(400, rotor=rotor, bleaching=BLEACHING)[0]
    before = bleaches == PHOTONS
    assert 0 < before.sum() < 400
    np.testing.assert_array_equal(both[before], blinks[before])
    np.testing.assert_array_equal(both[bleaches == 0.0], 0.0)


def test_a_row_that_is_read_later_sees_the_same_dyes_later():
    clock = Clock(300, T, 0.6 * T)
    effects = {"dyes": DYES, "bleaching": BLEACHING, "blinking": BLINKING}
    early, _ = Dyes(0, 0, PHOTONS, clock, 5, **effects).advance(300)
    late, _ = Dyes(0, 0, PHOTONS, clock, 5, delay_s=T, **effects).advance(300)
    np.testing.assert_allclose(late[:-1], early[1:], rtol=1e-9, atol=1e-6)


@settings(max_examples=40)
@example(cuts=list(range(1, 120)), end=0, exposure_s=T, bleaching=BLEACHING, blinking=BLINKING)
@given(
    cuts=st.lists(st.integers(1, 119), max_size=12, unique=True),
    end=st.integers(0, 1),
    exposure_s=st.sampled_from([0.0, 0.3 * T, T]),
    bleaching=st.sampled_from([None, BLEACHING]),
    blinking=st.sampled_from([None, BLINKING]),
)
def test_blocks_do_not_change_a_bit(cuts, end, exposure_s, bleaching, blinking):
    clock = Clock(120, T, exposure_s)

    def dyes():
        return Dyes(3, end, PHOTONS, clock, 7, dyes=DYES, bleaching=bleaching, blinking=blinking)

    piecewise = dyes()
    pieces = [
        [np.broadcast_to(values, after - before) for values in piecewise.advance(after - before)]
        for before, after in pairwise([0, *sorted(cuts), 120])
    ]
    for whole, column in zip(dyes().advance(120), zip(*pieces, strict=True), strict=True):
        np.testing.assert_array_equal(np.concatenate(column), np.broadcast_to(whole, 120))
