"""What smoothing takes from a length and noise adds to it."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.afm.centre_line import along, smooth
from rotortrack.afm.rod import LOST_LENGTH, NOISE_LENGTH
from rotortrack.simulate.afm import worm_like_chain


@pytest.mark.parametrize("length", [3.0, 8.0])
def test_noise_lengthens_a_smoothed_line_by_its_share(length):
    y = np.random.default_rng(0).normal(0.0, 1.0, 200_000)
    line = smooth(np.stack([np.arange(y.size, dtype=float), y], axis=1), length)[100:-100]
    excess = along(line)[-1] / np.ptp(line[:, 0]) - 1.0
    expected = NOISE_LENGTH * (line[:, 1].std() / length) ** 2
    # Spacing and slope are not infinitely small: a few per cent.
    assert excess == pytest.approx(expected, rel=0.06)


def test_smoothing_shortens_a_chain_by_its_share():
    rng = np.random.default_rng(1)
    lost = []
    for _ in range(200):
        chain = worm_like_chain(rng, 2000.0, 1000.0)
        inner = smooth(chain, 16.0)[400:-400]
        lost.append(1.0 - along(inner)[-1] / along(chain[400:-400])[-1])
    assert np.mean(lost) == pytest.approx(LOST_LENGTH * 8.0 / 1000.0, rel=0.05)
