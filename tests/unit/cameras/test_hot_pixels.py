"""Hot pixels stand out of read noise that is lognormal."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.cameras.hot_pixels import hot_limit_e, hot_pixels_of

sys.path.insert(0, str(Path(__file__).parent))
from sensor import sensor


@pytest.mark.parametrize("share", [0.0, 0.01, 0.05])
def test_hot_pixels_are_found_and_others_left(share: float) -> None:
    known = sensor((256, 256), hot=share)
    found = hot_pixels_of(known.read)
    assert not (known.hot & ~found).any()
    assert (found & ~known.hot).sum() <= 8


def test_the_limit_of_lognormal_noise_is_four_standard_deviations_above() -> None:
    noise = np.exp(np.random.default_rng(1).normal(np.log(1.5), 0.3, (400, 400)))
    assert hot_limit_e(noise) == pytest.approx(1.5 * np.exp(4 * 0.3), rel=0.03)


def test_pixels_nearly_alike_are_hot_only_above_twice_the_median() -> None:
    noise = np.random.default_rng(2).normal(1.4, 0.02, (40, 50))
    noise[3, 4], noise[5, 6] = 2.7, 2.9
    assert np.argwhere(hot_pixels_of(noise)).tolist() == [[5, 6]]
    assert not hot_pixels_of(np.ones((4, 5))).any()


@given(factor=st.floats(1e-3, 1e3))
def test_the_unit_does_not_matter(factor: float) -> None:
    noise = sensor((32, 32), hot=0.02).read
    np.testing.assert_array_equal(hot_pixels_of(noise * factor), hot_pixels_of(noise))


def test_pixels_without_noise_or_number_have_no_part() -> None:
    noise = sensor((32, 32)).read
    limit = hot_limit_e(noise)
    padded = np.concatenate([noise, np.zeros((9, 32)), np.full((9, 32), np.nan)])
    assert hot_limit_e(padded) == limit
    assert not hot_pixels_of(padded)[32:].any()
    assert hot_limit_e(np.zeros((3, 3))) == np.inf
    assert not hot_pixels_of(np.array([[1e-300, 1.0], [1e300, np.inf]]))[0].any()
