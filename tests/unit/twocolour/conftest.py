"""A field of beads in two colours whose distortion is known."""

from __future__ import annotations

import numpy as np
import pytest

FIELD_NM = 30_000.0


def distorted(second_nm):
    """Map the second colour onto the first: turn, scale, 120 nm radial, 40 keystone, 15 waves."""
    away = second_nm - FIELD_NM / 2.0
    unit = away / (FIELD_NM / 2.0)
    turn = np.array([[np.cos(0.004), -np.sin(0.004)], [np.sin(0.004), np.cos(0.004)]])
    mapped = 1.003 * away @ turn.T
    mapped = mapped + 60.0 * unit * np.sum(unit**2, axis=1, keepdims=True)
    mapped = mapped + 40.0 * unit * unit[:, :1]
    waves = np.sin(2.0 * np.pi * second_nm[:, ::-1] / np.array([20_000.0, 24_000.0]))
    return mapped + 15.0 * waves + FIELD_NM / 2.0 + (200.0, -150.0)


@pytest.fixture(scope="session")
def distort():
    """Return the map of the second colour onto the first."""
    return distorted


@pytest.fixture
def bead_pairs():
    """Return places of n beads in the second colour and, with noise, in the first."""

    def make(seed, n=400, noise_nm=10.0):
        rng = np.random.default_rng(seed)
        second = rng.uniform(0.0, FIELD_NM, (n, 2))
        return second, distorted(second) + rng.normal(0.0, noise_nm, (n, 2))

    return make


@pytest.fixture
def target_error_nm():
    """Return the rms error per axis of a map over the inner field."""
    side = np.linspace(500.0, FIELD_NM - 500.0, 40)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    truth = distorted(grid)

    def measure(mapping):
        return float(np.sqrt(np.mean((mapping(grid) - truth) ** 2)))

    return measure
