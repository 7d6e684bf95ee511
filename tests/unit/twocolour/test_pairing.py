"""Beads find their partners, and where several shifts would do, none is taken."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.errors import RegistrationError
from rotortrack.twocolour.options import RegisterOptions
from rotortrack.twocolour.pairing import pair_beads

PIXEL_NM = 108.3
SIDE_PX = 200
SIDE_NM = SIDE_PX * PIXEL_NM
REGIONS = ((0, 0, SIDE_PX, SIDE_PX), (SIDE_PX, 0, SIDE_PX, SIDE_PX))


class Field:
    """Beads in both colours, some of them lost in either, in an order of their own."""

    def __init__(self, places, seed, *, light=None, mirror=None):
        rng = np.random.default_rng([seed, 7])
        away = places - SIDE_NM / 2.0
        angle = rng.uniform(-0.03, 0.03)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        other = away @ turn.T * rng.uniform(0.99, 1.01)
        other += 80.0 * (away / SIDE_NM * 2.0) * np.sum((away / SIDE_NM) ** 2, axis=1)[:, None]
        other += SIDE_NM / 2.0 + rng.uniform(-1200.0, 1200.0, 2)
        if mirror == "left-right":
            other[:, 0] = SIDE_NM - other[:, 0]
        light = np.ones(len(places)) if light is None else light
        self.names, self.nm, self.photons = [], [], []
        for channel, spots in enumerate((places, other)):
            seen = spots + rng.normal(0.0, 5.0, spots.shape)
            inside = ((seen > 0.0) & (seen < SIDE_NM)).all(axis=1)
            names = rng.permutation(np.flatnonzero(inside & (rng.random(len(seen)) > 0.08)))
            self.names.append(names)
            self.nm.append(seen[names] + [channel * SIDE_NM, 0.0])
            self.photons.append(light[names] * np.exp(rng.normal(0.0, 0.1, len(names))))

    def pair(self, **options):
        return pair_beads(
            *self.nm,
            *self.photons,
            regions=REGIONS,
            pixel_size_nm=PIXEL_NM,
            options=RegisterOptions(**options),
        )

    def right(self, pairs):
        return np.mean(self.names[0][pairs.first] == self.names[1][pairs.second])


def scattered(seed, n=400):
    return np.random.default_rng(seed).uniform(-2000.0, SIDE_NM + 2000.0, (n, 2))


def grid(seed, pitch_nm=1100.0, jitter_nm=0.0, missing=0.0):
    rng = np.random.default_rng(seed)
    side = np.arange(-40, 41) * pitch_nm
    places = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    angle = rng.uniform(0.02, 0.3)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    places = places @ turn.T + SIDE_NM / 2.0 + rng.normal(0.0, jitter_nm, places.shape)
    return places[rng.random(len(places)) >= missing]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("mirror", [None, "left-right"])
def test_scattered_beads_are_paired(seed, mirror):
    field = Field(scattered(seed), seed, mirror=mirror)
    pairs = field.pair()
    assert pairs.mirror == (mirror or "none")
    assert field.right(pairs) > 0.99
    assert len(pairs.first) > 0.7 * min(map(len, field.nm))
    assert pairs.spread_nm == pytest.approx(5.0 * np.sqrt(2.0), rel=0.3)


@pytest.mark.parametrize("seed", range(5))
def test_a_whole_grid_is_refused_and_its_shifts_are_told(seed):
    field = Field(grid(seed), seed)
    with pytest.raises(RegistrationError, match=r"ambiguous beads: .* shifts .*;.*--shift-nm"):
        field.pair(mirror="none")


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("fingerprint", ["light", "jitter"])
def test_a_grid_with_a_fingerprint_is_paired_rightly_or_refused(seed, fingerprint):
    places = grid(seed, jitter_nm=20.0 * (fingerprint == "jitter"), missing=0.1)
    light = np.random.default_rng(seed).uniform(1.0, 4.0, len(places))
    field = Field(places, seed, light=light if fingerprint == "light" else None)
    pairs = field.pair(mirror="none")
    assert field.right(pairs) > 0.99


@pytest.mark.parametrize("seed", range(10))
def test_no_grid_is_ever_paired_one_pitch_off(seed):
    rng = np.random.default_rng(seed)
    places = grid(seed, rng.uniform(800.0, 1600.0), missing=rng.uniform(0.0, 0.1))
    field = Field(places, seed)
    try:
        pairs = field.pair(mirror="none")
    except RegistrationError as error:
        right = float(error.reason == "ambiguous beads")
    else:
        right = field.right(pairs)
    assert right > 0.99


def test_the_shift_that_the_user_gives_decides():
    field = Field(grid(3), 3)
    truth = np.full(2, np.nan)
    both, first, second = np.intersect1d(*field.names, return_indices=True)
    assert both.size
    truth = (field.nm[1][second] - [SIDE_NM, 0.0] - field.nm[0][first]).mean(axis=0)
    pairs = field.pair(shift_nm=tuple(truth + 100.0), mirror="none")
    assert field.right(pairs) > 0.99
    np.testing.assert_allclose(pairs.shift_nm, truth, atol=60.0)


def test_colours_that_have_nothing_in_common_are_refused():
    field = Field(scattered(1), 1)
    field.nm[1] = np.random.default_rng(5).uniform(0.0, SIDE_NM, (300, 2)) + np.array(
        [SIDE_NM, 0.0]
    )
    field.photons[1] = np.ones(300)
    with pytest.raises(RegistrationError, match="no match: no shift below 6000 nm"):
        field.pair()


def test_a_colour_with_few_beads_is_refused():
    field = Field(scattered(1), 1)
    field.nm[1], field.photons[1] = field.nm[1][:3], field.photons[1][:3]
    with pytest.raises(RegistrationError, match="too few beads: the second colour shows 3 beads"):
        field.pair()


def test_the_order_of_beads_does_not_matter():
    field = Field(scattered(2), 2)
    plain = field.pair()
    order = np.random.default_rng(0).permutation(len(field.nm[1]))
    field.nm[1], field.photons[1] = field.nm[1][order], field.photons[1][order]
    again = field.pair()
    before = set(zip(plain.first.tolist(), plain.second.tolist(), strict=True))
    after = set(zip(again.first.tolist(), order[again.second].tolist(), strict=True))
    assert before == after
